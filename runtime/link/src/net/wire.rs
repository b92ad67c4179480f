//! Converts the estimator's types to protobuf messages.

use super::proto;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::places::mapper::path::{LoopEnd, MapPath, PathPose};
use plumbline_estimator::window::snapshot::{MapSnapshot, SnapshotKeyframe, SnapshotLine, SnapshotPoint};
use plumbline_estimator::{Estimate, HealthBits, NavCovariance, Odometry, TrackingState};

/// `state` on the wire.
#[must_use]
pub fn state_of(state: TrackingState) -> proto::TrackingState {
    match state {
        TrackingState::Initialising => proto::TrackingState::Initialising,
        TrackingState::Tracking => proto::TrackingState::Tracking,
        TrackingState::Blind => proto::TrackingState::Blind,
        TrackingState::Failed => proto::TrackingState::Failed,
    }
}

/// Name of a state on the wire.
#[must_use]
pub fn state_words(state: i32) -> &'static str {
    match proto::TrackingState::try_from(state) {
        Ok(proto::TrackingState::Initialising) => "initialising",
        Ok(proto::TrackingState::Tracking) => "tracking",
        Ok(proto::TrackingState::Blind) => "blind",
        Ok(proto::TrackingState::Failed) => "failed",
        _ => "unknown",
    }
}

/// Names of the health bits that are set.
#[must_use]
pub fn health_words(bits: u32) -> Vec<String> {
    HealthBits(bits).names().map(str::to_owned).collect()
}

fn vector(v: &Vector3<f64>) -> Option<proto::Vector3> {
    Some(proto::Vector3 { x: v.x, y: v.y, z: v.z })
}

/// A rotation on the wire.
#[must_use]
pub fn quaternion(rotation: &UnitQuaternion<f64>) -> proto::Quaternion {
    let q = rotation.coords;
    proto::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

/// A pose on the wire.
#[must_use]
pub fn pose(pose: &Isometry3<f64>) -> Option<proto::Pose> {
    Some(proto::Pose {
        position_o_b: vector(&pose.translation.vector),
        rotation_o_b: Some(quaternion(&pose.rotation)),
    })
}

fn sigmas(covariance: &NavCovariance) -> Vec<f64> {
    (0..9).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect()
}

/// Odometry as it is sent; `sequence` counts the messages of its key.
#[must_use]
pub fn odom(o: &Odometry, sequence: u64, published_ns: i64) -> proto::Odom {
    proto::Odom {
        header: Some(proto::Header {
            stamp_ns: o.stamp.as_nanos(),
            published_ns,
            sequence,
            reset_counter: o.reset_counter,
            quality: i32::from(o.quality),
        }),
        state: state_of(o.state).into(),
        pose: pose(&o.pose_o_b),
        velocity_o_b: vector(&o.v_o_b),
        angular_rate_b: vector(&o.angular_rate_b),
        sigmas: sigmas(&o.covariance),
        jumps: o.jumps,
    }
}

/// An estimate as it is sent; `sequence` counts the messages of its key.
#[must_use]
pub fn state(e: &Estimate, sequence: u64, published_ns: i64) -> proto::State {
    let mut covariance = Vec::with_capacity(45);
    for i in 0..9 {
        covariance.extend((i..9).map(|j| e.covariance[(i, j)]));
    }
    proto::State {
        header: Some(proto::Header {
            stamp_ns: e.stamp.as_nanos(),
            published_ns,
            sequence,
            reset_counter: e.reset_counter,
            quality: i32::from(e.quality),
        }),
        state: state_of(e.state).into(),
        pose: pose(&e.pose_o_b),
        velocity_o_b: vector(&e.v_o_b),
        bias_gyro: vector(&e.bias_gyro),
        bias_accel: vector(&e.bias_accel),
        covariance,
        time_offset_s: e.time_offset_s,
        time_offset_sigma_s: e.time_offset_sigma_s,
        health_bits: e.health.0,
        frame_sequence: e.frame_sequence,
        points_tracked: e.figures.points_tracked,
        points_in_window: e.figures.points_in_window,
        keyframes: e.figures.keyframes,
        iterations: e.figures.iterations,
        lines_tracked: e.figures.lines_matched,
        lines_in_window: e.figures.lines_in_window,
    }
}

/// Coordinates of points, x y z each, m.
#[must_use]
pub fn points<'a>(points: impl IntoIterator<Item = &'a SnapshotPoint>) -> Vec<f32> {
    points.into_iter().flat_map(|p| [p.p_o.x as f32, p.p_o.y as f32, p.p_o.z as f32]).collect()
}

