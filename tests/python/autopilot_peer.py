"""An autopilot made of pymavlink, to test the bridge against: it listens on UDP and prints what it got as JSON.

The first line of its output is the port it listens on, the last the JSON object. It answers TIMESYNC by a clock
that is --ahead-ns ahead of this host's monotonic clock, asks for the time itself ten times a second, and ends
--linger seconds after the bridge says that it has stopped, or after --seconds.
"""

import argparse
import json
import math
import os
import socket
import struct
import time

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import common as mavlink  # noqa: E402  (reads MAVLINK20 when imported)

STOPPED = "Plumbline: lost, stopped"
# Linux: the time of arrival by the kernel comes with every datagram, however late this process reads it.
SO_TIMESTAMPNS = getattr(socket, "SO_TIMESTAMPNS", 35)
TIMESPEC = struct.Struct("@ll")


class Line:
    """A UDP socket that answers whoever spoke last; pymavlink writes to it."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.bridge = None

    def write(self, data):
        if self.bridge is not None:
            self.socket.sendto(data, self.bridge)

    def read(self):
        """The next datagram and its arrival by the monotonic clock, ns."""
        try:
            data, ancillary, _, self.bridge = self.socket.recvmsg(4096, 128)
        except TimeoutError:
            return b"", 0
        arrived_ns = time.monotonic_ns()
        for level, kind, value in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS):
                seconds, nanos = TIMESPEC.unpack(value[: TIMESPEC.size])
                arrived_ns -= time.time_ns() - (seconds * 1_000_000_000 + nanos)
        return data, arrived_ns


def plain(value):
    """JSON has no NaN: null stands for it."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [plain(x) for x in value]
    return value


class Peer:
    """Clock, line and what came over it."""

    def __init__(self, ahead_ns):
        self.ahead_ns = ahead_ns
        self.line = Line()
        self.mav = mavlink.MAVLink(self.line, srcSystem=1, srcComponent=1)
        self.mav.robust_parsing = True
        self.got = {"odometry": [], "texts": [], "heartbeats": [], "asked": 0, "answers": [], "bad": 0}
        self.gaps = 0
        self.sequence = None

    def now_ns(self):
        return time.monotonic_ns() + self.ahead_ns

    def ask(self):
        self.mav.timesync_send(0, self.now_ns())

    def take(self, message, arrived_ns):
        kind = message.get_type()
        now_ns, at = self.now_ns(), (arrived_ns + self.ahead_ns) * 1e-9
        if kind == "BAD_DATA":
            self.got["bad"] += 1
            return
        sender = (message.get_srcSystem(), message.get_srcComponent())
        assert sender == (1, 197), sender
        if self.sequence is not None and message.get_seq() != (self.sequence + 1) % 256:
            self.gaps += 1
        self.sequence = message.get_seq()
        if kind == "ODOMETRY":
            fields = {name: plain(value) for name, value in message.to_dict().items()}
            self.got["odometry"].append({"at": at, **fields})
        elif kind == "STATUSTEXT":
            self.got["texts"].append({"at": at, "text": message.text, "severity": message.severity})
        elif kind == "HEARTBEAT":
            self.got["heartbeats"].append({"type": message.type, "state": message.system_status})
        elif kind == "TIMESYNC" and message.tc1 == 0:
            self.got["asked"] += 1
            self.mav.timesync_send(now_ns, message.ts1)
        elif kind == "TIMESYNC":
            # As PX4 does: half of the round trip for each way; ours less theirs.
            offset_ns = (message.ts1 + now_ns) // 2 - message.tc1
            self.got["answers"].append({"offset_ns": offset_ns, "round_trip_ns": now_ns - message.ts1})


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--ahead-ns", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--linger", type=float, default=0.2)
    options = parser.parse_args()
    peer = Peer(options.ahead_ns)
    print(peer.line.socket.getsockname()[1], flush=True)
    end = time.monotonic() + options.seconds
    next_question = time.monotonic()
    while time.monotonic() < end:
        data, arrived_ns = peer.line.read()
        for message in peer.mav.parse_buffer(data) or []:
            peer.take(message, arrived_ns)
            if message.get_type() == "STATUSTEXT" and message.text == STOPPED:
                end = min(end, time.monotonic() + options.linger)
        if time.monotonic() >= next_question:
            next_question = time.monotonic() + 0.1
            peer.ask()
    print(json.dumps({**peer.got, "gaps": peer.gaps}))


if __name__ == "__main__":
    main()
