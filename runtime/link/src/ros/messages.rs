//! The messages of ROS 2 that a vehicle sends, field by field as their `.msg` and `.srv` files have them: the order is the
//! order on the wire, and names and types are what the hash of a definition is made of ([`super::interface`]).

use super::interface::{Rows6, describe, message};

message! {
    /// `builtin_interfaces/msg/Time`.
    #[derive(Copy, Eq)]
    struct Time = "builtin_interfaces/msg/Time" { sec: i32, nanosec: u32 }

    /// `std_msgs/msg/Header`.
    struct Header<'a> = "std_msgs/msg/Header" { stamp: Time, frame_id: &'a str }

    /// `geometry_msgs/msg/Point`.
    #[derive(Copy)]
    struct Point = "geometry_msgs/msg/Point" { x: f64, y: f64, z: f64 }

    /// `geometry_msgs/msg/Vector3`.
    #[derive(Copy)]
    struct Vector3 = "geometry_msgs/msg/Vector3" { x: f64, y: f64, z: f64 }

    /// `geometry_msgs/msg/Quaternion`.
    #[derive(Copy)]
    struct Quaternion = "geometry_msgs/msg/Quaternion" { x: f64, y: f64, z: f64, w: f64 }

    /// `geometry_msgs/msg/Pose`.
    #[derive(Copy)]
    struct Pose = "geometry_msgs/msg/Pose" { position: Point, orientation: Quaternion }

    /// `geometry_msgs/msg/Transform`.
    #[derive(Copy)]
    struct Transform = "geometry_msgs/msg/Transform" { translation: Vector3, rotation: Quaternion }

    /// `geometry_msgs/msg/PoseWithCovariance`.
    struct PoseWithCovariance = "geometry_msgs/msg/PoseWithCovariance" { pose: Pose, covariance: Rows6 }

    /// `geometry_msgs/msg/Twist`.
    struct Twist = "geometry_msgs/msg/Twist" { linear: Vector3, angular: Vector3 }

    /// `geometry_msgs/msg/TwistWithCovariance`.
    struct TwistWithCovariance = "geometry_msgs/msg/TwistWithCovariance" { twist: Twist, covariance: Rows6 }

    /// `nav_msgs/msg/Odometry`.
    struct OdometryMessage<'a> = "nav_msgs/msg/Odometry" {
        header: Header<'a>,
        child_frame_id: &'a str,
        pose: PoseWithCovariance,
        twist: TwistWithCovariance,
    }

    /// `geometry_msgs/msg/PoseStamped`.
    struct PoseStamped<'a> = "geometry_msgs/msg/PoseStamped" { header: Header<'a>, pose: Pose }

    /// `geometry_msgs/msg/TransformStamped`.
    struct TransformStamped<'a> = "geometry_msgs/msg/TransformStamped" {
        header: Header<'a>,
        child_frame_id: &'a str,
        transform: Transform,
    }

    /// `tf2_msgs/msg/TFMessage`.
    struct TfMessage<'a> = "tf2_msgs/msg/TFMessage" { transforms: Vec<TransformStamped<'a>> }

    /// `nav_msgs/msg/Path`.
    struct Path<'a> = "nav_msgs/msg/Path" { header: Header<'a>, poses: Vec<PoseStamped<'a>> }

    /// Response of `std_srvs/srv/Trigger`.
    struct TriggerServiceResponse = "std_srvs/srv/Trigger_Response" { success: bool, message: String }
}

/// Service `std_srvs/srv/Trigger`.
#[derive(Debug)]
pub enum TriggerService {}

/// Request of [`TriggerService`]. It has no fields, and one byte on the wire, as every structure of the kind.
#[derive(Debug)]
pub enum TriggerServiceRequest {}

/// Event of [`TriggerService`], as introspection publishes it.
#[derive(Debug)]
pub enum TriggerServiceEvent {}

/// `service_msgs/msg/ServiceEventInfo`.
#[derive(Debug)]
pub enum ServiceEventInfo {}

describe!(TriggerServiceRequest = "std_srvs/srv/Trigger_Request" { structure_needs_at_least_one_member: u8 });
describe!(ServiceEventInfo = "service_msgs/msg/ServiceEventInfo" {
    event_type: u8,
    stamp: Time,
    client_gid: [u8; 16],
    sequence_number: i64,
});
describe!(TriggerServiceEvent = "std_srvs/srv/Trigger_Event" {
    info: ServiceEventInfo,
    request: Option<TriggerServiceRequest>,
    response: Option<TriggerServiceResponse>,
});
describe!(TriggerService = "std_srvs/srv/Trigger" {
    request_message: TriggerServiceRequest,
    response_message: TriggerServiceResponse,
    event_message: TriggerServiceEvent,
});

impl Time {
    /// Time `nanos` after the origin; seconds end in 2038.
    #[must_use]
    pub fn from_nanos(nanos: i64) -> Self {
        let sec = nanos.div_euclid(1_000_000_000).clamp(i32::MIN.into(), i32::MAX.into());
        Self { sec: sec as i32, nanosec: nanos.rem_euclid(1_000_000_000) as u32 }
    }
}

impl From<nalgebra::Vector3<f64>> for Point {
    fn from(v: nalgebra::Vector3<f64>) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<nalgebra::Vector3<f64>> for Vector3 {
    fn from(v: nalgebra::Vector3<f64>) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<nalgebra::UnitQuaternion<f64>> for Quaternion {
    fn from(rotation: nalgebra::UnitQuaternion<f64>) -> Self {
        let q = rotation.coords;
        Self { x: q.x, y: q.y, z: q.z, w: q.w }
    }
}

impl From<nalgebra::Isometry3<f64>> for Pose {
    fn from(pose: nalgebra::Isometry3<f64>) -> Self {
        Self { position: pose.translation.vector.into(), orientation: pose.rotation.into() }
    }
}

impl From<nalgebra::Isometry3<f64>> for Transform {
    fn from(pose: nalgebra::Isometry3<f64>) -> Self {
        Self { translation: pose.translation.vector.into(), rotation: pose.rotation.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::interface::InterfaceType;
    use super::*;

    #[test]
    fn hashes_are_those_that_ros_publishes() {
        // As `ros2 topic info --verbose` and `ros2 service info --verbose` print them.
        let known = [
            (
                InterfaceType::of::<OdometryMessage<'_>>(),
                "nav_msgs::msg::dds_::Odometry_",
                "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
            ),
            (
                InterfaceType::of::<PoseStamped<'_>>(),
                "geometry_msgs::msg::dds_::PoseStamped_",
                "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
            ),
            (
                InterfaceType::of::<TfMessage<'_>>(),
                "tf2_msgs::msg::dds_::TFMessage_",
                "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
            ),
            (
                InterfaceType::of::<TriggerService>(),
                "std_srvs::srv::dds_::Trigger_",
                "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
            ),
        ];
        for (found, dds_name, hash) in known {
            assert_eq!(
                (found.dds_name.as_str(), found.hash.as_str()),
                (dds_name, &*format!("RIHS01_{hash}"))
            );
        }
    }

    #[test]
    fn stamps_before_the_origin_and_after_2038_are_times() {
        assert_eq!(Time::from_nanos(-1), Time { sec: -1, nanosec: 999_999_999 });
        assert_eq!(Time::from_nanos(i64::MAX).sec, i32::MAX);
        assert_eq!(
            Time::from_nanos(1_403_715_273_262_142_976),
            Time { sec: 1_403_715_273, nanosec: 262_142_976 }
        );
    }
}