/// Ends of lines one after the other, x y z x y z.
#[must_use]
pub fn lines<'a>(lines: impl IntoIterator<Item = &'a SnapshotLine>) -> Vec<f32> {
    let ends = lines.into_iter().flat_map(|line| line.ends_o);
    ends.flat_map(|end| [end.x as f32, end.y as f32, end.z as f32]).collect()
}

/// The window as it is sent.
#[must_use]
pub fn scene(snapshot: &MapSnapshot, sequence: u64, published_ns: i64) -> proto::Scene {
    proto::Scene {
        header: Some(snapshot_header(snapshot, snapshot.stamp.as_nanos(), sequence, published_ns)),
        keyframes: snapshot.keyframes.iter().filter_map(|k| pose(&k.pose_o_b)).collect(),
        points_o: points(&snapshot.points),
        lines_o: lines(&snapshot.lines),
    }
}

/// A keyframe of `snapshot` with the landmarks that it hosts, as it is sent.
#[must_use]
pub fn keyframe(snapshot: &MapSnapshot, keyframe: &SnapshotKeyframe, sequence: u64) -> proto::Keyframe {
    let stamp = keyframe.stamp;
    proto::Keyframe {
        header: Some(snapshot_header(snapshot, stamp.as_nanos(), sequence, super::now_ns())),
        pose: pose(&keyframe.pose_o_b),
        points_o: points(snapshot.points.iter().filter(|p| p.host == stamp)),
        lines_o: lines(snapshot.lines.iter().filter(|l| l.host == stamp)),
    }
}

fn snapshot_header(snapshot: &MapSnapshot, stamp_ns: i64, sequence: u64, published_ns: i64) -> proto::Header {
    proto::Header { stamp_ns, published_ns, sequence, reset_counter: snapshot.reset_counter, quality: 0 }
}

/// Where the odometry lies in the map, as it is sent; `paths` counts the corrected paths so far.
#[must_use]
pub fn correction(map: &MapEstimate, sequence: u64, paths: u64) -> proto::MapCorrection {
    proto::MapCorrection {
        header: Some(proto::Header {
            stamp_ns: map.stamp.as_nanos(),
            published_ns: super::now_ns(),
            sequence,
            reset_counter: map.reset_counter,
            quality: 0,
        }),
        pose_m_o: map.pose_m_o.as_ref().and_then(pose),
        loops: map.loops_used,
        keyframes: map.keyframes,
        seen_again: map.sightings,
        paths,
    }
}

/// The corrected path as it is sent.
#[must_use]
pub fn path(path: &MapPath, sequence: u64) -> proto::MapPath {
    let numbers = |at: &PathPose| {
        let (p, q) = (at.pose_m_b.translation.vector, at.pose_m_b.rotation.coords);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|x| x as f32)
    };
    let place = |end: &LoopEnd| [end.p_m_b.x as f32, end.p_m_b.y as f32, end.p_m_b.z as f32];
    let newest = path.poses.last();
    let ends = || path.loops.iter().flatten();
    proto::MapPath {
        header: Some(proto::Header {
            stamp_ns: newest.map_or(0, |newest| newest.stamp.as_nanos()),
            published_ns: super::now_ns(),
            sequence,
            reset_counter: newest.map_or(0, |newest| newest.reset_counter),
            quality: 0,
        }),
        stamps_ns: path.poses.iter().map(|at| at.stamp.as_nanos()).collect(),
        poses_m_b: path.poses.iter().flat_map(numbers).collect(),
        reset_counters: path.poses.iter().map(|at| at.reset_counter).collect(),
        loops_ns: ends().map(|end| end.stamp.as_nanos()).collect(),
        loops_m: ends().flat_map(place).collect(),
        drift_m: path.drift_m,
    }
}
