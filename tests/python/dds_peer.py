"""A node on Cyclone DDS that subscribes to the odometry of examples/send_dds.py, by types of its own, with the settings of ROS 2's nodes.

    dds_peer.py TOPIC COUNT     prints "ready", then a JSON object with the messages
"""

import json
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, uint32
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic

PATIENCE_S = 30


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


def main():
    topic, count = sys.argv[1], int(sys.argv[2])
    participant = DomainParticipant()
    qos = Qos(Policy.Reliability.Reliable(max_blocking_time=0), Policy.History.KeepLast(1000))
    reader = DataReader(Subscriber(participant), Topic(participant, "rt" + topic, Odometry), qos=qos)
    print("ready", flush=True)
    seen, end = [], time.monotonic() + PATIENCE_S
    while len(seen) < count and time.monotonic() < end:
        # Cyclone DDS pairs types that are alike under any name; nodes of other middlewares go by the name.
        names = {reader.get_matched_publication_data(one).type_name for one in reader.get_matched_publications()}
        assert names <= {Odometry.__idl_typename__}, names
        for m in reader.take(N=100):
            pose, twist = m.pose.pose, m.twist.twist
            seen.append({
                "stamp_ns": m.header.stamp.sec * 10**9 + m.header.stamp.nanosec,
                "frames": [m.header.frame_id, m.child_frame_id],
                "position": [pose.position.x, pose.position.y, pose.position.z],
                "orientation": [pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w],
                "covariance": list(m.pose.covariance),
                "linear": [twist.linear.x, twist.linear.y, twist.linear.z],
                "twist_covariance": list(m.twist.covariance),
            })
        time.sleep(0.01)
    print(json.dumps(seen), flush=True)


main()
