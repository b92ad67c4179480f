"""Pictures of flights: one with all that is known of it, or several beside each other."""

import matplotlib
import numpy as np
from evo.core.trajectory import PoseTrajectory3D

from . import LabError
from .trajectories import Estimate, ate_m, axes, common, is_rotation_known, load, rotations, time_offset, to_estimate

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

# Okabe and Ito: distinguishable for everybody, also in print.
COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"]
TRUTH, BAND = "#999999", "#d6e6f1"
# A pause of this many periods breaks a curve.
GAP_PERIODS = 3.5
ALIGNMENTS = {
    "first": "truth aligned at the first pose (position, yaw)",
    "se3": "truth aligned over all, SE(3)",
    "sim3": "truth aligned over all, Sim(3)",
    "none": "truth not aligned",
}


class Flight:
    """Flight to be drawn: estimate, and errors where the truth is known."""

    def __init__(self, estimate: Estimate, truth: PoseTrajectory3D | None, alignment: str, offset: str | None):
        self.name, self.poses, self.states = estimate.name, estimate.poses, estimate.states
        if truth is not None and offset:
            # The truth is brought onto the clock of the estimate.
            added_s = time_offset(self.poses, truth) if offset == "auto" else float(offset)
            truth = PoseTrajectory3D(truth.positions_xyz, truth.orientations_quat_wxyz, truth.timestamps - added_s)
            self.name += f", {added_s:+.4f} s"
        self.time_s = self.poses.timestamps - self.poses.timestamps[0]
        self.truth = self.errors_m = self.attitude_deg = self.ate_m = None
        if truth is not None:
            self.judge(truth, alignment)

    def judge(self, truth: PoseTrajectory3D, alignment: str) -> None:
        """Brings the truth into the frame of the estimate, and takes the errors."""
        own, true = common(self.poses, truth)
        self.ate_m, self.length_m = ate_m(own, true), true.path_length
        transform, scale = to_estimate(own, true, alignment)
        true.scale(scale)
        true.transform(transform)
        self.truth, self.known_s = true, own.timestamps - self.poses.timestamps[0]
        self.errors_m = own.positions_xyz - true.positions_xyz
        if is_rotation_known(true, alignment, self.ate_m):
            # About the axes of the odometry frame.
            self.attitude_deg = np.degrees((rotations(own) * rotations(true).inv()).as_rotvec())

    def broken(self, time_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Curve with a gap where the estimate pauses."""
        period = np.median(np.diff(self.time_s)) if len(self.time_s) > 1 else 0
        gaps = np.flatnonzero(np.diff(time_s) > GAP_PERIODS * period) + 1
        return np.insert(time_s, gaps, time_s[gaps]), np.insert(np.asarray(values, float), gaps, np.nan, axis=0)

    def title(self) -> str:
        share = f" ({100 * self.ate_m / self.length_m:.3f} %)" if self.ate_m is not None and self.length_m > 0 else ""
        return self.name + (f": ATE {self.ate_m:.4f} m{share} by SE(3)" if self.ate_m is not None else "")


def map_of(axis, flights: list[Flight]) -> None:
    """Paths from above, and the truth in the frame of the first."""
    if flights[0].truth is not None:
        axis.plot(*flights[0].truth.positions_xyz.T[:2], color=TRUTH, linewidth=2.5, label="truth")
    for flight, colour in zip(flights, COLOURS * len(flights)):
        x, y = flight.broken(flight.time_s, flight.poses.positions_xyz[:, :2])[1].T
        axis.plot(x, y, color=colour, label=flight.name)
        axis.plot(*flight.poses.positions_xyz[0, :2], "o", color=colour)
    axis.set(xlabel="x of O [m]", ylabel="y of O [m]", title="Path from above")
    axis.set_aspect("equal", "datalim")
    axis.legend(fontsize=8)


def panel(axis, flight: Flight, title: str, time_s, curves: dict, band=None) -> None:
    """Curves over time, with three standard deviations about zero."""
    if band is not None:
        time, wide = flight.broken(flight.time_s, band)
        axis.fill_between(time, -wide, wide, color=BAND, label="three sigma", linewidth=0)
        largest = max([np.nanquantile(band, 0.95), *(np.nanmax(np.abs(values)) for values in curves.values())])
        axis.set_ylim(-1.1 * largest, 1.1 * largest)
    for (name, values), colour in zip(curves.items(), COLOURS):
        axis.plot(*flight.broken(time_s, values), color=colour, label=name, linewidth=1)
    axis.set_title(title, fontsize=10)
    if len(curves) > 1 or band is not None:
        axis.legend(fontsize=7, loc="upper right")


def one(flight: Flight, alignment: str):
    """All of one flight: path, errors with their standard deviations, velocity, biases, features."""
    panels, states = [], flight.states
    sigma = lambda name, power=1: 3 * np.sqrt(states[name].clip(lower=0)) * power if states is not None else None  # noqa: E731
    if flight.errors_m is not None:
        for k, axis in enumerate("xyz"):
            curves = {"estimate - truth": flight.errors_m[:, k]}
            panels.append((f"Position error {axis} [m]", flight.known_s, curves, sigma(f"var_p_{axis}_m2")))
        if flight.attitude_deg is not None:
            tilt = np.linalg.norm(flight.attitude_deg[:, :2], axis=1)
            heading = {"estimate - truth": flight.attitude_deg[:, 2]}
            panels.append(("Heading error [deg]", flight.known_s, heading, sigma("var_heading_rad2", np.degrees(1))))
            panels.append(("Tilt error [deg]", flight.known_s, {"tilt": tilt}, None))
    else:
        panels.append(("Position in O [m]", flight.time_s, dict(zip("xyz", flight.poses.positions_xyz.T)), None))
        heading = np.degrees(np.unwrap(rotations(flight.poses).as_euler("ZYX")[:, 0]))
        panels.append(("Heading [deg]", flight.time_s, {"about z of O": heading}, None))
    if states is not None:
        vector = lambda name, unit, scale=1: dict(zip("xyz", scale * states[axes(name, unit)].to_numpy().T))  # noqa: E731
        panels.append(("Velocity in O [m/s]", flight.time_s, vector("v_o_b", "m_s"), None))
        panels.append(("Gyroscope bias [mrad/s]", flight.time_s, vector("bias_gyro", "rad_s", 1e3), None))
        panels.append(("Accelerometer bias [m/s²]", flight.time_s, vector("bias_accel", "m_s2"), None))
        features = {"points tracked": states.points_tracked, "lines matched": states.lines_matched}
        panels.append(("Features [count]", flight.time_s, {k: v.to_numpy() for k, v in features.items()}, None))
    figure = plt.figure(figsize=(12, 9), layout="constrained")
    rows = max(-(-len(panels) // 2), 2)
    grid = figure.add_gridspec(rows, 4)
    map_of(figure.add_subplot(grid[:, :2]), [flight])
    for k, (title, time_s, curves, band) in enumerate(panels):
        axis = figure.add_subplot(grid[k % rows, 2 + k // rows])
        panel(axis, flight, title, time_s, curves, None if band is None else np.asarray(band))
    figure.suptitle(flight.title() + (f", {ALIGNMENTS[alignment]}" if flight.truth is not None else ""), fontsize=11)
    return figure


def several(flights: list[Flight], alignment: str):
    """Several flights: paths, and the sizes of their errors over time."""
    figure, (above, position, attitude) = plt.subplots(3, 1, figsize=(11, 13), layout="constrained")
    map_of(above, flights)
    for axis, name in ((position, "Position error [m]"), (attitude, "Attitude error [deg]")):
        axis.set(ylabel=name, xlabel="time since the first pose [s]")
    for flight, colour in zip(flights, COLOURS * len(flights)):
        for axis, errors in ((position, flight.errors_m), (attitude, flight.attitude_deg)):
            if errors is not None:
                size = flight.broken(flight.known_s, np.linalg.norm(errors, axis=1))
                axis.plot(*size, color=colour, label=flight.title() if axis is position else flight.name)
    for axis in (position, attitude):
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize=8)
        else:
            axis.text(0.5, 0.5, "unknown: no truth, or positions move too little for the alignment", ha="center", transform=axis.transAxes)
    if flights[0].truth is not None:
        figure.suptitle(ALIGNMENTS[alignment], fontsize=11)
    return figure


def run(args) -> None:
    """Draws the flights into one file."""
    if args.out.suffix not in (".svg", ".png", ".pdf"):
        raise LabError(f"--out {args.out}: name the file with the ending .svg, .png or .pdf")
    truth = load(args.truth).poses if args.truth else None
    estimates = [load(path) for path in args.files]
    for estimate, name in zip(estimates, args.names):
        estimate.name = name
    flights = [Flight(estimate, truth, args.align, args.time_offset) for estimate in estimates]
    figure = one(flights[0], args.align) if len(flights) == 1 else several(flights, args.align)
    figure.savefig(args.out, dpi=100)
    plt.close(figure)
    for flight in flights:
        print(flight.title())
