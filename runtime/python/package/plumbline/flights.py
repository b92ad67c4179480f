"""Whole flights: replays, recordings sample by sample, and flight logs."""

import json
import math
import os
import warnings
from dataclasses import dataclass
from typing import Any, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from plumbline import _native
from plumbline._native import Config
from plumbline.arrays import Estimates, Imu, MapPoses, Odometries, Poses, Stamps
from plumbline.errors import ArgumentError, DataWarning
from plumbline.settings import Setting, changes

Path = Union[str, "os.PathLike[str]"]
Image = NDArray[np.uint8]


class Frame(NamedTuple):
    """A frame of a recording."""

    sequence: int
    """Number of the frame by the count of the cameras."""
    stamp_ns: int
    """Time of the middle of the exposure by the clock of the cameras, ns."""
    left: Optional[Image]
    """Left image, shape (height, width); ``None`` if it is missing."""
    right: Optional[Image]
    """Right image, shape (height, width); ``None`` if it is missing."""


class Event(NamedTuple):
    """An event of a flight log."""

    stamp_ns: int
    """When it happened, ns."""
    level: str
    """"info", "warning" or "error"."""
    text: str
    """Description."""


@dataclass(frozen=True, eq=False, repr=False)
class Replay:
    """A flight that was replayed."""

    name: str
    """Short name of the flight."""
    config: Config
    """Configuration of the estimator."""
    estimates: Estimates
    """Estimates, one row a frame: each as it was known when its frame came."""
    odometry: Optional[Odometries]
    """Odometry at the rate of the IMU, if `replay` was called with ``odometry=True``."""
    map_trajectory: Poses
    """Poses of B in the map M with all loops closed, by all that was known at the end; empty without places."""
    truth: Optional[Poses]
    """True poses, if they are known: as they were measured, or of a simulated flight at each estimate."""
    report: Dict[str, Any]
    """Report of `plumbline replay --report`: accuracy, consistency, times, counts, warnings."""

    @property
    def digest(self) -> str:
        """SHA-256 over the bits of all estimates, in hexadecimal: that of `Estimator.digest`."""
        return str(self.report["estimate_digest"])

    def __repr__(self) -> str:
        poses = int(np.count_nonzero(self.estimates.has_pose))
        return f"<plumbline.Replay {self.name}: {len(self.estimates)} frames, {poses} with a pose>"


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """A flight log, but for its images, which `open_recording` reads."""

    config: Config
    """Configuration of the flight."""
    flight: str
    """Identifier of the flight."""
    estimates: Estimates
    """Estimates, one row a frame."""
    odometry: Odometries
    """Odometry, one row an inertial sample."""
    map: MapPoses
    """Pose of the odometry frame in the map, one row a frame."""
    imu: Imu
    """Inertial samples."""
    frame: "NDArray[np.uint64]"
    """Sequence numbers of the frames, shape (F,)."""
    frame_stamp_ns: Stamps
    """Stamps of the frames by the clock of the cameras, ns, shape (F,)."""
    events: List[Event]
    """Events in the order of the log."""
    ending: str
    """"flight" (complete), "room" (the disk space it may use was full), "truncated" (the recorder was killed) or "damaged"."""
    damage: Optional[str]
    """Description of the damage, behind which nothing was read."""
    dropped: int
    """Number of entries that the recorder dropped."""
    inputs_changed: bool
    """True if an input differs from the recorded one."""

    def __repr__(self) -> str:
        return f"<plumbline.Log of {len(self.estimates)} frames and {len(self.imu)} inertial samples, ending: {self.ending}>"


def _options(
    dataset: Path,
    settings: Mapping[str, Setting],
    start: float,
    duration: Optional[float],
    frames: Optional[Tuple[int, Optional[int]]],
    mono: bool,
    lines: bool,
    loops: bool,
    truth: Optional[Path],
    topics: Optional[Mapping[str, str]],
    path: Path,
    seed: int,
    scale: float,
    laps: int,
    conditions: Sequence[str],
    imu_errors: Sequence[str],
) -> Dict[str, Any]:
    named = dict(topics or {})
    sides = [named.pop(side, None) for side in ("left", "right", "imu", "accel")]
    if named:
        raise ArgumentError(f"topics: expected the keys left, right, imu and accel, got {', '.join(named)}")
    if not (0.0 <= start < math.inf and (duration is None or duration > 0.0)):
        raise ArgumentError(f"start {start} s and duration {duration} s leave nothing: give seconds from the first frame")
    if str(dataset).startswith("sim:") and (frames is not None or truth is not None):
        words = "frames and truth are for recordings; a simulated flight takes start and duration, and knows its truth"
        raise ArgumentError(words)
    first, end = frames if frames is not None else (0, None)
    return {
        "set": changes(settings),
        "start": start,
        "duration": duration,
        "frames": None if frames is None else (first, 2**63 - 1 if end is None else end),
        "mono": mono,
        "lines": lines,
        "loops": loops,
        "truth": None if truth is None else os.fspath(truth),
        "topics": sides,
        "path": os.fspath(path),
        "seed": seed,
        "scale": scale,
        "laps": laps,
        "conditions": list(conditions),
        "imu_errors": list(imu_errors),
    }


def _warn(findings: Iterable[str]) -> None:
    for finding in findings:
        warnings.warn(finding, DataWarning, stacklevel=3)


