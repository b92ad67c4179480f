#!/usr/bin/env python3
"""Prints pose, quality and latency of a Plumbline vehicle, over Zenoh and without ROS, five times a second.

    pip install eclipse-zenoh grpcio-tools
    python examples/read_pose.py tcp/127.0.0.1:7447 [SECONDS]        # while `make demo` flies

Every message on a key comes in an Envelope; the schemas are in runtime/record/proto. They are compiled here at each start.
"""

import json
import pathlib
import sys
import tempfile
import time

import zenoh
from grpc_tools import protoc

PROTO, MADE = pathlib.Path(__file__).resolve().parent.parent / "runtime/record/proto", tempfile.mkdtemp()
FILES = ["plumbline/v1/log.proto", "plumbline/v1/plumbline.proto"]
if protoc.main(["protoc", f"-I{PROTO}", f"--python_out={MADE}", *FILES]) != 0:
    sys.exit(f"{PROTO}: does not compile")
pathlib.Path(MADE, "plumbline/__init__.py").touch()  # before a package of the same name
sys.path.insert(0, MADE)
from plumbline.v1 import log_pb2, plumbline_pb2  # noqa: E402


def heard(sample):
    envelope = plumbline_pb2.Envelope.FromString(sample.payload.to_bytes())
    if envelope.sequence % 40 == 0:
        odometry = log_pb2.Odometry.FromString(envelope.message)
        # On two machines it is as true as their clocks agree.
        latency_ms = (time.time_ns() - envelope.published_ns) * 1e-6
        x, y, z, *rotation = odometry.pose_o_b
        state = log_pb2.State.Name(odometry.state).removeprefix("STATE_").lower()
        print(f"{envelope.stamp_ns} ns  {state} quality {envelope.quality}  position {x:+.3f} {y:+.3f} {z:+.3f} m  "
              f"rotation xyzw {rotation}  latency {latency_ms:.2f} ms", flush=True)


config = zenoh.Config.from_json5(json.dumps({
    "mode": "client", "connect": {"endpoints": [sys.argv[1]], "timeout_ms": -1},  # waits for the vehicle
}))
with zenoh.open(config) as session:
    for reply in session.get("plumbline/*/config", timeout=2.0):
        print("configuration", plumbline_pb2.Configuration.FromString(reply.ok.payload.to_bytes()).sha256, flush=True)
    session.declare_subscriber("plumbline/*/odom", heard)
    time.sleep(float(sys.argv[2]) if len(sys.argv) > 2 else 1e9)
