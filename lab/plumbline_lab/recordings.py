"""Samples and images of recordings: EuRoC data sets, tables of samples, and ROS bags."""

from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from . import LabError

COLUMNS = ["stamp_ns", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]


def mav0(path: Path) -> Path | None:
    """Folder of the sensors of a data set."""
    return next((root for root in (path / "mav0", path) if (root / "cam0").is_dir() or (root / "imu0").is_dir()), None)


def imu(path: Path, topic: str | None = None) -> pd.DataFrame:
    """Inertial samples in rad/s and m/s², in order of time: of a data set, of a table as EuRoC's `imu0/data.csv`, or of a bag."""
    root = mav0(path) if path.is_dir() else None
    file = root / "imu0" / "data.csv" if root else path
    if file.is_file() and ".csv" in file.suffixes:
        samples = pd.read_csv(file, header=None, comment="#", names=COLUMNS, usecols=range(7))
    else:
        rows = [
            (stamp, *(getattr(m.angular_velocity, a) for a in "xyz"), *(getattr(m.linear_acceleration, a) for a in "xyz"))
            for stamp, m in messages(path, "sensor_msgs/msg/Imu", topic)
        ]
        samples = pd.DataFrame(rows, columns=COLUMNS)
    return samples.drop_duplicates("stamp_ns").sort_values("stamp_ns").reset_index(drop=True)


def messages(path: Path, kind: str, topic: str | None = None):
    """Stamps and messages of a topic of a bag: the named one, or the only one of this kind."""
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            found = [c for c in reader.connections if (c.topic == topic if topic else c.msgtype == kind)]
            names = sorted({c.topic for c in found})
            if len(names) != 1:
                raise LabError(f"{path}: topics of {kind}: {', '.join(names) or 'none'}; name one with --topic")
            for connection, _, data in reader.messages(connections=found):
                message = reader.deserialize(data, connection.msgtype)
                yield message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec, message
    except (AnyReaderError, FileNotFoundError) as error:
        raise LabError(f"{path}: {error}; give a data set (mav0), a table of samples (.csv) or a ROS bag") from error


def image_files(path: Path, camera: int) -> pd.DataFrame | None:
    """Stamps and files of the images of a camera of a data set; `None` without this camera."""
    root = mav0(path)
    table = root / f"cam{camera}" / "data.csv" if root else None
    if table is None or not table.is_file():
        return None
    rows = pd.read_csv(table, header=None, comment="#", names=["stamp_ns", "file"], skipinitialspace=True)
    return rows.assign(file=[table.parent / "data" / str(name).strip() for name in rows.file]).sort_values("stamp_ns")


def image(file: Path) -> np.ndarray:
    """Grey levels of an image file."""
    return np.asarray(Image.open(file).convert("L"), np.float32)
