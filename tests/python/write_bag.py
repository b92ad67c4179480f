"""Writes a EuRoC data set as ROS bags, by another implementation of the formats than ours (rosbags).

usage: write_bag.py DATA_SET OUT raw|png FRAMES mcap|db3|bag [zstd-file|zstd-message|bz2|lz4]

OUT is the directory of a ROS 2 bag, or the file of a ROS 1 bag.
"""

import csv
import struct
import sys
import zlib
from pathlib import Path

import numpy
from rosbags import rosbag1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

IS_ROS1 = sys.argv[5] == "bag"
STORE = get_typestore(Stores.ROS1_NOETIC if IS_ROS1 else Stores.ROS2_HUMBLE)
TYPES = STORE.types
SENSOR = "sensor_msgs/msg/"
QUATERNION = TYPES["geometry_msgs/msg/Quaternion"]
VECTOR = TYPES["geometry_msgs/msg/Vector3"]


def header(stamp_ns: int, frame: str):
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    sequence = {"seq": stamp_ns // 1000 % 2**32} if IS_ROS1 else {}
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **sequence)


def rows(path: Path):
    with path.open() as file:
        return [row for row in csv.reader(file) if row and not row[0].startswith("#")]


def grey_pixels(png: bytes):
    """Pixels of a grey PNG of 8 bits: the filters of its rows undone, as the standard says."""
    at, data, size = 8, b"", None
    while at < len(png):
        length, kind = struct.unpack(">I4s", png[at : at + 8])
        body = png[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            size = struct.unpack(">II", body[:8])
            assert body[8] == 8 and body[9] == 0 and body[12] == 0, "grey, 8 bits, not interlaced"
        elif kind == b"IDAT":
            data += body
        at += 12 + length
    width, height = size
    lines = numpy.frombuffer(zlib.decompress(data), dtype=numpy.uint8).reshape(height, width + 1)
    out = numpy.zeros((height, width), dtype=numpy.uint8)
    above = bytearray(width)
    for y in range(height):
        kind, line = int(lines[y, 0]), bytearray(lines[y, 1:].tobytes())
        if kind == 2:
            line = bytearray((numpy.frombuffer(line, numpy.uint8) + numpy.frombuffer(above, numpy.uint8)).tobytes())
        elif kind:
            left = upper_left = 0
            for x in range(width):
                up = above[x]
                if kind == 1:
                    guess = left
                elif kind == 3:
                    guess = (left + up) // 2
                else:
                    p = left + up - upper_left
                    a, b, c = abs(p - left), abs(p - up), abs(p - upper_left)
                    guess = left if a <= b and a <= c else up if b <= c else upper_left
                upper_left = up
                line[x] = left = (line[x] + guess) & 255
        out[y] = numpy.frombuffer(line, numpy.uint8)
        above = line
    return width, height, out.reshape(-1)


def image(kind: str, stamp_ns: int, png: bytes):
    if kind == "png":
        data = numpy.frombuffer(png, dtype=numpy.uint8)
        message = TYPES[SENSOR + "CompressedImage"](header(stamp_ns, "cam"), format="mono8; png compressed", data=data)
        return SENSOR + "CompressedImage", message
    width, height, data = grey_pixels(png)
    message = TYPES[SENSOR + "Image"](
        header(stamp_ns, "cam"), height=height, width=width, encoding="mono8", is_bigendian=0, step=width, data=data
    )
    return SENSOR + "Image", message


def imu(row):
    stamp_ns, values = int(row[0]), [float(x) for x in row[1:7]]
    none = numpy.zeros(9)
    message = TYPES[SENSOR + "Imu"](
        header(stamp_ns, "imu"),
        QUATERNION(0.0, 0.0, 0.0, 1.0),
        none,
        VECTOR(*values[:3]),
        none,
        VECTOR(*values[3:]),
        none,
    )
    return stamp_ns, "/imu0", SENSOR + "Imu", message


def writer(out: Path, storage: str, compression: str):
    if IS_ROS1:
        bag = rosbag1.Writer(out)
        if compression != "none":
            bag.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression.upper()))
        return bag
    bag = Writer(out, version=9, storage_plugin=StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3)
    if compression != "none":
        mode = CompressionMode.FILE if compression == "zstd-file" else CompressionMode.MESSAGE
        bag.set_compression(mode, CompressionFormat.ZSTD)
    return bag


def main():
    dataset, out, kind, frames, storage = Path(sys.argv[1]) / "mav0", Path(sys.argv[2]), *sys.argv[3:6]
    compression = sys.argv[6] if len(sys.argv) > 6 else "none"
    serialize = STORE.serialize_ros1 if IS_ROS1 else STORE.serialize_cdr
    messages = [imu(row) for row in rows(dataset / "imu0/data.csv")]
    for camera in ("cam0", "cam1"):
        for row in rows(dataset / camera / "data.csv")[: int(frames)]:
            png = (dataset / camera / "data" / row[1].strip()).read_bytes()
            messages.append((int(row[0]), f"/{camera}/image_raw", *image(kind, int(row[0]), png)))
    messages.sort(key=lambda message: message[0])
    with writer(out, storage, compression) as bag:
        connections = {}
        for stamp_ns, topic, type_name, message in messages:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, type_name, typestore=STORE)
            bag.write(connections[topic], stamp_ns, serialize(message, type_name))
    print(len(messages))


if __name__ == "__main__":
    main()
