"""Samples and images of recordings: EuRoC data sets, tables of samples, flight logs and ROS bags."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image

from . import LabError

COLUMNS = ["stamp_ns", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]


def mav0(path: Path) -> Path | None:
    """Folder of the sensors of a data set."""
    return next((root for root in (path / "mav0", path) if (root / "cam0").is_dir() or (root / "imu0").is_dir()), None)


def is_log(path: Path) -> bool:
    """True for a flight log, which `plumbline fly` or `replay --record` wrote."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
            return summary is not None and any(channel.topic == "/input/imu" for channel in summary.channels.values())
    except McapError as error:
        raise LabError(f"{path}: {error}; `plumbline log {path}` says what it holds") from error


def logged(path: Path, topic: str) -> Iterator:
    """Messages of a topic of a flight log."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for *_, message in reader.iter_decoded_messages(topics=[topic]):
            yield message


def imu(path: Path, topic: str | None = None) -> pd.DataFrame:
    """Inertial samples in rad/s and m/s², in order of time: of a data set, a table as its `imu0/data.csv`, a flight log or a bag."""
    root = mav0(path) if path.is_dir() else None
    file = root / "imu0" / "data.csv" if root else path
    if file.is_file() and ".csv" in file.suffixes:
        samples = pd.read_csv(file, header=None, comment="#", names=COLUMNS, usecols=range(7))
    elif is_log(path):
        samples = pd.DataFrame(((m.stamp_ns, *m.gyro, *m.accel) for m in logged(path, "/input/imu")), columns=COLUMNS)
    else:
        samples = pd.DataFrame(of_bag(path, topic), columns=COLUMNS)
    return samples.drop_duplicates("stamp_ns").sort_values("stamp_ns").reset_index(drop=True)


def of_bag(path: Path, topic: str | None) -> Iterator[tuple]:
    """Inertial samples of a ROS bag: of the named topic, or of the only one of sensor_msgs/Imu."""
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            found = [c for c in reader.connections if (c.topic == topic if topic else c.msgtype == "sensor_msgs/msg/Imu")]
            names = sorted({c.topic for c in found})
            if len(names) != 1:
                raise LabError(f"{path}: topics of inertial samples: {', '.join(names) or 'none'}; name one with --topic")
            for connection, _, data in reader.messages(connections=found):
                m = reader.deserialize(data, connection.msgtype)
                stamp_ns = m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec
                yield stamp_ns, *(getattr(v, a) for v in (m.angular_velocity, m.linear_acceleration) for a in "xyz")
    except (AnyReaderError, FileNotFoundError) as error:
        raise LabError(f"{path}: {error}; give a data set (mav0), a table of samples (.csv), a flight log or a ROS bag") from error


def images(path: Path, camera: int) -> Iterator[tuple[int, Image.Image]]:
    """Stamps and images of a camera (0: left) of a data set or a flight log, in order of time; none without this camera."""
    root = mav0(path) if path.is_dir() else None
    table = root / f"cam{camera}" / "data.csv" if root else None
    if table is not None and table.is_file():
        rows = pd.read_csv(table, header=None, comment="#", names=["stamp_ns", "file"], skipinitialspace=True)
        for row in rows.sort_values("stamp_ns").itertuples():
            yield row.stamp_ns, Image.open(table.parent / "data" / str(row.file).strip())
    elif root is None and is_log(path):
        for m in logged(path, ("/input/left", "/input/right")[camera]):
            stamp_ns = m.timestamp.seconds * 1_000_000_000 + m.timestamp.nanos
            if hasattr(m, "step"):
                yield stamp_ns, Image.frombytes("L", (m.width, m.height), m.data, "raw", "L", m.step)
            else:
                yield stamp_ns, Image.open(io.BytesIO(m.data))
    elif root is None:
        raise LabError(f"{path}: is neither a data set (mav0) nor a flight log (.mcap)")


def levels(image: Image.Image) -> np.ndarray:
    """Grey levels of an image."""
    return np.asarray(image.convert("L"), np.float32)
