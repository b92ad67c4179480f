"""Noise of an inertial sensor at rest: white noise densities and bias walks by the Allan variance, and the keys of a configuration."""

from dataclasses import dataclass
from pathlib import Path

import allantools
import matplotlib
import numpy as np
import tomlkit
from tabulate import tabulate

from . import LabError, recordings

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

# A rest shorter than this shows no noise, s.
SHORTEST_REST_S = 2
# Averages count from here on: a sensor's own filter and the steps of its converter colour shorter ones, s.
SHORTEST_TAU_S = 0.05
# A random walk is significant if it exceeds this many of its standard deviations.
SEEN_SIGMAS = 3
# Averages of neighbouring octaves share samples: by this much the standard deviations of the fit grow (measured in simulation).
SHARED_SAMPLES = 1.4
# A misfit above this is reported.
NOTABLE_MISFIT = 4
SENSORS = {"gyro": ("gyroscope", "rad/s/√Hz", "rad/s²/√Hz"), "accel": ("accelerometer", "m/s²/√Hz", "m/s³/√Hz")}


@dataclass
class Noise:
    """Fit of an axis: `sigma²(tau) = N² / tau + K² tau / 3`, each value with its standard deviation."""

    taus_s: np.ndarray
    deviations: np.ndarray
    density: tuple[float, float]
    walk: tuple[float, float] | None
    walk_at_most: float
    misfit: float


def rest(samples) -> tuple[slice, float, list[str]]:
    """Longest stretch in which no half second shows rotation, tilt, displacement or a push; the sample interval, s; remarks."""
    time_s = (samples.stamp_ns.to_numpy() - samples.stamp_ns.iloc[0]) * 1e-9
    dt_s = float(np.median(np.diff(time_s)))
    size = max(round(0.5 / dt_s), 4)
    count = len(samples) // size
    values = samples.iloc[: count * size, 1:].to_numpy().reshape(count, size, 2, 3)
    means = values.mean(axis=1)
    scatter = np.sqrt(((values - means[:, None]) ** 2).mean(axis=(1, 3)))
    gaps = np.diff(time_s[: count * size].reshape(count, size), axis=1).max(axis=1) > max(0.1, 2.5 * dt_s)
    steps = np.linalg.norm(means - means[np.r_[min(1, count - 1), 0 : count - 1]], axis=2)
    is_steady = ~gaps & (np.linalg.norm(means[:, 0], axis=1) < 0.2) & (steps[:, 0] < 0.02) & (steps[:, 1] < 0.1)
    usual = np.median(scatter[is_steady], axis=0) if is_steady.any() else np.zeros(2)
    is_still = is_steady & (scatter <= 5 * usual).all(axis=1)
    edges = np.flatnonzero(np.diff(np.r_[False, is_still, False].astype(int))).reshape(-1, 2)
    begin, end = max(edges, key=lambda edge: edge[1] - edge[0], default=(0, 0))
    stop = len(samples) if end == count and end > begin else end * size
    if (stop - begin * size) * dt_s < SHORTEST_REST_S:
        raise LabError(
            f"the recording of {time_s[-1]:.1f} s is nowhere at rest for {SHORTEST_REST_S} s; lay the vehicle on something solid, rotors "
            "off, and do not touch it"
        )
    share = f"only {100 * is_still.mean():.0f} % of {time_s[-1]:.1f} s are at rest; the longest rest is used"
    remarks = [] if is_still.mean() >= 0.99 else [share]
    if (np.median(scatter[begin:end], axis=0) > (0.02, 0.2)).any():
        remarks.append("the vehicle vibrates: the results describe the vibration; stop the rotors")
    return slice(begin * size, stop), dt_s, remarks


def scored(tau, variance, freedoms, has_walk: bool):
    """Squares of density and walk of largest likelihood with their standard deviations, and the misfit.

    An Allan variance of f degrees of freedom is spread about the true one as a chi-square over f. Fisher scoring is weighted least squares
    with the weights f / (2 sigma⁴) of the model.
    """
    design = np.stack([1 / tau, tau / 3], axis=1)[:, : 1 + has_walk]
    squares = np.array([variance[0] * tau[0], 0.0])[: 1 + has_walk]
    for _ in range(60):
        model = design @ squares.clip(min=0)
        share = squares[0] / tau / model
        f = share * freedoms[:, 0] + (1 - share) * freedoms[:, 1]
        weights = f / (2 * model**2)
        covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
        found = covariance @ (design.T @ (weights * variance))
        squares = np.r_[max(found[0], 1e-3 * squares[0]), found[1:]]
    misfit = (0.5 * f * (variance / (design @ squares.clip(min=0)) - 1) ** 2).sum() / (len(tau) - 2)
    return squares, np.sqrt(np.diag(covariance)), float(misfit)


