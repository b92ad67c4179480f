"""Values of a whole flight as arrays, one row a frame, an inertial sample or a pose."""

from dataclasses import dataclass, fields
from typing import Any, Dict, Iterator, Mapping, Tuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

#: Names of the states of an estimator.
STATES: Tuple[str, ...] = ("initialising", "tracking", "blind", "failed")

_T = TypeVar("_T", bound="_Rows")


@dataclass(frozen=True, eq=False)
class _Rows:
    """Arrays with one row each for the same things."""

    stamp_ns: Stamps
    """Time, ns, shape (N,)."""

    @classmethod
    def _of(cls: "type[_T]", columns: Mapping[str, Any]) -> _T:
        values: Dict[str, Any] = dict(columns)
        if "state" in values:
            values["state"] = np.array(STATES)[values["state"]]
        return cls(**values)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def __repr__(self) -> str:
        names = ", ".join(field.name for field in fields(self))
        return f"<plumbline.{type(self).__name__} {len(self)} rows: {names}>"

    @property
    def seconds(self) -> Floats:
        """Time since the first row, s, shape (N,)."""
        if len(self) == 0:
            return np.empty(0)
        since: Floats = (self.stamp_ns - self.stamp_ns[0]) * 1e-9
        return since


@dataclass(frozen=True, eq=False, repr=False)
class Poses(_Rows):
    """Poses of the body."""

    position: Floats
    """Position, m, shape (N, 3)."""
    orientation: Floats
    """Rotation from the body: quaternions x y z w, shape (N, 4)."""

    def save_tum(self, path: str) -> None:
        """Writes the poses as a TUM file: ``t x y z qx qy qz qw``."""
        with open(path, "w", encoding="ascii") as file:
            for stamp, position, orientation in self._rows():
                numbers = " ".join(f"{number:.9f}" for number in (*position, *orientation))
                file.write(f"{stamp // 10**9}.{stamp % 10**9:09d} {numbers}\n")

    def _rows(self) -> "Iterator[Tuple[int, Floats, Floats]]":
        for stamp, position, orientation in zip(self.stamp_ns, self.position, self.orientation):
            yield int(stamp), position, orientation


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(_Rows):
    """Estimates, one row a frame. Real numbers are NaN in a row without a pose (`has_pose`)."""

    frame: "NDArray[np.uint64]"
    """Sequence number of the frame, shape (N,)."""
    state: "NDArray[np.str_]"
    """"initialising", "tracking", "blind" (IMU alone) or "failed", shape (N,)."""
    has_pose: "NDArray[np.bool_]"
    """True where the row has a pose, shape (N,)."""
    quality: "NDArray[np.int8]"
    """Quality from 0 to 100; -1 if the estimator failed, shape (N,)."""
    health: "NDArray[np.uint32]"
    """Bits of `plumbline.Health`, shape (N,)."""
    reset_counter: "NDArray[np.uint32]"
    """Number of resets so far: the pose may jump where it changes, shape (N,)."""
    position: Floats
    """Position of B in O, m, shape (N, 3)."""
    orientation: Floats
    """Rotation from B to O: quaternions x y z w, shape (N, 4)."""
    velocity: Floats
    """Velocity of B in O, m/s, shape (N, 3)."""
    gyro_bias: Floats
    """Bias of the gyroscope, rad/s, shape (N, 3)."""
    accel_bias: Floats
    """Bias of the accelerometer, m/s^2, shape (N, 3)."""
    covariance: Floats
    """Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (N, 9, 9)."""
    bias_variances: Floats
    """Variances of the biases: gyroscope (0:3, rad^2/s^2) and accelerometer (3:6, m^2/s^4), shape (N, 6)."""
    time_offset_s: Floats
    """Time of the IMU minus time of the cameras, refined online, s, shape (N,)."""
    time_offset_sigma_s: Floats
    """Standard deviation of `time_offset_s`, s, shape (N,)."""
    camera_position: Floats
    """Position of the left camera in B, refined online, m, shape (N, 3)."""
    camera_orientation: Floats
    """Rotation from the left camera to B, refined online: quaternions x y z w, shape (N, 4)."""
    figures: "Dict[str, NDArray[np.uint32]]"
    """Counts of the frames by name (points, lines, landmarks, iterations), each of shape (N,)."""

    def poses(self) -> Poses:
        """The rows that have a pose, as poses."""
        rows = self.has_pose
        return Poses(self.stamp_ns[rows], self.position[rows], self.orientation[rows])


@dataclass(frozen=True, eq=False, repr=False)
class Odometries(_Rows):
    """Odometry at the rate of the IMU, one row a sample. Real numbers are NaN in a row without a pose (`has_pose`)."""

    sequence: "NDArray[np.uint64]"
    """Count of odometry outputs, shape (N,)."""
    state: "NDArray[np.str_]"
    """State of the estimate that it rests on, shape (N,)."""
    has_pose: "NDArray[np.bool_]"
    """True where the row has a pose, shape (N,)."""
    quality: "NDArray[np.int8]"
    """Quality of the estimate that it rests on, shape (N,)."""
    reset_counter: "NDArray[np.uint32]"
    """Number of resets so far, shape (N,)."""
    jumps: "NDArray[np.uint32]"
    """Number of steps within the same odometry frame so far, shape (N,)."""
    position: Floats
    """Position of B in O, m, shape (N, 3)."""
    orientation: Floats
    """Rotation from B to O: quaternions x y z w, shape (N, 4)."""
    velocity: Floats
    """Velocity of B in O, m/s, shape (N, 3)."""
    angular_rate: Floats
    """Angular rate of B in B, bias removed, rad/s, shape (N, 3)."""
    covariance: Floats
    """Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (N, 9, 9)."""

    def poses(self) -> Poses:
        """The rows that have a pose, as poses."""
        rows = self.has_pose
        return Poses(self.stamp_ns[rows], self.position[rows], self.orientation[rows])


@dataclass(frozen=True, eq=False, repr=False)
class Imu(_Rows):
    """Inertial samples."""

    gyro: Floats
    """Angular rate of B, rad/s, shape (N, 3)."""
    accel: Floats
    """Specific force on B, m/s^2, shape (N, 3)."""


@dataclass(frozen=True, eq=False, repr=False)
class MapPoses(_Rows):
    """Pose of the odometry frame O in the map M, one row a frame; NaN while it is not known."""

    frame: "NDArray[np.uint64]"
    """Sequence number of the frame, shape (N,)."""
    position: Floats
    """Position of O in M, m, shape (N, 3)."""
    orientation: Floats
    """Rotation from O to M: quaternions x y z w, shape (N, 4)."""
    reset_counter: "NDArray[np.uint32]"
    """Number of resets so far, shape (N,)."""
    keyframes: "NDArray[np.uint32]"
    """Keyframes of the map, shape (N,)."""
    sightings: "NDArray[np.uint32]"
    """Places seen again so far, shape (N,)."""
    loops_used: "NDArray[np.uint32]"
    """Loops that count, shape (N,)."""