def replay(
    dataset: Path,
    config: Union[Config, Path, None] = None,
    *,
    odometry: bool = False,
    threads: int = 2,
    record: Optional[Path] = None,
    start: float = 0.0,
    duration: Optional[float] = None,
    frames: Optional[Tuple[int, Optional[int]]] = None,
    mono: bool = False,
    lines: bool = True,
    loops: bool = True,
    truth: Optional[Path] = None,
    topics: Optional[Mapping[str, str]] = None,
    path: Path = "demo",
    seed: int = 1,
    scale: float = 1.0,
    laps: int = 1,
    conditions: Sequence[str] = (),
    imu_errors: Sequence[str] = (),
    **set: Setting,
) -> Replay:
    """Runs the estimator over a recording or a simulated flight, as fast as it goes. `plumbline replay` gives the same bits.

    dataset: a EuRoC data set, a flight log or a ROS 2 bag, or "sim:room", "sim:hall", "sim:low-texture", "sim:far".
    config: a `Config`, a configuration file or a preset. Default: the preset "euroc" with the calibration of the data set, the
        configuration of the log, or the preset "sim". A bag needs one.
    odometry: keep the odometry at the rate of the IMU too (0.2 MB a second of flight).
    threads: from 1 to 8. The result does not depend on it.
    record: flight log to write (.mcap).
    start, duration: part of the flight, s from the first frame. Default: all; of a simulated flight 20 s.
    frames: first frame and end (``None``: the last), counted from 0.
    mono: the left camera alone. lines: use lines. loops: recognize places and close loops.
    truth: file of the ground truth for a data set without one.
    topics: names of the topics of a bag, with the keys left, right, imu and accel (an accelerometer apart).
    path, seed, scale, laps, conditions, imu_errors: of a simulated flight, as the options of `plumbline replay`.
    set: keys of the configuration: ``estimator__points__max_points=200``, or ``**{"estimator.points.max_points": 200}``.

    Raises `ConfigError`, `DataError` or `RunError`. What cannot be right with the data is warned of as `DataWarning`. Ctrl-C ends
    the flight.
    """
    options = _options(
        dataset, set, start, duration, frames, mono, lines, loops, truth, topics, path, seed, scale, laps, conditions, imu_errors
    )
    if not 1 <= threads <= 8:
        raise ArgumentError(f"threads: expected 1 to 8, got {threads}")
    if record is not None and not os.fspath(record).endswith(".mcap"):
        raise ArgumentError(f"{os.fspath(record)}: name the log with the ending .mcap")
    keep = {"threads": threads, "odometry": odometry, "record": None if record is None else os.fspath(record)}
    values = _native.replay(dataset, config, options, keep)
    _warn(values.pop("findings"))
    values["estimates"] = Estimates._of(values["estimates"])
    values["odometry"] = None if values["odometry"] is None else Odometries._of(values["odometry"])
    values["map_trajectory"] = Poses._of(values["map_trajectory"])
    values["truth"] = _known(Poses._of(values["truth"]))
    values["report"] = json.loads(values["report"])
    return Replay(**values)


def _known(poses: Poses) -> Optional[Poses]:
    return poses if len(poses) else None


class Recording:
    """The samples of a recording or simulated flight, for a loop of one's own: iterate over its frames, and take the inertial
    samples that each needs by `imu_until`. `open_recording` makes one. Each sample is handed out once."""

    def __init__(self, native: "_native.Recording") -> None:
        self._native = native

    @property
    def config(self) -> Config:
        """Configuration that goes with the recording."""
        return self._native.config

    @property
    def name(self) -> str:
        """Description."""
        return self._native.name

    def __iter__(self) -> Iterator[Frame]:
        while True:
            frame = self._native.next_frame()
            if frame is None:
                return
            yield Frame(*frame)

    def imu_until(self, stamp_ns: Optional[int] = None) -> Imu:
        """Inertial samples that were not handed out yet, up to the first that reaches `stamp_ns`; all that are left for
        ``None``."""
        return Imu._of(self._native.imu_until(stamp_ns))

    def truth(self, stamps_ns: "Union[Stamps, Sequence[int]]" = ()) -> Optional[Poses]:
        """True poses, if they are known: as they were measured, or of a simulated flight at `stamps_ns`."""
        return _known(Poses._of(self._native.truth_poses(np.asarray(stamps_ns, dtype=np.int64))))

    def __repr__(self) -> str:
        return f"<plumbline.Recording {self.name}>"


def open_recording(
    dataset: Path,
    config: Union[Config, Path, None] = None,
    *,
    start: float = 0.0,
    duration: Optional[float] = None,
    frames: Optional[Tuple[int, Optional[int]]] = None,
    mono: bool = False,
    lines: bool = True,
    truth: Optional[Path] = None,
    topics: Optional[Mapping[str, str]] = None,
    path: Path = "demo",
    seed: int = 1,
    scale: float = 1.0,
    laps: int = 1,
    conditions: Sequence[str] = (),
    imu_errors: Sequence[str] = (),
    **set: Setting,
) -> Recording:
    """Opens a recording or a simulated flight, to be read sample by sample. Arguments and exceptions are those of `replay`."""
    options = _options(
        dataset, set, start, duration, frames, mono, lines, True, truth, topics, path, seed, scale, laps, conditions, imu_errors
    )
    native = _native.Recording(dataset, config, options)
    _warn(native.findings)
    return Recording(native)


def read_log(path: Path) -> Log:
    """Reads a flight log (.mcap, first file of several) into arrays. A log that breaks off is read up to there (`Log.ending`).

    Raises `DataError` if it cannot be read or is no flight log.
    """
    values = _native.read_log(path)
    values["estimates"] = Estimates._of(values["estimates"])
    values["odometry"] = Odometries._of(values["odometry"])
    values["map"] = MapPoses._of(values["map"])
    values["imu"] = Imu._of(values["imu"])
    values["events"] = [Event(*event) for event in values["events"]]
    return Log(**values)
