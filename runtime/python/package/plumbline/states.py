"""States of an estimator one at a time: at a frame, at an inertial sample, at an instant that was asked for."""

from typing import Any, Dict, List, Mapping

import numpy as np

from plumbline._native import health_bits
from plumbline.arrays import STATES, Floats


class _State:
    """State of the body. `O` is the odometry frame: z up along gravity, origin at the first pose. `B` is the body, the frame of the
    IMU."""

    __slots__ = ("_columns",)

    def __init__(self, columns: Mapping[str, Any]) -> None:
        self._columns = columns

    def _array(self, name: str) -> Floats:
        row: Floats = self._columns[name][0].copy()
        return row

    def __repr__(self) -> str:
        place = ", ".join(f"{number:.3f}" for number in self.position)
        return f"<plumbline.{type(self).__name__} at {self.stamp_ns} ns: {self.state}, position [{place}] m>"

    @property
    def stamp_ns(self) -> int:
        """Time of the state on the clock of the IMU, ns."""
        return int(self._columns["stamp_ns"][0])

    @property
    def state(self) -> str:
        """"initialising", "tracking", "blind" (IMU alone) or "failed"."""
        return STATES[self._columns["state"][0]]

    @property
    def position(self) -> Floats:
        """Position of B in O, m, shape (3,)."""
        return self._array("position")

    @property
    def orientation(self) -> Floats:
        """Rotation that takes coordinates from B to O: quaternion x y z w, shape (4,)."""
        return self._array("orientation")

    @property
    def velocity(self) -> Floats:
        """Velocity of B in O, m/s, shape (3,)."""
        return self._array("velocity")

    @property
    def covariance(self) -> Floats:
        """Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (9, 9)."""
        return self._array("covariance")

    @property
    def quality(self) -> int:
        """Quality from 0 to 100; -1 if the estimator failed."""
        return int(self._columns["quality"][0])

    @property
    def reset_counter(self) -> int:
        """Number of resets so far: the pose may jump where it changes."""
        return int(self._columns["reset_counter"][0])

    def matrix(self) -> Floats:
        """Pose of B in O as a matrix, shape (4, 4), m."""
        x, y, z, w = self.orientation
        pose = np.eye(4)
        pose[:3, 3] = self.position
        pose[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        return pose


class Estimate(_State):
    """Estimate at the time of one frame. `O` is the odometry frame: z up along gravity, origin at the first pose. `B` is the
    body, the frame of the IMU."""

    __slots__ = ()

    @property
    def frame(self) -> int:
        """Sequence number of the frame."""
        return int(self._columns["frame"][0])

    @property
    def has_pose(self) -> bool:
        """True if pose, velocity, biases and covariance are valid."""
        return self.state in ("tracking", "blind")

    @property
    def gyro_bias(self) -> Floats:
        """Bias of the gyroscope, rad/s, shape (3,)."""
        return self._array("gyro_bias")

    @property
    def accel_bias(self) -> Floats:
        """Bias of the accelerometer, m/s^2, shape (3,)."""
        return self._array("accel_bias")

    @property
    def bias_variances(self) -> Floats:
        """Variances of the biases: gyroscope (0:3, rad^2/s^2) and accelerometer (3:6, m^2/s^4), shape (6,)."""
        return self._array("bias_variances")

    @property
    def camera_position(self) -> Floats:
        """Position of the left camera in B, refined online, m, shape (3,)."""
        return self._array("camera_position")

    @property
    def camera_orientation(self) -> Floats:
        """Rotation that takes coordinates from the left camera to B, refined online: quaternion x y z w, shape (4,)."""
        return self._array("camera_orientation")

    @property
    def time_offset_s(self) -> float:
        """Time of the IMU minus time of the cameras, refined online, s."""
        return float(self._columns["time_offset_s"][0])

    @property
    def time_offset_sigma_s(self) -> float:
        """Standard deviation of `time_offset_s`, s."""
        return float(self._columns["time_offset_sigma_s"][0])

    @property
    def health(self) -> int:
        """Errors and warnings: bits of `plumbline.Health`."""
        return int(self._columns["health"][0])

    @property
    def health_names(self) -> List[str]:
        """Names of the bits of `health`."""
        return [name for bit, name in health_bits() if self.health & bit]

    @property
    def figures(self) -> Dict[str, int]:
        """Counts of the frame by name: points, lines, landmarks, iterations."""
        return {name: int(column[0]) for name, column in self._columns["figures"].items()}


class Odometry(_State):
    """State carried forward to an inertial sample, at the rate of the IMU. Frames as in `Estimate`."""

    __slots__ = ()

    @property
    def sequence(self) -> int:
        """Count of odometry outputs."""
        return int(self._columns["sequence"][0])

    @property
    def has_pose(self) -> bool:
        """True if pose, velocity and covariance are valid."""
        return self.state in ("tracking", "blind")

    @property
    def angular_rate(self) -> Floats:
        """Angular rate of B in B, bias removed, rad/s, shape (3,)."""
        return self._array("angular_rate")

    @property
    def jumps(self) -> int:
        """Number of steps within the same odometry frame so far: corrections that were too large to enter bit by bit."""
        return int(self._columns["jumps"][0])


class Instant(_State):
    """State at an instant that was asked for. Frames as in `Estimate`."""

    __slots__ = ()

    @property
    def estimated_ns(self) -> int:
        """Time of the estimate before it, ns."""
        return int(self._columns["estimated"][0])

    @property
    def settled(self) -> bool:
        """True if there is an estimate after it too: the answer would not change any more."""
        return bool(self._columns["is_settled"][0])

    @property
    def angular_rate(self) -> Floats:
        """Angular rate of B in B, bias removed, rad/s, shape (3,)."""
        return self._array("angular_rate")
