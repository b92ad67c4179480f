"""Deterministic stereo visual-inertial odometry.

- `Estimator`: inertial samples and images in, estimates out, for a program of one's own.
- `replay`: a whole recording or simulated flight, as arrays and figures; `open_recording`: its samples one by one.
- `read_log`: the arrays of a flight log. `read_trajectory`, `evaluate`: trajectories and their errors.
- `connect`: odometry and estimates of a flight on the same computer, while it flies.
- `Config`: the configuration of a vehicle, validated.

Units are SI: m, s, rad. Stamps are integer nanoseconds. Quaternions are Hamilton, in the order x y z w. `O` is the odometry frame
(z up along gravity, origin at the first pose), `B` the body, which is the frame of the IMU, `M` the map. A pose of `B` in `O` takes
coordinates from `B` to `O`.
"""

# What stands above the imports is needed by them.
# ruff: noqa: E402
from pkgutil import extend_path as _extend_path

# Beside it may lie what protoc makes of the schemas: `plumbline.v1`.
__path__ = _extend_path(__path__, __name__)

from plumbline._processor import check as _check_processor

# Before the native module is loaded, whose instructions an older processor lacks.
_check_processor()

from plumbline._native import VERSION as __version__
from plumbline._native import Config, Estimator
from plumbline.arrays import Estimates, Imu, MapPoses, Odometries, Poses
from plumbline.errors import (
    ArgumentError,
    ArgumentTypeError,
    BusyError,
    ConfigError,
    ConnectionLost,
    DataError,
    DataWarning,
    OutOfOrderError,
    PlumblineError,
    RunError,
    SampleError,
    Violation,
)
from plumbline.evaluation import Evaluation, Statistics, evaluate, read_trajectory
from plumbline.flights import Event, Frame, Log, Recording, Replay, open_recording, read_log, replay
from plumbline.health import Health
from plumbline.live import Connection, connect
from plumbline.states import Estimate, Instant, Odometry

__all__ = [
    "ArgumentError",
    "ArgumentTypeError",
    "BusyError",
    "Config",
    "ConfigError",
    "Connection",
    "ConnectionLost",
    "DataError",
    "DataWarning",
    "Estimate",
    "Estimates",
    "Estimator",
    "Evaluation",
    "Event",
    "Frame",
    "Health",
    "Imu",
    "Instant",
    "Log",
    "MapPoses",
    "Odometries",
    "Odometry",
    "OutOfOrderError",
    "PlumblineError",
    "Poses",
    "Recording",
    "Replay",
    "RunError",
    "SampleError",
    "Statistics",
    "Violation",
    "__version__",
    "connect",
    "evaluate",
    "open_recording",
    "read_log",
    "read_trajectory",
    "replay",
]
