//! From the words of the runtime to the messages of the log. Nothing is rounded.

use super::{foxglove, proto};
use crate::pipeline::event::{Event, Severity};
use crate::pipeline::orders::{CorrectionOrder, FrameOrder, MapOrder, MapVerdict, ResetOrder, Verdict};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_config::options::RosConfig;
use plumbline_drivers::ImuReading;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, FrameFigures, Odometry, ResetKind, TrackingState};

fn vector(v: &Vector3<f64>) -> Vec<f64> {
    v.iter().copied().collect()
}

fn pose(pose: &Isometry3<f64>) -> Vec<f64> {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).copied().collect()
}

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

/// An inertial sample.
#[must_use]
pub fn imu(reading: &ImuReading) -> proto::Imu {
    proto::Imu {
        sequence: reading.sequence,
        stamp_ns: reading.sample.stamp.as_nanos(),
        gyro: vector(&reading.sample.gyro),
        accel: vector(&reading.sample.accel),
    }
}

/// What became of a frame.
#[must_use]
pub fn frame_order(order: &FrameOrder) -> proto::FrameOrder {
    let (refused, lost, level) = match order.verdict {
        Verdict::Taken { level } => (false, false, u32::from(level)),
        Verdict::Refused => (true, false, 0),
        Verdict::Lost => (false, true, 0),
    };
    proto::FrameOrder { frame: order.frame, readings_before: order.readings_before, refused, level, lost }
}

/// When an estimate took effect.
#[must_use]
pub fn correction_order(order: &CorrectionOrder) -> proto::CorrectionOrder {
    proto::CorrectionOrder { frame: order.frame, readings_before: order.readings_before }
}

/// A reset.
#[must_use]
pub fn reset_order(order: &ResetOrder) -> proto::ResetOrder {
    let kind = match order.kind {
        ResetKind::Soft => proto::reset_order::Kind::Soft,
        ResetKind::Hard => proto::reset_order::Kind::Hard,
    };
    proto::ResetOrder { kind: kind.into(), before_frame: order.before_frame, renewal: order.is_renewal }
}

/// What became of a frame for the map.
#[must_use]
pub fn map_order(order: &MapOrder) -> proto::MapOrder {
    let (passed_over, at_frame) = match order.verdict {
        MapVerdict::PassedOver => (true, 0),
        MapVerdict::Applied { at_frame } => (false, at_frame),
    };
    proto::MapOrder { frame: order.frame, passed_over, at_frame }
}

/// Where the odometry lies in the map.
#[must_use]
pub fn map_estimate(m: &MapEstimate) -> proto::MapEstimate {
    proto::MapEstimate {
        frame_sequence: m.frame_sequence,
        stamp_ns: m.stamp.as_nanos(),
        pose_m_o: m.pose_m_o.as_ref().map_or_else(Vec::new, pose),
        reset_counter: m.reset_counter,
        keyframes: m.keyframes,
        sightings: m.sightings,
        loops_used: m.loops_used,
    }
}

fn state(state: TrackingState) -> i32 {
    let state = match state {
        TrackingState::Initialising => proto::State::Initialising,
        TrackingState::Tracking => proto::State::Tracking,
        TrackingState::Blind => proto::State::Blind,
        TrackingState::Failed => proto::State::Failed,
    };
    state.into()
}

/// An estimate.
#[must_use]
pub fn estimate(e: &Estimate) -> proto::Estimate {
    proto::Estimate {
        frame_sequence: e.frame_sequence,
        stamp_ns: e.stamp.as_nanos(),
        state: state(e.state),
        pose_o_b: pose(&e.pose_o_b),
        velocity_o_b: vector(&e.v_o_b),
        bias_gyro: vector(&e.bias_gyro),
        bias_accel: vector(&e.bias_accel),
        covariance: e.covariance.iter().copied().collect(),
        time_offset_s: vec![e.time_offset_s, e.time_offset_sigma_s],
        pose_b_c0: pose(&e.pose_b_c0),
        quality: i32::from(e.quality),
        health_bits: e.health.0,
        reset_counter: e.reset_counter,
        figures: Some(figures(&e.figures)),
        bias_variances: e.bias_variances.iter().copied().collect(),
    }
}

fn figures(f: &FrameFigures) -> proto::Figures {
    proto::Figures {
        points_tracked: f.points_tracked,
        points_stereo: f.points_stereo,
        points_in_window: f.points_in_window,
        lines_raw: f.lines_raw,
        lines_kept: f.lines_kept,
        lines_merged: f.lines_merged,
        lines_matched: f.lines_matched,
        lines_cut_short: f.lines_cut_short,
        lines_in_window: f.lines_in_window,
        lines_in_structure: f.lines_in_structure,
        keyframes: f.keyframes,
        iterations: f.iterations,
        is_keyframe: f.is_keyframe,
    }
}

/// Odometry.
#[must_use]
pub fn odometry(o: &Odometry) -> proto::Odometry {
    proto::Odometry {
        sequence: o.sequence,
        stamp_ns: o.stamp.as_nanos(),
        pose_o_b: pose(&o.pose_o_b),
        velocity_o_b: vector(&o.v_o_b),
        angular_rate_b: vector(&o.angular_rate_b),
        covariance: o.covariance.iter().copied().collect(),
        state: state(o.state),
        quality: i32::from(o.quality),
        reset_counter: o.reset_counter,
        jumps: o.jumps,
    }
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

/// Where the body is, as a transform to be drawn, under the names of ROS.
#[must_use]
pub fn transform(e: &Estimate, names: &RosConfig) -> foxglove::FrameTransform {
    frame_transform(e.stamp, &names.odom_frame, &names.body_frame, &e.pose_o_b)
}

/// Where the body is, as a pose to be drawn.
#[must_use]
pub fn pose_in_frame(e: &Estimate, names: &RosConfig) -> foxglove::PoseInFrame {
    let (position, orientation) = drawn_pose(&e.pose_o_b);
    foxglove::PoseInFrame {
        timestamp: timestamp(e.stamp),
        frame_id: names.odom_frame.clone(),
        pose: Some(foxglove::Pose { position: Some(position), orientation: Some(orientation) }),
    }
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
