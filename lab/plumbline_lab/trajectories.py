"""Trajectories: reading, alignment with the truth, and the offset between two clocks. Poses and errors are those of evo."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from evo.core import lie_algebra as lie
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from scipy import signal
from scipy.spatial.transform import Rotation, Slerp

from . import LabError

# The truth is interpolated between poses up to this far apart, s.
MAX_GAP_S = 0.1
# Rotations and scales follow from positions that are spread by so many of their errors.
TELLING = 5
# Directories of the ground truth in a data set, the best first.
TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")


@dataclass
class Estimate:
    """Estimated trajectory, with the table of its states where the file has more than poses."""

    name: str
    poses: PoseTrajectory3D
    states: pd.DataFrame | None = None


def poses(stamps_s, positions, quaternions_xyzw) -> PoseTrajectory3D:
    """Trajectory in order of time."""
    order = np.argsort(stamps_s, kind="stable")
    quaternions = np.roll(np.asarray(quaternions_xyzw, float), 1, axis=1)[order]
    return PoseTrajectory3D(np.asarray(positions, float)[order], quaternions, np.asarray(stamps_s, float)[order])


def load(path: Path) -> Estimate:
    """Reads a table of states, a trajectory in TUM format (also gzip), a EuRoC table, or the truth of a data set."""
    if path.is_dir():
        roots = (path / "mav0", path)
        found = [root / name / "data.csv" for root in roots for name in TRUTHS if (root / name / "data.csv").is_file()]
        if not found:
            raise LabError(f"{path}: holds no ground truth with attitudes (mav0/{TRUTHS[0]}/data.csv); give a trajectory file")
        return load(found[0])
    if not path.is_file():
        raise LabError(f"{path}: no such file; `plumbline replay FLIGHT --states OUT.csv` writes one")
    try:
        with pd.io.common.get_handle(path, "r", compression="infer") as handle:
            is_states = handle.handle.readline().startswith("stamp_ns,")
        if is_states:
            states = pd.read_csv(path).dropna(subset=["p_o_b_x_m"]).reset_index(drop=True)
            quaternions = states[[f"q_o_b_{axis}" for axis in "xyzw"]]
            return Estimate(path.stem, poses(states.stamp_ns * 1e-9, states[axes("p_o_b", "m")], quaternions), states)
        if ".csv" in path.suffixes:
            rows = numbers(pd.read_csv(path, header=None, comment="#"))
            return Estimate(path.parent.parent.parent.name, poses(rows[:, 0] * 1e-9, rows[:, 1:4], rows[:, [5, 6, 7, 4]]))
        rows = numbers(pd.read_csv(path, header=None, comment="#", sep=r"\s+"))
        return Estimate(path.name.split(".")[0], poses(rows[:, 0], rows[:, 1:4], rows[:, 4:8]))
    except UnicodeDecodeError as error:
        raise LabError(f"{path}: is not text; `plumbline replay LOG --states OUT.csv` writes the states of a flight log") from error
    except (KeyError, IndexError, ValueError, pd.errors.EmptyDataError) as error:
        raise LabError(f"{path}: is no table of states, TUM trajectory or EuRoC table: {error}") from error


def numbers(table: pd.DataFrame) -> np.ndarray:
    """Rows with a stamp and a pose."""
    if table.shape[1] < 8:
        raise ValueError(f"{table.shape[1]} columns, expected a stamp and seven of a pose")
    return table.iloc[:, :8].to_numpy(float)


def axes(name: str, unit: str) -> list[str]:
    """Names of the three columns of a vector."""
    return [f"{name}_{axis}_{unit}" for axis in "xyz"]


def rotations(trajectory: PoseTrajectory3D) -> Rotation:
    return Rotation.from_quat(np.roll(trajectory.orientations_quat_wxyz, -1, axis=1))


def interpolated(trajectory: PoseTrajectory3D, stamps_s: np.ndarray) -> PoseTrajectory3D:
    """Poses at other stamps; the first or last one beyond the ends."""
    times = stamps_s.clip(trajectory.timestamps[0], trajectory.timestamps[-1])
    positions = np.stack([np.interp(times, trajectory.timestamps, axis) for axis in trajectory.positions_xyz.T], axis=1)
    quaternions = Slerp(trajectory.timestamps, rotations(trajectory))(times).as_quat()
    return PoseTrajectory3D(positions, np.roll(quaternions, 1, axis=1), stamps_s)


def common(estimate: PoseTrajectory3D, truth: PoseTrajectory3D) -> tuple[PoseTrajectory3D, PoseTrajectory3D]:
    """The poses whose truth is known, and the truth there."""
    stamps_s = estimate.timestamps
    after = np.searchsorted(truth.timestamps, stamps_s).clip(1, truth.num_poses - 1)
    is_within = (stamps_s >= truth.timestamps[0]) & (stamps_s <= truth.timestamps[-1])
    is_known = is_within & (truth.timestamps[after] - truth.timestamps[after - 1] <= MAX_GAP_S)
    if is_known.sum() < 2:
        ends = (f"{t.min():.3f} to {t.max():.3f} s" for t in (stamps_s, truth.timestamps))
        raise LabError("no stamps in common: the estimate has {}, the truth {}; try --time-offset auto".format(*ends))
    known = PoseTrajectory3D(estimate.positions_xyz[is_known], estimate.orientations_quat_wxyz[is_known], stamps_s[is_known])
    return known, interpolated(truth, known.timestamps)


def to_estimate(estimate: PoseTrajectory3D, truth: PoseTrajectory3D, alignment: str) -> tuple[np.ndarray, float]:
    """Transform and scale that bring the truth into the frame of the estimate; both have the same stamps."""
    if alignment == "none":
        return np.eye(4), 1.0
    if alignment == "first":
        # Position and yaw: what the covariance, which begins there, describes.
        turn = rotations(estimate)[0] * rotations(truth)[0].inv()
        rotation = Rotation.from_rotvec([0, 0, 2 * np.arctan2(*turn.as_quat()[2:])]).as_matrix()
        return lie.se3(rotation, estimate.positions_xyz[0] - rotation @ truth.positions_xyz[0]), 1.0
    moved = PoseTrajectory3D(truth.positions_xyz, truth.orientations_quat_wxyz, truth.timestamps)
    rotation, translation, scale = moved.align(estimate, correct_scale=alignment == "sim3")
    return lie.se3(rotation, translation), scale


def is_rotation_known(truth: PoseTrajectory3D, alignment: str, residual_m: float) -> bool:
    """True if the alignment finds the rotation: its positions are spread by more than their errors about every axis that is fitted."""
    if alignment in ("none", "first"):
        return True
    sigmas = np.sort(np.sqrt(np.linalg.eigvalsh(np.cov(truth.positions_xyz.T)).clip(0)))[::-1]
    return bool(sigmas[1] > TELLING * residual_m)


def ate_m(estimate: PoseTrajectory3D, truth: PoseTrajectory3D) -> float:
    """Root mean square position error after SE(3) alignment, as `evo_ape --align`."""
    moved = PoseTrajectory3D(estimate.positions_xyz, estimate.orientations_quat_wxyz, estimate.timestamps)
    moved.align(truth)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, moved))
    return error.get_statistic(metrics.StatisticsType.rmse)


def motion(trajectory: PoseTrajectory3D, stamps_s: np.ndarray, span_s: float = 0.1) -> np.ndarray:
    """Speed and rate of turn about the stamps: the same in every frame. NaN beyond the trajectory."""
    before, after = (interpolated(trajectory, stamps_s + sign * span_s / 2) for sign in (-1, 1))
    speed = np.linalg.norm(after.positions_xyz - before.positions_xyz, axis=1)
    rate = (rotations(before).inv() * rotations(after)).magnitude()
    values = np.stack([speed, rate], axis=1) / span_s
    inside = (stamps_s >= trajectory.timestamps[0]) & (stamps_s <= trajectory.timestamps[-1])
    values[~inside] = np.nan
    return values


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Smaller of the correlations of speeds and rates where both are known; -1 where they share less than half."""
    both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if both.sum() < 0.5 * min(np.isfinite(a[:, 0]).sum(), np.isfinite(b[:, 0]).sum()) or both.sum() < 10:
        return -1.0
    return min(np.corrcoef(a[both, k], b[both, k])[0, 1] for k in range(2))


