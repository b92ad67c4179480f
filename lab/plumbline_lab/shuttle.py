"""Drift of a recording without ground truth: flown as it is, and backward in time, each way with an estimator of its own.

Played backward, a flight x(t) becomes x(2 T - s): images in reverse order, angular rates negated, specific forces kept, and the other sign
of the time offset between cameras and IMU. Both ways pass the same places, so half of the squared difference is the error of one way.
Errors that both ways share do not show: focal length, baseline, scale.
"""

import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import tomlkit
from evo.core.trajectory import PoseTrajectory3D

from . import LabError, recordings
from .trajectories import TRUTHS, common, load, rotations, to_estimate

# Parts of the path on which drift is measured (Zhang and Scaramuzza 2018, section IV), and about how many poses they begin at.
PART_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)
PART_STARTS = 500
# On a shorter path drift per distance is not defined, m.
MIN_PATH_M = 1


def drift(estimate: PoseTrajectory3D, reference: PoseTrajectory3D) -> tuple[float, float]:
    """Mean errors of the parts over their lengths: percent, and degrees per metre. Both have the same stamps."""
    travelled = reference.distances
    if travelled[-1] < MIN_PATH_M:
        raise LabError(f"the path of {travelled[-1]:.2f} m is too short: record at least {MIN_PATH_M} m")
    translations, turns = [], []
    ways = [(t.positions_xyz, rotations(t)) for t in (estimate, reference)]
    for length in np.array(PART_SHARES) * travelled[-1]:
        i = np.arange(0, len(travelled), max(len(travelled) // PART_STARTS, 1))
        j = np.searchsorted(travelled, travelled[i] + length)
        i, j = i[j < len(travelled)], j[j < len(travelled)]
        if not len(i):
            continue
        # From pose i to pose j, by each way.
        (p, r), (q, s) = (((w[i].inv()).apply(x[j] - x[i]), w[i].inv() * w[j]) for x, w in ways)
        translations.append(np.linalg.norm(p - q, axis=1) / length)
        turns.append((s.inv() * r).magnitude() / length)
    return 100 * np.concatenate(translations).mean(), np.degrees(np.concatenate(turns).mean())


def write_backward(source: Path, out: Path, start_s: float, end_s: float) -> tuple[int, float]:
    """Writes a data set of the recording backward in time, from `end_s` to `start_s`; returns the stamp that stays, ns, and the seconds."""
    first_ns = turn_ns = None
    for camera in range(2):
        kept, folder = [], out / "mav0" / f"cam{camera}"
        (folder / "data").mkdir(parents=True)
        for stamp_ns, image in recordings.images(source, camera):
            first_ns = stamp_ns if first_ns is None else first_ns
            if start_s <= (stamp_ns - first_ns) * 1e-9 <= end_s:
                kept.append(stamp_ns)
                file = folder / "data" / f"{stamp_ns}.png"
                os.symlink(Path(image.filename).resolve(), file) if getattr(image, "filename", "") else image.save(file)
        if camera == 0 and len(kept) < 2:
            raise LabError(f"{source}: {len(kept)} images from {start_s} s on; give another --start or --duration")
        if not kept:
            shutil.rmtree(folder)
            continue
        turn_ns = kept[-1] if turn_ns is None else turn_ns
        lines = [f"{2 * turn_ns - stamp_ns},{stamp_ns}.png\n" for stamp_ns in reversed(kept)]
        (folder / "data.csv").write_text("#timestamp [ns],filename\n" + "".join(lines))
    samples = recordings.imu(source)[::-1]
    samples = samples.assign(stamp_ns=2 * turn_ns - samples.stamp_ns, **{f"gyro_{a}": -samples[f"gyro_{a}"] for a in "xyz"})
    (out / "mav0" / "imu0").mkdir()
    samples.to_csv(out / "mav0" / "imu0" / "data.csv", index=False, header=["#timestamp [ns]", *samples.columns[1:]])
    root = recordings.mav0(source)
    for sensor in ("cam0", "cam1", "imu0") if root else ():
        if (root / sensor / "sensor.yaml").is_file():
            shutil.copy(root / sensor / "sensor.yaml", out / "mav0" / sensor)
    return turn_ns, (turn_ns - first_ns) * 1e-9 - start_s


def backward_settings(config: Path | None) -> list[str]:
    """Changes of the configuration for the way back."""
    if config is None or not config.is_file():
        return []
    document = tomlkit.parse(config.read_text()).unwrap()
    if any(camera.get("readout_s", 0) > 0 for camera in document.get("camera", [])):
        raise LabError(f"{config}: camera.0.readout_s: a rolling shutter cannot be played backward; use a global shutter")
    offset_s = document.get("rig", {}).get("time_offset_s", 0)
    return ["--set", f"rig.time_offset_s={-offset_s}"] if offset_s else []


def fly(program: str, source: Path, options: list[str], out: Path) -> tuple[PoseTrajectory3D, dict]:
    """Trajectory and report of one way."""
    # Places are of no use: a loop would close the gap that is measured.
    command = [program, "replay", source, "--no-loop", *options, "--trajectory", out, "--report", out.with_suffix(".json")]
    ended = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if ended.returncode != 0:
        raise LabError(f"{source}: {(ended.stderr.strip().splitlines() or ['failed'])[-1]}")
    return load(out).poses, json.loads(out.with_suffix(".json").read_text())


def error_at_the_end(there: PoseTrajectory3D, back: PoseTrajectory3D) -> float:
    """Distance of the last pose of the way back from the first of the way there, joined at the turn by position and yaw, m."""
    ends = [PoseTrajectory3D(t.positions_xyz[::-1], t.orientations_quat_wxyz[::-1], t.timestamps) for t in (there, back)]
    ends[1].transform(to_estimate(*ends, "first")[0])
    return float(np.linalg.norm(ends[1].positions_xyz[-1] - ends[0].positions_xyz[-1]))


def measured(args, folder: Path) -> dict:
    """Flies both ways with temporary files in `folder`; returns the figures by their names."""
    source = Path(args.recording)
    if args.recording.startswith("sim:"):
        scene, _, options = args.recording.removeprefix("sim:").partition("?")
        source, flags = folder / "there", [f"--{option}" for option in options.split("&") if option]
        subprocess.run([args.program, "simulate", source, "--scene", scene, *flags], check=True, stdout=subprocess.DEVNULL)
    if recordings.is_log(source) and not args.config:
        raise LabError(f"{source}: is a flight log; name its configuration with --config")
    turn_ns, seconds = write_backward(source, folder / "back", args.start, args.start + (args.duration or np.inf))
    cut = ["--start", f"{args.start}", "--duration", f"{seconds:.6f}"] if args.start or args.duration else []
    options = (["--config", str(args.config)] if args.config else []) + args.options
    there, there_report = fly(args.program, source, [*options, *cut], folder / "there.tum")
    back, back_report = fly(args.program, folder / "back", [*options, *backward_settings(args.config)], folder / "back.tum")
    mirrored = 2 * (turn_ns * 1e-9) - back.timestamps[::-1]
    back = PoseTrajectory3D(back.positions_xyz[::-1], back.orientations_quat_wxyz[::-1], mirrored)
    there, back = common(there, back)
    percent, degrees = (value / np.sqrt(2) for value in drift(there, back))
    path_m, end_m = 0.5 * (there.path_length + back.path_length), error_at_the_end(there, back)
    figures = {
        "poses": there.num_poses, "path_m": path_m, "drift_percent": percent, "drift_deg_per_m": degrees,
        "error_at_the_end_m": end_m, "error_at_the_end_percent": 50 * end_m / path_m,
        "resets": [there_report["resets"], back_report["resets"]],
        "digests": [there_report["estimate_digest"], back_report["estimate_digest"]],
    }  # fmt: skip
    root = recordings.mav0(source)
    has_truth = root is not None and any((root / name).is_dir() for name in TRUTHS)
    if args.truth or has_truth:
        truth = load(args.truth or source).poses
        true = [drift(*common(way, truth))[0] for way in (there, back)]
        figures |= {"true_drift_percent": true, "found_over_true": percent / np.sqrt(np.mean(np.square(true)))}
    return figures


def run(args) -> None:
    """Prints the drift of a recording."""
    with tempfile.TemporaryDirectory(prefix="plumbline-shuttle-", dir=args.scratch) as scratch:
        figures = measured(args, Path(scratch))
    if args.json:
        print(json.dumps(figures, indent=2))
        return
    for name, value in figures.items():
        values = value if isinstance(value, list) else [value]
        print(f"{name.replace('_', ' '):<26}" + ", ".join(f"{v:.4g}" if isinstance(v, float) else str(v)[:16] for v in values))
