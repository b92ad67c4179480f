"""Writes a EuRoC data set as ROS bags, by another implementation of the formats than ours (rosbags).

usage: write_bag.py DATA_SET FRAMES BAG...

A bag is OUT,raw|png,mcap|db3|bag[,none|bz2|lz4[,short]]. OUT is the directory of a ROS 2 bag, or the file of a
ROS 1 bag; with `short` the inertial samples end a second after the last image.
"""

import csv
import io
import sys
from pathlib import Path

import numpy
from PIL import Image
from rosbags import rosbag1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

SENSOR = "sensor_msgs/msg/"


class Messages:
    """Makes the messages of one version of ROS."""

    def __init__(self, is_ros1: bool):
        self.is_ros1 = is_ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        self.types = self.store.types
        self.serialize = self.store.serialize_ros1 if is_ros1 else self.store.serialize_cdr

    def header(self, stamp_ns: int, frame: str):
        stamp = self.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        sequence = {"seq": stamp_ns // 1000 % 2**32} if self.is_ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **sequence)

    def image(self, kind: str, stamp_ns: int, png: bytes):
        if kind == "png":
            data = numpy.frombuffer(png, dtype=numpy.uint8)
            name, fields = "CompressedImage", {"format": "mono8; png compressed", "data": data}
        else:
            pixels = numpy.asarray(Image.open(io.BytesIO(png)))
            assert pixels.dtype == numpy.uint8 and pixels.ndim == 2, "grey, 8 bits"
            height, width = pixels.shape
            fields = {"height": height, "width": width, "encoding": "mono8", "is_bigendian": 0, "step": width, "data": pixels.reshape(-1)}
            name = "Image"
        return SENSOR + name, self.types[SENSOR + name](self.header(stamp_ns, "cam"), **fields)

    def imu(self, row):
        stamp_ns, values = int(row[0]), [float(x) for x in row[1:7]]
        vector, none = self.types["geometry_msgs/msg/Vector3"], numpy.zeros(9)
        message = self.types[SENSOR + "Imu"](
            self.header(stamp_ns, "imu"),
            self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            none,
            vector(*values[:3]),
            none,
            vector(*values[3:]),
            none,
        )
        return stamp_ns, "/imu0", SENSOR + "Imu", message


def rows(path: Path):
    with path.open() as file:
        return [row for row in csv.reader(file) if row and not row[0].startswith("#")]


def writer(out: Path, storage: str, compression: str):
    if storage == "bag":
        bag = rosbag1.Writer(out)
        if compression != "none":
            bag.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression.upper()))
        return bag
    return Writer(out, version=9, storage_plugin=StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3)


def write(dataset: Path, frames: int, out: str, kind: str, storage: str, compression: str = "none", length: str = "whole"):
    make = Messages(storage == "bag")
    messages = []
    for camera in ("cam0", "cam1"):
        for row in rows(dataset / camera / "data.csv")[:frames]:
            png = (dataset / camera / "data" / row[1].strip()).read_bytes()
            messages.append((int(row[0]), f"/{camera}/image_raw", *make.image(kind, int(row[0]), png)))
    end_ns = max(message[0] for message in messages) + 10**9 if length == "short" else float("inf")
    messages += [make.imu(row) for row in rows(dataset / "imu0/data.csv") if int(row[0]) <= end_ns]
    messages.sort(key=lambda message: message[0])
    with writer(Path(out), storage, compression) as bag:
        connections = {}
        for stamp_ns, topic, type_name, message in messages:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, type_name, typestore=make.store)
            bag.write(connections[topic], stamp_ns, make.serialize(message, type_name))


if __name__ == "__main__":
    for bag in sys.argv[3:]:
        write(Path(sys.argv[1]) / "mav0", int(sys.argv[2]), *bag.split(","))