def fit(values: np.ndarray, dt_s: float) -> Noise | None:
    """Fits an axis; `None` where there are too few averages or no noise at all."""
    octaves = 2 ** np.arange(max(int(np.log2(max(len(values) // 4, 1))) + 1, 1))
    taus, deviations, *_ = allantools.oadev(values - values.mean(), 1 / dt_s, data_type="freq", taus=octaves * dt_s)
    used = taus >= SHORTEST_TAU_S
    tau, variance = taus[used], deviations[used] ** 2
    if len(tau) < 3 or not (variance > 0).all():
        return None
    # Equivalent degrees of freedom, for white noise and for a random walk.
    shape = {"d": 2, "N": len(values) + 1, "overlapping": True, "modified": False}
    freedoms = np.array([[allantools.edf_greenhall(alpha=alpha, m=round(t / dt_s), **shape) for alpha in (0, -2)] for t in tau])
    (white2, walk2), sigmas, misfit = scored(tau, variance, freedoms, has_walk=True)
    if walk2 <= 0:
        (white2,), _, misfit = scored(tau, variance, freedoms, has_walk=False)
    sigmas = sigmas * SHARED_SAMPLES * np.sqrt(max(misfit, 1))
    density, walk = np.sqrt(white2), np.sqrt(max(walk2, 0))
    seen = (walk, sigmas[1] / (2 * walk)) if walk2 > SEEN_SIGMAS * sigmas[1] else None
    return Noise(taus, deviations, (density, sigmas[0] / (2 * density)), seen, np.sqrt(max(walk2, 0) + 2 * sigmas[1]), misfit)


def together(axes: list[tuple[float, float] | None]) -> tuple[float, float] | None:
    """Root mean square of three axes with its standard deviation; `None` if one is unknown."""
    if any(axis is None for axis in axes):
        return None
    values, sigmas = np.array(axes).T
    mean = np.sqrt((values**2).mean())
    return float(mean), float(np.sqrt(((2 * values * sigmas / 3) ** 2).sum()) / (2 * mean))


def words(value: tuple[float, float] | None, at_most: float | None = None) -> str:
    if value:
        return f"{value[0]:.3e} ±{100 * value[1] / value[0]:.1f} %"
    return f"below {at_most:.1e}" if at_most else "not found"


def draw(noises: dict[str, list[Noise | None]], out: Path) -> None:
    """Allan deviations with their fits."""
    figure, panels = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
    for panel, (sensor, axes) in zip(panels, noises.items()):
        name, density_unit, _ = SENSORS[sensor]
        for noise, letter in ((noise, letter) for noise, letter in zip(axes, "xyz") if noise):
            (line,) = panel.loglog(noise.taus_s, noise.deviations, "o", markersize=4, label=letter)
            walk = noise.walk[0] if noise.walk else 0
            model = np.sqrt(noise.density[0] ** 2 / noise.taus_s + walk**2 * noise.taus_s / 3)
            panel.loglog(noise.taus_s, model, color=line.get_color(), linewidth=1)
        panel.set(xlabel="averaging time [s]", ylabel=f"Allan deviation [{density_unit.removesuffix('/√Hz')}]", title=name)
        panel.grid(which="both", alpha=0.3)
        panel.legend()
    figure.savefig(out)
    plt.close(figure)


def write(config: Path, found: dict[str, float], out: Path) -> None:
    """Writes the configuration with the measured keys of [imu] replaced; all else stays as it is."""
    document = tomlkit.parse(config.read_text())
    if "imu" not in document:
        raise LabError(f"{config}: has no table [imu]; give a complete configuration, such as `plumbline config sim` prints")
    document["imu"].update(found)
    out.write_text(tomlkit.dumps(document))


def run(args) -> None:
    """Measures the noise of a recording at rest."""
    if args.out and not args.config:
        raise LabError("--out: needs --config FILE, whose other keys are copied")
    samples = recordings.imu(args.recording, args.topic)
    if len(samples) < 100:
        raise LabError(f"{args.recording}: holds {len(samples)} inertial samples; record two hours at rest")
    still, dt_s, remarks = rest(samples)
    noises = {sensor: [fit(samples[f"{sensor}_{axis}"].to_numpy()[still], dt_s) for axis in "xyz"] for sensor in SENSORS}
    rows, found = [], {"rate_hz": round(1 / dt_s, 3)}
    for sensor, axes in noises.items():
        name, density_unit, walk_unit = SENSORS[sensor]
        for noise, letter in zip(axes, "xyz"):
            rows.append([f"{name} {letter}", words(noise and noise.density), words(noise and noise.walk, noise and noise.walk_at_most)])
            if noise and noise.misfit > NOTABLE_MISFIT:
                remarks.append(f"{name} {letter}: the noise has other components (misfit {noise.misfit:.0f}): vibration, or warming up")
        density, walk = (together([noise and getattr(noise, kind) for noise in axes]) for kind in ("density", "walk"))
        at_most = max((noise.walk_at_most for noise in axes if noise), default=None)
        rows.append([f"{name} ({density_unit}, {walk_unit})", words(density), words(walk, at_most)])
        found |= {f"{sensor}_noise_density": args.inflate * float(density[0])} if density else {}
        found |= {f"{sensor}_bias_walk": float(walk[0])} if walk else {}
        if not walk:
            remarks.append(f"{name}: too short for the bias walk of every axis; record two hours at an even temperature")
    print(f"rest of {(still.stop - still.start) * dt_s:.1f} s at {1 / dt_s:.1f} Hz")
    print(tabulate(rows, ["", "white noise density", "bias walk"], disable_numparse=True))
    print("".join(f"warning: {remark}\n" for remark in remarks), end="")
    if args.plot:
        draw(noises, args.plot)
    if args.out:
        write(args.config, found, args.out)
        print(f"{args.out}: {', '.join(f'imu.{name}' for name in found)} from this recording, all else from {args.config}")
