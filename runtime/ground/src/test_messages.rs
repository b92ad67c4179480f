//! Messages of vehicles, for tests.

use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::window::snapshot::{SnapshotKeyframe, SnapshotLine, SnapshotPoint};
use plumbline_estimator::{MapSnapshot, NavCovariance, Odometry, TrackingState};
use plumbline_link::net::read::Heard;
use plumbline_record::fields::Parts;
use plumbline_record::messages::{Envelope, Health};

/// A message as it is heard.
pub fn heard<T: Parts>(sequence: u64, message: T) -> Heard<T> {
    Heard { envelope: Envelope::around(&message, Vec::new(), sequence, 0), message }
}

/// Odometry at `x` metres, 5 ms times its number after the start.
pub fn odometry(sequence: u64, x: f64, reset_counter: u32) -> Heard<Odometry> {
    let odometry = Odometry {
        sequence,
        stamp: Timestamp::from_nanos(sequence as i64 * 5_000_000),
        pose_o_b: Isometry3::translation(x, 0.0, 0.0),
        covariance: NavCovariance::zeros(),
        state: TrackingState::Tracking,
        quality: 80,
        reset_counter,
        ..Odometry::default()
    };
    heard(sequence, odometry)
}

/// Health of a vehicle that tracks.
pub fn health(sequence: u64, message: Health) -> Heard<Health> {
    heard(sequence, Health { state: TrackingState::Tracking, ..message })
}

/// A window, or a keyframe that has left it, with so many points and a line.
pub fn window(stamp_ns: i64, reset_counter: u32, points: usize) -> MapSnapshot {
    let stamp = Timestamp::from_nanos(stamp_ns);
    MapSnapshot {
        stamp,
        reset_counter,
        keyframes: vec![SnapshotKeyframe { stamp, pose_o_b: Isometry3::identity() }],
        points: vec![SnapshotPoint { host: stamp, p_o: Vector3::new(1.0, 2.0, 3.0) }; points],
        lines: vec![SnapshotLine { host: stamp, ends_o: [Vector3::zeros(), Vector3::repeat(1.0)] }],
    }
}