def time_offset(estimate: PoseTrajectory3D, truth: PoseTrajectory3D) -> float:
    """Addition to the stamps of the estimate at which its motion is that of the truth, s."""
    step_s = 0.05
    grids = [np.arange(t.timestamps[0], t.timestamps[-1], step_s) for t in (estimate, truth)]
    if min(len(grid) for grid in grids) < 20:
        raise LabError("--time-offset auto: a trajectory is shorter than a second")
    a, b = (motion(t, grid) for t, grid in zip((estimate, truth), grids))
    # Correlation of both motions at every lag, normalized so that neither speed nor rate rules.
    scores = sum(signal.correlate(normal(b[:, k]), normal(a[:, k])) for k in range(2))
    lags = signal.correlation_lags(len(b), len(a))
    peaks = signal.find_peaks(scores)[0]
    peaks = peaks[np.argsort(scores[peaks])[::-1][:20]]
    base = grids[1][0] - grids[0][0]
    score = lambda offset: correlation(motion(estimate, grids[1] - offset), b)  # noqa: E731
    offset = max((base + lag * step_s for lag in lags[peaks]), key=score)
    for finer_s in (0.01, 0.002, 0.0004):
        offset = max(offset + finer_s * np.arange(-6, 7), key=score)
    if score(offset) < 0.7:
        raise LabError(f"--time-offset auto: the motions agree at no offset (best correlation {score(offset):.2f}); is it the same flight?")
    return float(offset)


def normal(values: np.ndarray) -> np.ndarray:
    return np.nan_to_num((values - np.nanmean(values)) / max(np.nanstd(values), 1e-9))
