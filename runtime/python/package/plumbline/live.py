"""A flight on the same computer, while it flies."""

from types import TracebackType
from typing import Iterator, Optional, Type, Union

from plumbline import _native
from plumbline.flights import Path
from plumbline.states import Estimate, Instant, Odometry


class Connection:
    """Connection to the local socket of a flight; `connect` makes one. Iterate over it for odometry and estimates, in the order in
    which the flight sends them, until the flight ends. A reader that is too slow loses the oldest (`losses`)."""

    def __init__(self, native: "_native.Connection") -> None:
        self._native = native
        self._losses = 0

    @property
    def losses(self) -> int:
        """Number of records that this connection has lost so far."""
        return self._losses

    @property
    def may_command(self) -> bool:
        """True if the flight takes commands of this program's user."""
        return self._native.may_command

    def __iter__(self) -> Iterator[Union[Odometry, Estimate]]:
        while True:
            came = self._native.next(None, self._losses)
            if came is None:
                return
            record, self._losses = came
            if record is not None:
                yield record

    def next(self, timeout_s: float) -> Union[Odometry, Estimate, None]:
        """Waits for the next odometry or estimate. Returns ``None`` if none comes within `timeout_s`, s, or the flight has
        ended."""
        came = self._native.next(timeout_s, self._losses)
        if came is None:
            return None
        record, self._losses = came
        return record

    def at(self, stamp_ns: int, *, patience_s: float = 0.1, settled: bool = False) -> Instant:
        """State at an instant of the last three seconds, such as that of a camera's trigger, by the clock of the odometry.

        The flight waits at most `patience_s`, s (up to 2), for its inertial samples to reach the instant; with `settled`, for the
        estimate after it too, from when on the answer stays the same. Raises `RunError` where there is no state, with the reason.
        """
        return self._native.at(stamp_ns, patience_s, settled)

    def reset(self, kind: str = "soft", *, timeout_s: float = 2.0) -> str:
        """Resets the estimator of the flight, and returns its answer. "soft" keeps the pose, "hard" begins at the origin.

        Raises `RunError` if the flight refuses, `ConnectionLost` if no answer comes within `timeout_s`, s (at most 10).
        """
        return self._native.reset(kind, timeout_s)

    def close(self) -> None:
        """Closes the connection."""
        self._native.close()

    def __enter__(self) -> "Connection":
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        traceback: Optional[TracebackType],
    ) -> None:
        self.close()


def connect(path: Path, *, patience_s: float = 0.0, odometry: bool = True, estimates: bool = True) -> Connection:
    """Connects to a flight on this computer: ``local.path`` in its configuration.

    path: path of the socket. patience_s: how long to wait for the socket to appear, s. odometry: receive odometry at the rate of
    the IMU. estimates: receive the estimate of each frame.

    Raises `ConnectionLost` if no flight listens there, and later if the flight closes the connection.
    """
    return Connection(_native.Connection(path, patience_s, odometry, estimates))
