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
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402  (reads MAVLINK20 when imported)

STOPPED = "Plumbline: lost, stopped"


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def plain(value):
    """JSON has no NaN: null stands for it."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [plain(x) for x in value]
    return value


class Peer:
    """Clock, line and what came over it."""

    def __init__(self, port, ahead_ns):
        self.ahead_ns = ahead_ns
        self.line = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{port}", source_system=1, source_component=1, dialect="common"
        )
        self.got = {"odometry": [], "texts": [], "heartbeats": [], "asked": 0, "answers": [], "bad": 0}
        self.gaps = 0
        self.sequence = None

    def now_ns(self):
        return time.monotonic_ns() + self.ahead_ns

    def ask(self):
        self.line.mav.timesync_send(0, self.now_ns())

    def take(self, message):
        now_ns = self.now_ns()
        kind, at = message.get_type(), now_ns * 1e-9
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
            self.line.mav.timesync_send(now_ns, message.ts1)
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
    port = free_port()
    peer = Peer(port, options.ahead_ns)
    print(port, flush=True)
    end = time.monotonic() + options.seconds
    next_question = time.monotonic()
    heard = False
    while time.monotonic() < end:
        # Blocks for milliseconds at a time; the line must have been heard before there is somebody to ask.
        message = peer.line.recv_match(blocking=True, timeout=0.05)
        if message is not None:
            heard = True
            peer.take(message)
            if message.get_type() == "STATUSTEXT" and message.text == STOPPED:
                end = min(end, time.monotonic() + options.linger)
        if heard and time.monotonic() >= next_question:
            next_question = time.monotonic() + 0.1
            peer.ask()
    print(json.dumps({**peer.got, "gaps": peer.gaps}))


if __name__ == "__main__":
    main()
