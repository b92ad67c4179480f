//! The messages of ROS 2 that a vehicle sends, field by field as their `.msg` files have them: the order is the
//! order on the wire, and who sends one names its definition by its hash ([`super::interface`]).

use super::interface::Interface;
use serde::Serialize;

/// Square matrix by rows: `float64[36]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rows6(pub [[f64; 6]; 6]);

/// Declares structures with the fields of definitions.
macro_rules! message {
    ($(
        $(#[$about:meta])*
        struct $name:ident $(<$life:lifetime>)? { $($field:ident: $type:ty),* $(,)? }
    )*) => {$(
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, Serialize)]
        pub struct $name $(<$life>)? { $(pub(super) $field: $type),* }
    )*};
}

message! {
    /// `builtin_interfaces/msg/Time`.
    #[derive(Copy, Eq)]
    struct Time { sec: i32, nanosec: u32 }

    /// `std_msgs/msg/Header`.
    struct Header<'a> { stamp: Time, frame_id: &'a str }

    /// `geometry_msgs/msg/Point`.
    #[derive(Copy)]
    struct Point { x: f64, y: f64, z: f64 }

    /// `geometry_msgs/msg/Vector3`.
    #[derive(Copy)]
    struct Vector3 { x: f64, y: f64, z: f64 }

    /// `geometry_msgs/msg/Quaternion`.
    #[derive(Copy)]
    struct Quaternion { x: f64, y: f64, z: f64, w: f64 }

    /// `geometry_msgs/msg/Pose`.
    #[derive(Copy)]
    struct Pose { position: Point, orientation: Quaternion }

    /// `geometry_msgs/msg/Transform`.
    #[derive(Copy)]
    struct Transform { translation: Vector3, rotation: Quaternion }

    /// `geometry_msgs/msg/PoseWithCovariance`.
    struct PoseWithCovariance { pose: Pose, covariance: Rows6 }

    /// `geometry_msgs/msg/Twist`.
    struct Twist { linear: Vector3, angular: Vector3 }

    /// `geometry_msgs/msg/TwistWithCovariance`.
    struct TwistWithCovariance { twist: Twist, covariance: Rows6 }

    /// `nav_msgs/msg/Odometry`.
    struct OdometryMessage<'a> {
        header: Header<'a>,
        child_frame_id: &'a str,
        pose: PoseWithCovariance,
        twist: TwistWithCovariance,
    }

    /// `geometry_msgs/msg/PoseStamped`.
    struct PoseStamped<'a> { header: Header<'a>, pose: Pose }

    /// `geometry_msgs/msg/TransformStamped`.
    struct TransformStamped<'a> {
        header: Header<'a>,
        child_frame_id: &'a str,
        transform: Transform,
    }

    /// `tf2_msgs/msg/TFMessage`.
    struct TfMessage<'a> { transforms: Vec<TransformStamped<'a>> }

    /// `nav_msgs/msg/Path`.
    struct Path<'a> { header: Header<'a>, poses: Vec<PoseStamped<'a>> }
}

/// Gives a type the name and the hash of its definition.
macro_rules! interfaces {
    ($($type:ty = $name:literal, $hash:literal;)*) => {$(
        impl Interface for $type {
            const NAME: &'static str = $name;
            const HASH: &'static str = $hash;
        }
    )*};
}

interfaces! {
    Header<'_> = "std_msgs/msg/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01";
    OdometryMessage<'_> = "nav_msgs/msg/Odometry", "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
    PoseStamped<'_> = "geometry_msgs/msg/PoseStamped", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8";
    TfMessage<'_> = "tf2_msgs/msg/TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";
    Path<'_> = "nav_msgs/msg/Path", "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b";
}

impl Time {
    /// Time `nanos` after the origin; seconds end in 2038.
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
    use super::*;

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
