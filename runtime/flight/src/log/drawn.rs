//! Drawings in a log: transforms, poses and events as Foxglove draws them.

use super::foxglove;
use nalgebra::Isometry3;
use plumbline_config::Timestamp;
use plumbline_config::options::RosConfig;
use plumbline_estimator::Estimate;
use plumbline_record::{Event, Severity};

/// Time of a message, ns; the format knows none before its origin.
#[must_use]
pub fn log_time(stamp: Timestamp) -> u64 {
    u64::try_from(stamp.as_nanos()).unwrap_or(0)
}

/// Time of a message as Foxglove's messages carry it.
#[must_use]
pub fn timestamp(stamp: Timestamp) -> Option<prost_types::Timestamp> {
    let nanos = stamp.as_nanos();
    let part = i32::try_from(nanos.rem_euclid(1_000_000_000)).unwrap_or(0);
    Some(prost_types::Timestamp { seconds: nanos.div_euclid(1_000_000_000), nanos: part })
}

/// Takes coordinates from `child` to `parent`, as a transform to be drawn.
#[must_use]
pub fn frame_transform(
    stamp: Timestamp,
    parent: &str,
    child: &str,
    pose_parent_child: &Isometry3<f64>,
) -> foxglove::FrameTransform {
    let (translation, rotation) = drawn_pose(pose_parent_child);
    foxglove::FrameTransform {
        timestamp: timestamp(stamp),
        parent_frame_id: parent.into(),
        child_frame_id: child.into(),
        translation: Some(translation),
        rotation: Some(rotation),
    }
}

fn drawn_pose(pose: &Isometry3<f64>) -> (foxglove::Vector3, foxglove::Quaternion) {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    (foxglove::Vector3 { x: p.x, y: p.y, z: p.z }, foxglove::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w })
}

/// Pose of the body, as a transform to be drawn, under the names of ROS.
#[must_use]
pub fn transform(e: &Estimate, names: &RosConfig) -> foxglove::FrameTransform {
    frame_transform(e.stamp, &names.odom_frame, &names.body_frame, &e.pose_o_b)
}

/// A pose to be drawn.
#[must_use]
pub fn pose(of: &Isometry3<f64>) -> foxglove::Pose {
    let (position, orientation) = drawn_pose(of);
    foxglove::Pose { position: Some(position), orientation: Some(orientation) }
}

/// A pose in a frame, to be drawn.
#[must_use]
pub fn pose_in(stamp: Timestamp, frame: &str, of: &Isometry3<f64>) -> foxglove::PoseInFrame {
    foxglove::PoseInFrame { timestamp: timestamp(stamp), frame_id: frame.to_owned(), pose: Some(pose(of)) }
}

/// Pose of the body, to be drawn.
#[must_use]
pub fn pose_in_frame(e: &Estimate, names: &RosConfig) -> foxglove::PoseInFrame {
    pose_in(e.stamp, &names.odom_frame, &e.pose_o_b)
}

/// An event.
#[must_use]
pub fn event(event: &Event) -> foxglove::Log {
    let level = match event.severity {
        Severity::Info => foxglove::log::Level::Info,
        Severity::Warning => foxglove::log::Level::Warning,
        Severity::Error => foxglove::log::Level::Error,
    };
    foxglove::Log {
        timestamp: timestamp(event.stamp),
        level: level.into(),
        message: event.text.as_str().into(),
        name: "plumbline".into(),
        file: String::new(),
        line: 0,
    }
}
