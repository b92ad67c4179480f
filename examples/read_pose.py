#!/usr/bin/env python3
"""Prints pose, quality and latency of a Plumbline vehicle, over Zenoh and without ROS, five times a second.

    pip install eclipse-zenoh grpcio-tools
    python -m grpc_tools.protoc -I runtime/record/proto --python_out=examples plumbline/v1/log.proto plumbline/v1/plumbline.proto
    python examples/read_pose.py tcp/127.0.0.1:7447 [SECONDS]        # while `make demo` flies

The second command makes Python of the schemas, once. Every message on a key comes in an Envelope.
"""

import sys
import time

import zenoh
from plumbline.v1 import log_pb2, plumbline_pb2


def heard(sample):
    envelope = plumbline_pb2.Envelope.FromString(sample.payload.to_bytes())
    if envelope.sequence % 40 != 0:
        return
    odometry = log_pb2.Odometry.FromString(envelope.message)
    x, y, z, *rotation = odometry.pose_o_b
    state = log_pb2.State.Name(odometry.state).removeprefix("STATE_").lower()
    # On two machines it is as true as their clocks agree.
    latency_ms = (time.time_ns() - envelope.published_ns) * 1e-6
    print(f"{envelope.stamp_ns} ns  {state} quality {envelope.quality}  position {x:+.3f} {y:+.3f} {z:+.3f} m  "
          f"rotation xyzw {rotation}  latency {latency_ms:.2f} ms", flush=True)


# Waits for the vehicle.
CONFIG = '{mode: "client", connect: {endpoints: ["%s"], timeout_ms: -1}}'
with zenoh.open(zenoh.Config.from_json5(CONFIG % sys.argv[1])) as session:
    for reply in session.get("plumbline/*/config", timeout=2.0):
        print("configuration", plumbline_pb2.Configuration.FromString(reply.ok.payload.to_bytes()).sha256, flush=True)
    session.declare_subscriber("plumbline/*/odom", heard)
    time.sleep(float(sys.argv[2]) if len(sys.argv) > 2 else 1e9)
