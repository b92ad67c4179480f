#!/usr/bin/env python3
"""Prints pose, quality and latency of a Plumbline vehicle, from Python and without ROS.

    pip install eclipse-zenoh grpcio-tools
    python examples/read_pose.py --connect tcp/127.0.0.1:7447        # while `make demo` flies

The messages are those of runtime/link/proto/plumbline/v1/plumbline.proto. This script compiles them when it starts,
with the compiler that grpcio-tools brings; your own program may as well keep what this writes:

    python -m grpc_tools.protoc -Iruntime/link/proto --python_out=. plumbline/v1/plumbline.proto
"""

import argparse
import importlib
import json
import pathlib
import sys
import tempfile
import time

import zenoh
from grpc_tools import protoc

PROTO = pathlib.Path(__file__).resolve().parent.parent / "runtime" / "link" / "proto"
STATES = ["unknown", "initialising", "tracking", "blind", "failed"]


def wire_format():
    """The module generated from the .proto file."""
    with tempfile.TemporaryDirectory() as folder:
        file = "plumbline/v1/plumbline.proto"
        if protoc.main(["protoc", f"-I{PROTO}", f"--python_out={folder}", file]) != 0:
            sys.exit(f"{PROTO / file}: does not compile")
        sys.path.insert(0, folder)
        return importlib.import_module("plumbline.v1.plumbline_pb2")


def connect(endpoint, seconds):
    """A Zenoh session with the vehicle, or with a router that it is connected to; waits for so long."""
    end = time.monotonic() + seconds
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if time.monotonic() > end:
                sys.exit(f"nobody is at {endpoint}")
            print(f"waiting for {endpoint}", flush=True)
            time.sleep(1.0)


def print_configuration(session, pb, vehicle):
    """Asks for the configuration in force, and prints its hash: the one in reports and flight logs."""
    for reply in session.get(f"plumbline/{vehicle}/config", timeout=2.0):
        if reply.ok is not None:
            configuration = pb.Configuration.FromString(reply.ok.payload.to_bytes())
            print(f"configuration {configuration.sha256}", flush=True)
            return
    print("configuration unknown: nobody answers", flush=True)


def print_odometry(payload, received_ns, pb):
    """Prints a message of plumbline/<vehicle>/odom."""
    odom = pb.Odom.FromString(payload)
    header, p, q = odom.header, odom.pose.position_o_b, odom.pose.rotation_o_b
    # From the vehicle's publication to here. On two machines it is as true as their clocks agree.
    latency_ms = (received_ns - header.published_ns) * 1e-6
    print(
        f"{header.stamp_ns // 10**9}.{header.stamp_ns % 10**9:09} s  {STATES[odom.state]:12} "
        f"quality {header.quality:3}  position {p.x:+8.3f} {p.y:+8.3f} {p.z:+8.3f} m  "
        f"rotation xyzw {q.x:+.4f} {q.y:+.4f} {q.z:+.4f} {q.w:+.4f}  latency {latency_ms:.2f} ms",
        flush=True,
    )


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint to connect to")
    arguments.add_argument("--vehicle", default="drone", help="its name in the keys")
    arguments.add_argument("--seconds", type=float, default=1e9, help="for how long; as long it waits")
    arguments.add_argument("--rate", type=float, default=5.0, help="lines a second, at most")
    arguments = arguments.parse_args()
    pb = wire_format()
    due = time.monotonic()

    def heard(sample):
        """Called by Zenoh for every message, 200 times a second: what is not due is passed over."""
        nonlocal due
        received_ns, now = time.time_ns(), time.monotonic()
        if now >= due:
            due = now + 1.0 / arguments.rate
            print_odometry(sample.payload.to_bytes(), received_ns, pb)

    with connect(arguments.connect, arguments.seconds) as session:
        print_configuration(session, pb, arguments.vehicle)
        session.declare_subscriber(f"plumbline/{arguments.vehicle}/odom", heard)
        time.sleep(arguments.seconds)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
