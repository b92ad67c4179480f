"""Exceptions of Plumbline. Each derives from `PlumblineError` and from the built-in exception of its kind."""

from typing import Iterable, NamedTuple, Optional, Tuple

__all__ = [
    "ArgumentError",
    "ArgumentTypeError",
    "BusyError",
    "ConfigError",
    "ConnectionLost",
    "DataError",
    "DataWarning",
    "OutOfOrderError",
    "PlumblineError",
    "RunError",
    "SampleError",
    "Violation",
]


class PlumblineError(Exception):
    """Base class of every exception of this package."""


class Violation(NamedTuple):
    """One refused key of a configuration."""

    key: str
    """Path of the key, such as ``camera[1].pose_b_c``."""
    line: Optional[int]
    """Line of the file, from 1; ``None`` if the value does not come from a file."""
    reason: str
    """Defect of the value."""
    cure: str
    """Cure."""


class ConfigError(PlumblineError, ValueError):
    """A configuration is refused. The message is that of the command line: file, key, reason and cure."""

    violations: Tuple[Violation, ...] = ()
    """Every refused key; empty if the text is not TOML or the file cannot be read."""


class ArgumentError(PlumblineError, ValueError):
    """An argument has a wrong value, shape or memory layout."""


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument has a wrong type or dtype."""


class SampleError(PlumblineError, ValueError):
    """The estimator refused an inertial sample or a frame. It counts the sample as refused, and goes on."""

    reason: str = ""
    """``"not later"``, ``"far ahead"``, ``"not finite"`` or ``"out of range"``."""
    index: Optional[int] = None
    """Index of the sample in the arrays of `Estimator.add_imu_array`, whose samples before it were accepted."""


class OutOfOrderError(SampleError):
    """The stamp of a sample or frame is not later than that of the one before."""


class BusyError(PlumblineError, RuntimeError):
    """Another thread is in a call of the same object."""


class DataError(PlumblineError, ValueError):
    """A recording, flight log or trajectory cannot be read or used."""


class RunError(PlumblineError, RuntimeError):
    """A flight ended by a fault, or found no pose at all."""


class ConnectionLost(PlumblineError, ConnectionError):
    """The local socket of a flight cannot be reached, or the flight has closed it."""


class DataWarning(UserWarning):
    """Something cannot be right with the data or the calibration of a flight."""


_REFUSALS = {
    "NotLater": ("not later", "its stamp is not later than that of the newest sample"),
    "FarAhead": ("far ahead", "its stamp is far ahead of the newest sample; are all stamps nanoseconds of one clock?"),
    "NotFinite": ("not finite", "a component is NaN or infinite"),
    "OutOfRange": ("out of range", "a component is far beyond the range of the sensor; give rad/s and m/s^2"),
}


def of_sample(admission: str, stamp_ns: int, index: Optional[int]) -> SampleError:
    """Inertial sample that the estimator refused; `index` is its place in an array."""
    reason, words = _REFUSALS[admission]
    place = "" if index is None else f" {index}"
    kind = OutOfOrderError if admission == "NotLater" else SampleError
    error = kind(f"inertial sample{place} of {stamp_ns} ns refused: {words}")
    error.reason, error.index = reason, index
    return error


def of_frame(stamp_ns: int) -> OutOfOrderError:
    """Frame whose stamp the estimator refused."""
    error = OutOfOrderError(
        f"frame of {stamp_ns} ns refused: its stamp does not follow those before; give nanoseconds of one clock, in order"
    )
    error.reason = "not later"
    return error


def of_config(message: str, violations: Iterable[Tuple[str, Optional[int], str, str]]) -> ConfigError:
    """Configuration that is refused, with each refused key."""
    error = ConfigError(message)
    error.violations = tuple(Violation(*violation) for violation in violations)
    return error
