"""Native part of the package."""

import os
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plumbline.states import Estimate, Instant, Odometry

_Path = Union[str, "os.PathLike[str]"]
_Floats = NDArray[np.float64]
_Image = NDArray[np.uint8]

__all__ = [
    "Config",
    "Connection",
    "Estimator",
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
