#!/usr/bin/env python3
"""Odometry of a flight on this computer for nodes on DDS, as ROS 2 with Cyclone DDS or Fast DDS has it: nav_msgs/Odometry on /drone/odom.
From the local socket (docs/local-socket.md); needs `pip install cyclonedds`, and no ROS.

    plumbline fly --config drone.toml --set local.path=/tmp/plumbline
    python examples/send_dds.py /tmp/plumbline [/drone/odom]
    ros2 topic echo /drone/odom
"""

import sys
from dataclasses import dataclass
from types import new_class

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.topic import Topic
from read_local import KIND_ODOMETRY, STATES, connected, records

RATE_SIGMA_RAD_S = 0.01  # of a sample of the gyroscope


def message(name, **fields):
    """A type of ROS 2 as its middlewares name it on DDS."""
    package, name = name.split("/")
    typename = f"{package}::msg::dds_::{name}_"
    return dataclass(new_class(name, (IdlStruct,), {"typename": typename}, lambda names: names["__annotations__"].update(fields)))


Time = message("builtin_interfaces/Time", sec=types.int32, nanosec=types.uint32)
Header = message("std_msgs/Header", stamp=Time, frame_id=str)
Point, Vector3 = (message(f"geometry_msgs/{n}", x=types.float64, y=types.float64, z=types.float64) for n in ("Point", "Vector3"))
Quaternion = message("geometry_msgs/Quaternion", x=types.float64, y=types.float64, z=types.float64, w=types.float64)
Pose = message("geometry_msgs/Pose", position=Point, orientation=Quaternion)
Twist = message("geometry_msgs/Twist", linear=Vector3, angular=Vector3)
Matrix = types.array[types.float64, 36]
PoseCov = message("geometry_msgs/PoseWithCovariance", pose=Pose, covariance=Matrix)
TwistCov = message("geometry_msgs/TwistWithCovariance", twist=Twist, covariance=Matrix)
Odometry = message("nav_msgs/Odometry", header=Header, child_frame_id=str, pose=PoseCov, twist=TwistCov)


def rotation(x, y, z, w):
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]


def product(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def odometry(o):
    """Body (the IMU) in the odometry frame. ROS has the covariance of attitudes about fixed axes, ours is about the body's. A twist is in the
    body, our velocity is not: v_b = R' v changes by [v_b]x dtheta + R' dv."""
    rot, upper, full = rotation(*o[6:10]), iter(o[16:61]), [[0.0] * 9 for _ in range(9)]
    for row in range(9):
        for column in range(row, 9):
            full[row][column] = full[column][row] = next(upper)
    turn = [[float(i == j) if i < 3 else 0.0 if j < 3 else rot[i - 3][j - 3] for j in range(6)] for i in range(6)]
    pose = product(product(turn, [row[:6] for row in full[:6]]), list(zip(*turn)))
    linear = [sum(rot[k][i] * o[10 + k] for k in range(3)) for i in range(3)]
    x, y, z = linear
    cross = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    change = [cross[i] + [rot[k][i] for k in range(3)] for i in range(3)]
    velocity = product(product(change, [row[3:] for row in full[3:]]), list(zip(*change)))
    rate = [[0.0] * (3 + i) + [RATE_SIGMA_RAD_S**2] + [0.0] * (2 - i) for i in range(3)]
    twist = sum([row + [0.0] * 3 for row in velocity] + rate, [])
    header = Header(Time(o[0] // 10**9, o[0] % 10**9), "odom")
    return Odometry(header, "body", PoseCov(Pose(Point(*o[3:6]), Quaternion(*o[6:10])), sum(pose, [])),
                    TwistCov(Twist(Vector3(*linear), Vector3(*o[13:16])), twist))


def main():
    flight = connected(__doc__)
    participant, name = DomainParticipant(), sys.argv[2] if len(sys.argv) > 2 else "/drone/odom"
    qos = Qos(Policy.Reliability.Reliable(max_blocking_time=0), Policy.History.KeepLast(10))
    writer = DataWriter(Publisher(participant), Topic(participant, "rt" + name, Odometry), qos=qos)
    for o in records(flight, KIND_ODOMETRY):
        if STATES[o[-3]] in ("tracking", "blind"):
            writer.write(odometry(o))


main()
