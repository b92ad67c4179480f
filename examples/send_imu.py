#!/usr/bin/env python3
"""Plays an IMU to `plumbline fly`: a device at a pseudo-terminal that speaks our serial protocol (docs/serial-protocol.md).

For sensors that only a program of yours can read. Plays the samples of a EuRoC data set in real time; replace `samples()`
by the loop of your sensor. The walk-through in docs/own-sensors.md runs it beside send_frames.py: both stamp by
CLOCK_MONOTONIC.

    send_imu.py V1_01_easy /run/plumbline/imu       connect = "serial:///run/plumbline/imu:921600"
"""

import argparse
import csv
import os
import pathlib
import select
import signal
import struct
import sys
import time
import tty
import zlib

# Types of messages: from the device, and to it.
SAMPLE, IDENTITY, TIME, SETTINGS = 0x01, 0x03, 0x04, 0x05
ASK_IDENTITY, ASK_TIME, SET = 0x81, 0x82, 0x83
NO_TEMPERATURE = -32768
# Ranges of the sensor, rad/s and m/s^2: those of [imu] in the configuration.
GYRO_RANGE, ACCEL_RANGE = 17.4, 156.9


def samples(dataset, start_ns):
    """Time of measurement by CLOCK_MONOTONIC in ns, angular rate (rad/s) and specific force (m/s^2), each x y z."""
    with open(pathlib.Path(dataset) / "mav0" / "imu0" / "data.csv") as file:
        table = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    for row in table:
        values = [float(value) for value in row[1:7]]
        yield int(row[0]) - int(table[0][0]) + start_ns, values[:3], values[3:]


def cobs(data):
    """Consistent overhead byte stuffing: no zero is left in the data."""
    out = bytearray()
    for block in data.split(b"\0"):
        while len(block) >= 254:
            out += b"\xff" + block[:254]
            block = block[254:]
        out += bytes([len(block) + 1]) + block
    return bytes(out)


def uncobs(data):
    """The data before stuffing; None where they were none."""
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        if code == 0 or at + code > len(data):
            return None
        out += data[at + 1 : at + code]
        at += code
        if code < 255 and at < len(data):
            out.append(0)
    return bytes(out)


def frame(kind, payload):
    body = bytes([kind]) + payload
    return b"\0" + cobs(body + struct.pack("<I", zlib.crc32(body))) + b"\0"


class Device:
    """The device's end of the line. Its clock is CLOCK_MONOTONIC, as that of the frames."""

    def __init__(self, link, rate_hz):
        self.line, self.other_end = os.openpty()
        tty.setraw(self.other_end)
        os.set_blocking(self.line, False)
        self.terminal = os.ttyname(self.other_end)
        if os.path.islink(link):
            os.symlink(self.terminal, f"{link}.{os.getpid()}.new")
            os.replace(f"{link}.{os.getpid()}.new", link)
        else:
            os.symlink(self.terminal, link)
        self.link = link
        self.rate_hz = rate_hz
        self.received = b""

    def unplug(self):
        """The name goes with the device, whose number is given to another program, unless a newer program has taken it."""
        if os.path.islink(self.link) and os.readlink(self.link) == self.terminal:
            os.unlink(self.link)

    def send(self, kind, payload):
        try:
            os.write(self.line, frame(kind, payload))
        except BlockingIOError:
            pass  # nobody reads: a serial line keeps nothing

    def answer_until(self, due_ns):
        """Answers questions until then."""
        while (left_ns := due_ns - time.monotonic_ns()) > 0:
            if not select.select([self.line], [], [], left_ns * 1e-9)[0]:
                return
            received_ns = time.monotonic_ns()
            self.received += os.read(self.line, 4096)
            *frames, self.received = self.received.split(b"\0")
            for body in filter(None, map(uncobs, frames)):
                if len(body) > 4 and struct.pack("<I", zlib.crc32(body[:-4])) == body[-4:]:
                    self.answer(body[0], body[1:-4], received_ns)

    def answer(self, kind, payload, received_ns):
        if kind == ASK_TIME:
            self.send(TIME, payload[:8] + struct.pack("<QQ", received_ns, time.monotonic_ns()))
        elif kind == ASK_IDENTITY:
            self.send(IDENTITY, struct.pack("<B3BQIff", 1, 0, 1, 0, 1, round(1000 * self.rate_hz), GYRO_RANGE, ACCEL_RANGE))
        elif kind == SET:
            # The rate is the sensor's own, and there are no triggers.
            self.send(SETTINGS, struct.pack("<IIIB", round(1000 * self.rate_hz), 0, 0, 0))


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("dataset", help="folder with mav0")
    arguments.add_argument("link", help="name to give to the line: DEVICE of connect = \"serial://DEVICE:921600\"")
    arguments.add_argument("--start", type=float, help="time of the first sample, s of CLOCK_MONOTONIC (default: now)")
    arguments.add_argument("--rate", type=float, default=200.0, help="of the sensor, Hz (default: 200)")
    given = arguments.parse_args()
    device = Device(given.link, given.rate)
    start_ns = time.monotonic_ns() if given.start is None else round(given.start * 1e9)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    sent = 0
    try:
        for stamp_ns, gyro, accel in samples(given.dataset, start_ns):
            device.answer_until(stamp_ns)
            device.send(SAMPLE, struct.pack("<IQ6fhB", sent, stamp_ns, *gyro, *accel, NO_TEMPERATURE, 0))
            sent += 1
    finally:
        device.unplug()
    print(f"send_imu: {sent} samples sent")


if __name__ == "__main__":
    main()
