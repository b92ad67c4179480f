"""Trajectories and their errors."""

import json
import os
from dataclasses import dataclass
from typing import Any, Dict, Optional, Tuple, Union

import numpy as np

from plumbline import _native
from plumbline._arguments import rows
from plumbline.arrays import Estimates, Floats, Odometries, Poses
from plumbline.errors import ArgumentError, ArgumentTypeError
from plumbline.flights import Path, Replay

Trajectory = Union[Path, Poses, Estimates, Odometries, Replay, Tuple[Any, Any, Any]]


@dataclass(frozen=True)
class Statistics:
    """Statistics of an error, in its unit."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float
    """Sum of the squares."""
    count: int
    """Number of errors."""


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """Errors of a trajectory: the figures of `plumbline evaluate`, and of evo for the same poses."""

    ate_m: Statistics
    """Absolute errors of position after alignment, m."""
    ate_rotation_deg: Optional[Statistics]
    """Absolute errors of rotation after alignment, degrees; ``None`` if the motion does not tell them."""
    rpe_m: Optional[Statistics]
    """Relative errors of position, m; ``None`` if no poses are that far apart."""
    rpe_deg: Optional[Statistics]
    """Relative errors of rotation, degrees; ``None`` if no poses are that far apart."""
    rotation: Floats
    """Alignment: rotation from the frame of the estimate to that of the truth, shape (3, 3)."""
    translation: Floats
    """Alignment: translation, m, shape (3,)."""
    scale: float
    """Alignment: scale."""
    figures: Dict[str, Any]
    """All figures by the names of `plumbline evaluate --json`."""

    def align(self, position: Any) -> Floats:
        """Positions of the estimate in the frame of the truth. position: m, shape (3,) or (N, 3)."""
        aligned: Floats = self.scale * np.asarray(position, dtype=np.float64) @ self.rotation.T + self.translation
        return aligned

    def __repr__(self) -> str:
        return f"<plumbline.Evaluation ATE {self.ate_m.rmse:.4f} m over {self.figures['path_length_m']:.1f} m>"


def read_trajectory(path: Path) -> Poses:
    """Reads a trajectory: a TUM file (plain or .gz), a EuRoC ground truth table, or the ground truth of a EuRoC data set."""
    return Poses._of(_native.read_trajectory(path))


def _arrays(trajectory: Trajectory, name: str) -> Tuple[Any, Any, Any]:
    if isinstance(trajectory, Replay):
        trajectory = trajectory.estimates
    elif isinstance(trajectory, (str, os.PathLike)):
        trajectory = read_trajectory(trajectory)
    if isinstance(trajectory, (Poses, Estimates, Odometries)):
        trajectory = trajectory.stamp_ns, trajectory.position, trajectory.orientation
    if not (isinstance(trajectory, tuple) and len(trajectory) == 3):
        raise ArgumentTypeError(
            f"{name}: expected a path, Poses, Estimates, Odometries, a Replay, or a tuple of stamps, positions and quaternions, "
            f"got {type(trajectory).__name__}"
        )
    stamps, *numbers = rows(list(zip(trajectory, ("stamp_ns", "position", "orientation"), (None, 3, 4))))
    position, orientation = (np.frombuffer(column).reshape(-1, width) for column, width in zip(numbers, (3, 4)))
    known = ~(np.isnan(position).all(axis=1) & np.isnan(orientation).all(axis=1))
    lengths = np.linalg.norm(orientation, axis=1)
    # A quaternion printed with three decimals is still normal to this.
    for row in np.flatnonzero(known & (np.abs(lengths - 1.0) > 0.01)):
        raise ArgumentError(f"orientation {row}: a quaternion x y z w has length 1, this one {lengths[row]}")
    return np.frombuffer(stamps, np.int64)[known], position[known], orientation[known]


def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    align: str = "se3",
    delta_frames: int = 1,
    delta_m: Optional[float] = None,
    all_pairs: bool = False,
    max_difference_s: float = 0.01,
    time_offset: float = 0.0,
) -> Evaluation:
    """Compares a trajectory with its ground truth.

    estimate, truth: each a file, `Poses`, `Estimates`, `Odometries`, a `Replay`, or a tuple of stamps (integer ns, shape (N,)),
        positions (m, shape (N, 3)) and quaternions x y z w (shape (N, 4)). Rows of NaN count as missing.
    align: freedom of the alignment: "none", "origin", "yaw", "se3" or "sim3".
    delta_frames, delta_m, all_pairs: distance of relative errors in frames or m, and whether they begin at each pose.
    max_difference_s: largest difference of the stamps of a pair, s.
    time_offset: what is added to the stamps of the estimate, s.

    Raises `DataError` if the two have too little in common.
    """
    if not isinstance(time_offset, (int, float)):
        raise ArgumentTypeError(f"time_offset: expected a number of seconds, got {time_offset!r}")
    if not np.isfinite(time_offset):
        raise ArgumentError(f"time_offset: expected a number of seconds, got {time_offset}")
    options = {
        "align": align,
        "delta_frames": delta_frames,
        "delta_m": delta_m,
        "all_pairs": all_pairs,
        "max_difference_s": max_difference_s,
        "time_offset_s": time_offset,
    }
    values = _native.evaluate(_arrays(estimate, "estimate"), _arrays(truth, "truth"), options)
    figures = json.loads(values["figures"])
    rpe = figures["rpe"] or {}
    return Evaluation(
        ate_m=Statistics(**figures["ate_m"]),
        ate_rotation_deg=_statistics(figures["ate_rotation_deg"]),
        rpe_m=_statistics(rpe.get("translation_m")),
        rpe_deg=_statistics(rpe.get("rotation_deg")),
        rotation=values["rotation"],
        translation=values["translation"],
        scale=values["scale"],
        figures=figures,
    )


def _statistics(figures: Optional[Dict[str, float]]) -> Optional[Statistics]:
    return None if figures is None else Statistics(**figures)
