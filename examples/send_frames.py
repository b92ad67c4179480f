#!/usr/bin/env python3
"""Sends stereo frames to `plumbline fly` over the socket of driver.frames (docs/own-sensors.md).

Plays the images of a EuRoC data set in real time; replace `frames()` by the loop of your camera. The walk-through in
docs/own-sensors.md runs it beside send_imu.py: both stamp by CLOCK_MONOTONIC.

    apt install python3-pil
    send_frames.py V1_01_easy /run/plumbline/frames
"""

import argparse
import csv
import pathlib
import socket
import struct
import sys
import time

try:
    from PIL import Image
except ModuleNotFoundError:
    raise SystemExit("send_frames: Pillow reads the images: apt install python3-pil, or pip install pillow in a venv")


def rows(table):
    with open(table) as file:
        return [row for row in csv.reader(file) if row and not row[0].startswith("#")]


def frames(dataset, start_ns):
    """Number, middle of the exposure by CLOCK_MONOTONIC in ns, left and right image (8-bit grey), when it is there."""
    mav0 = pathlib.Path(dataset) / "mav0"
    first_ns = int(rows(mav0 / "imu0" / "data.csv")[0][0])
    tables = [rows(mav0 / camera / "data.csv") for camera in ("cam0", "cam1")]
    print(f"send_frames: stamps differ from the data set: plumbline evaluate --time-offset {(first_ns - start_ns) * 1e-9:.9f}")
    for number, (left, right) in enumerate(zip(*tables)):
        stamp_ns = int(left[0]) - first_ns + start_ns
        paths = [mav0 / camera / "data" / row[1].strip() for camera, row in (("cam0", left), ("cam1", right))]
        images = [grey(Image.open(path)) for path in paths]
        time.sleep(max(0, stamp_ns - time.monotonic_ns()) * 1e-9)
        yield number, stamp_ns, *images


def grey(image):
    """Eight bits of an image: the upper ones of sixteen."""
    return image.point(lambda level: level * (1 / 256)).convert("L") if image.mode.startswith("I") else image.convert("L")


def connect(path, patience_s):
    """The socket of a flight, as soon as there is one."""
    if not pathlib.Path(path).exists():
        print(f"send_frames: waiting for plumbline to make {path}", file=sys.stderr)
    given_up = time.monotonic() + patience_s
    while time.monotonic() < given_up:
        try:
            plumbline = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            plumbline.connect(path)
            return plumbline
        except (FileNotFoundError, ConnectionRefusedError):
            plumbline.close()
            time.sleep(0.1)
    raise SystemExit(f"send_frames: nobody listens at {path} after {patience_s:g} s; is `plumbline fly` running, with that listen?")


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("dataset", help="folder with mav0")
    arguments.add_argument("socket", help="listen of [driver.frames]")
    arguments.add_argument("--start", type=float, help="time of the first IMU sample, s of CLOCK_MONOTONIC (default: now)")
    arguments.add_argument("--wait", type=float, default=30.0, help="how long to wait for plumbline, s (default: 30)")
    given = arguments.parse_args()
    plumbline = connect(given.socket, given.wait)
    start_ns = time.monotonic_ns() if given.start is None else round(given.start * 1e9)
    sent = 0
    try:
        for number, stamp_ns, left, right in frames(given.dataset, start_ns):
            header = struct.pack("<8sQq4I", b"PLMBFRM1", number, stamp_ns, *left.size, *right.size)
            plumbline.sendall(header + left.tobytes() + right.tobytes())
            sent += 1
    except (BrokenPipeError, ConnectionResetError):
        raise SystemExit(f"send_frames: plumbline has disconnected after {sent} frames; it logs why")
    print(f"send_frames: {sent} frames sent")


if __name__ == "__main__":
    main()
