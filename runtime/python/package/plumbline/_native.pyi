"""Native part of the package."""

import os
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = Union[str, "os.PathLike[str]"]
_Floats = NDArray[np.float64]
_Image = NDArray[np.uint8]

__all__ = [
    "Config",
    "Connection",
    "Estimate",
    "Estimator",
    "Instant",
    "Odometry",
    "Recording",
    "VERSION",
    "evaluate",
    "health_bits",
    "read_log",
    "read_trajectory",
    "replay",
]

VERSION: str

def health_bits() -> List[Tuple[int, str]]: ...
def replay(dataset: _Path, config: Union[Config, _Path, None], options: Dict[str, Any], keep: Dict[str, Any]) -> Dict[str, Any]: ...
def read_log(path: _Path) -> Dict[str, Any]: ...
def read_trajectory(path: _Path) -> Dict[str, Any]: ...
def evaluate(estimate: Tuple[Any, Any, Any], truth: Tuple[Any, Any, Any], options: Dict[str, Any]) -> Dict[str, Any]: ...
@final
class Config:
    """Configuration of a vehicle, proven valid: calibration, sensors, estimator. It does not change."""

    @staticmethod
    def load(path: _Path) -> Config:
        """Reads a configuration file (TOML)."""
    @staticmethod
    def from_toml(text: str, origin: str = "configuration") -> Config:
        """Parses the text of a configuration file. `origin` names it in messages."""
    @staticmethod
    def preset(name: str) -> Config:
        """Configuration that ships with Plumbline: one of `Config.presets()`."""
    @staticmethod
    def presets() -> Tuple[str, ...]:
        """Names of all presets."""
    @staticmethod
    def from_euroc(folder: _Path) -> Config:
        """Preset `euroc` with the calibration of a EuRoC data set."""
    def replace(self, **changes: Any) -> Config:
        """Configuration with keys changed: `estimator__points__max_points=200`, or `**{"estimator.points.max_points": 200}`."""
    def to_toml(self) -> str:
        """The whole configuration as TOML, defaults included."""
    def doubts(self) -> List[str]:
        """Doubts: settings that are valid, and yet probably a mistake, as sentences."""
    @property
    def hash(self) -> str:
        """SHA-256 of the configuration, as reports and flight logs state it."""
    @property
    def image_sizes(self) -> List[Tuple[int, int]]:
        """Size of each camera's images: (width, height), px."""
    @property
    def rates_hz(self) -> Tuple[float, float]:
        """Rates of cameras and IMU, Hz."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> Any: ...

@final
class Estimate:
    """Estimate at the time of one frame. `O` is the odometry frame: z up along gravity, origin at the first pose. `B` is the
    body, the frame of the IMU."""

    @property
    def frame(self) -> int:
        """Sequence number of the frame."""
    @property
    def stamp_ns(self) -> int:
        """Time of the state on the clock of the IMU, ns."""
    @property
    def state(self) -> str:
        """"initialising", "tracking", "blind" (IMU alone) or "failed"."""
    @property
    def has_pose(self) -> bool:
        """True if pose, velocity, biases and covariance are valid."""
    @property
    def position(self) -> _Floats:
        """Position of B in O, m, shape (3,)."""
    @property
    def orientation(self) -> _Floats:
        """Rotation that takes coordinates from B to O: quaternion x y z w, shape (4,)."""
    @property
    def velocity(self) -> _Floats:
        """Velocity of B in O, m/s, shape (3,)."""
    @property
    def gyro_bias(self) -> _Floats:
        """Bias of the gyroscope, rad/s, shape (3,)."""
    @property
    def accel_bias(self) -> _Floats:
        """Bias of the accelerometer, m/s^2, shape (3,)."""
    @property
    def covariance(self) -> _Floats:
        """Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (9, 9)."""
    @property
    def bias_variances(self) -> _Floats:
        """Variances of the biases: gyroscope (0:3, rad^2/s^2) and accelerometer (3:6, m^2/s^4), shape (6,)."""
    @property
    def camera_position(self) -> _Floats:
        """Position of the left camera in B, refined online, m, shape (3,)."""
    @property
    def camera_orientation(self) -> _Floats:
        """Rotation that takes coordinates from the left camera to B, refined online: quaternion x y z w, shape (4,)."""
    @property
    def time_offset_s(self) -> float:
        """Time of the IMU minus time of the cameras, refined online, s."""
    @property
    def time_offset_sigma_s(self) -> float:
        """Standard deviation of `time_offset_s`, s."""
    @property
    def quality(self) -> int:
        """Quality from 0 to 100; -1 if the estimator failed."""
    @property
    def health(self) -> int:
        """Errors and warnings: bits of `plumbline.Health`."""
    @property
    def health_names(self) -> List[str]:
        """Names of the bits of `health`."""
    @property
    def reset_counter(self) -> int:
        """Number of resets so far: the pose may jump where it changes."""
    @property
    def figures(self) -> Dict[str, int]:
        """Counts of the frame by name: points, lines, landmarks, iterations."""
    def matrix(self) -> _Floats:
        """Pose of B in O as a matrix, shape (4, 4), m."""

@final
class Odometry:
    """State carried forward to an inertial sample, at the rate of the IMU. Frames as in `Estimate`."""

    @property
    def sequence(self) -> int:
        """Count of odometry outputs."""
    @property
    def stamp_ns(self) -> int:
        """Time of the state on the clock of the IMU, ns."""
    @property
    def state(self) -> str:
        """"initialising", "tracking", "blind" (IMU alone) or "failed"."""
    @property
    def has_pose(self) -> bool:
        """True if pose, velocity and covariance are valid."""
    @property
    def position(self) -> _Floats:
        """Position of B in O, m, shape (3,)."""
    @property
    def orientation(self) -> _Floats:
        """Rotation that takes coordinates from B to O: quaternion x y z w, shape (4,)."""
    @property
    def velocity(self) -> _Floats:
        """Velocity of B in O, m/s, shape (3,)."""
    @property
    def angular_rate(self) -> _Floats:
        """Angular rate of B in B, bias removed, rad/s, shape (3,)."""
    @property
    def covariance(self) -> _Floats:
        """Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (9, 9)."""
    @property
    def quality(self) -> int:
        """Quality from 0 to 100; -1 if the estimator failed."""
    @property
    def reset_counter(self) -> int:
        """Number of resets so far: the pose may jump where it changes."""
    @property
    def jumps(self) -> int:
        """Number of steps within the same odometry frame so far: corrections that were too large to enter bit by bit."""
    def matrix(self) -> _Floats:
        """Pose of B in O as a matrix, shape (4, 4), m."""

@final
class Instant:
    """State at an instant that was asked for. Frames as in `Estimate`."""

    @property
    def stamp_ns(self) -> int:
        """Time of the state on the clock of the IMU, ns."""
    @property
    def estimated_ns(self) -> int:
        """Time of the estimate before it, ns."""
    @property
    def settled(self) -> bool:
        """True if there is an estimate after it too: the answer would not change any more."""
    @property
    def state(self) -> str:
        """"initialising", "tracking", "blind" (IMU alone) or "failed"."""
    @property
    def position(self) -> _Floats:
        """Position of B in O, m, shape (3,)."""
    @property
    def orientation(self) -> _Floats:
        """Rotation that takes coordinates from B to O: quaternion x y z w, shape (4,)."""
    @property
    def velocity(self) -> _Floats:
        """Velocity of B in O, m/s, shape (3,)."""
    @property
    def angular_rate(self) -> _Floats:
        """Angular rate of B in B, bias removed, rad/s, shape (3,)."""
    @property
    def covariance(self) -> _Floats:
        """Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (9, 9)."""
    @property
    def quality(self) -> int:
        """Quality from 0 to 100; -1 if the estimator failed."""
    @property
    def reset_counter(self) -> int:
        """Number of resets so far: the pose may jump where it changes."""
    def matrix(self) -> _Floats:
        """Pose of B in O as a matrix, shape (4, 4), m."""

@final
class Estimator:
    """The estimator: a function of its configuration and the ordered list of its inputs. Two runs with the same inputs give the
    same bits.

    `config` is a `Config`, a configuration file, or the name of a preset. Add every inertial sample by `add_imu` or
    `propagate`, in order of time, and a frame by `add_frame` once the samples reach `imu_needed_until` of its stamp. One
    object serves one thread at a time: a call while another thread is in one raises `BusyError`."""

    def __new__(cls, config: Union[Config, _Path]) -> Estimator: ...
    @property
    def config(self) -> Config:
        """Configuration of the estimator."""
    def add_imu(self, stamp_ns: int, gyro: Union[Sequence[float], _Floats], accel: Union[Sequence[float], _Floats]) -> None:
        """Adds an inertial sample.

        stamp_ns: time of measurement, integer ns. gyro: angular rate, rad/s, three numbers. accel: specific force, m/s^2,
        three numbers; at rest it points up with 9.81. Raises `OutOfOrderError` or `SampleError` if the sample is refused."""
    def add_imu_array(self, stamps_ns: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> int:
        """Adds inertial samples in order of time, and returns their number.

        stamps_ns: integers, ns, shape (N,). gyro: rad/s, shape (N, 3). accel: m/s^2, shape (N, 3). Stops at the first sample
        that is refused and raises, with its index in the exception: those before it were added."""
    def propagate(
        self, stamp_ns: int, gyro: Union[Sequence[float], _Floats], accel: Union[Sequence[float], _Floats]
    ) -> Optional[Odometry]:
        """Adds an inertial sample as `add_imu`, and returns the newest state carried forward to its time: odometry at the rate
        of the IMU. `None` while there is no pose. Use it for every sample or for none."""
    def add_frame(
        self, stamp_ns: int, left: Optional[_Image], right: Optional[_Image] = None, *, sequence: Optional[int] = None
    ) -> Estimate:
        """Adds a frame, and returns the estimate at its time.

        stamp_ns: time of the middle of the exposure by the clock of the cameras, integer ns. left, right: grey images, arrays
        of uint8 of the shape (height, width); `None` for one that did not arrive. Rows may be padded, as those of a crop of a
        larger image. Images are not copied, and the GIL is released: nothing may write to them until the call returns.
        sequence: number of the frame where the camera counts them; without it, one more than the frame before. Raises
        `OutOfOrderError` if the stamp does not follow those before."""
    def imu_needed_until(self, stamp_ns: int) -> int:
        """Time up to which inertial samples must have been added before the frame of that stamp is, ns."""
    def reset(self, kind: str = "soft") -> None:
        """Restarts the estimator before the next frame. "soft": the pose stays, with biases and calibration, and the new start
        continues from them. "hard": the new start begins at the origin."""
    def digest(self) -> str:
        """SHA-256 over the bits of all estimates so far, in hexadecimal: `estimate_digest` of the report of a replay of the same
        inputs."""

@final
class Recording:
    def __new__(cls, dataset: _Path, config: Union[Config, _Path, None], options: Dict[str, Any]) -> Recording: ...
    @property
    def config(self) -> Config: ...
    @property
    def name(self) -> str: ...
    @property
    def findings(self) -> List[str]: ...
    def next_frame(self) -> Optional[Tuple[int, int, Optional[_Image], Optional[_Image]]]: ...
    def imu_until(self, stamp_ns: Optional[int]) -> Dict[str, Any]: ...
    def truth_poses(self, stamps_ns: ArrayLike) -> Dict[str, Any]: ...

@final
class Connection:
    def __new__(cls, path: _Path, patience_s: float, odometry: bool, estimates: bool) -> Connection: ...
    @property
    def may_command(self) -> bool: ...
    def next(self, timeout_s: Optional[float], losses: int) -> Optional[Tuple[Union[Odometry, Estimate, None], int]]: ...
    def at(self, stamp_ns: int, patience_s: float, settled: bool) -> Instant: ...
    def reset(self, kind: str, timeout_s: float) -> str: ...
    def close(self) -> None: ...
