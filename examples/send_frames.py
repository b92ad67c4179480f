#!/usr/bin/env python3
"""Sends stereo frames to `plumbline fly` over the socket of driver.frames (docs/frame-socket.md).

Plays the images of a EuRoC data set in real time; replace `frames()` by the loop of your camera.

    pip install opencv-python
    send_frames.py V1_01_easy /run/plumbline/frames
"""

import csv
import pathlib
import socket
import struct
import sys
import time

import cv2


def frames(dataset):
    """Number, time of measurement by CLOCK_MONOTONIC in ns, left and right image (8-bit grey)."""
    mav0 = pathlib.Path(dataset) / "mav0"
    tables = [csv.reader(open(mav0 / cam / "data.csv")) for cam in ("cam0", "cam1")]
    rows = [[row for row in table if not row[0].startswith("#")] for table in tables]
    first, start = int(rows[0][0][0]), time.monotonic_ns()
    for number, (left, right) in enumerate(zip(*rows)):
        stamp = int(left[0]) - first + start
        time.sleep(max(0, stamp - time.monotonic_ns()) * 1e-9)
        paths = [mav0 / cam / "data" / row[1].strip() for cam, row in (("cam0", left), ("cam1", right))]
        yield number, stamp, *(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths)


def main(dataset, path):
    plumbline = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    plumbline.connect(path)
    for number, stamp, left, right in frames(dataset):
        (left_height, left_width), (right_height, right_width) = left.shape, right.shape
        sizes = (left_width, left_height, right_width, right_height)
        plumbline.sendall(struct.pack("<8sQq4I", b"PLMBFRM1", number, stamp, *sizes))
        plumbline.sendall(left.tobytes())
        plumbline.sendall(right.tobytes())


if __name__ == "__main__":
    main(*sys.argv[1:3])
