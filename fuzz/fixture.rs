//! Ingredients of the fuzzers' seeds. Included by path into the tests of the crates under `runtime/`.

use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::{
    BiasVariances, Estimate, FrameFigures, HealthBits, NavCovariance, Odometry, TrackingState,
};
use std::path::Path;

/// Writes a seed.
pub fn put(target: &str, name: &str, bytes: &[u8]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds").join(target);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join(name), bytes).unwrap();
}

/// Stamp of the messages.
pub const STAMP: Timestamp = Timestamp::from_nanos(1_403_715_273_262_142_976);

/// Odometry of a tick.
pub fn odometry() -> Odometry {
    Odometry {
        sequence: 7,
        stamp: STAMP,
        pose_o_b: Isometry3::new(Vector3::new(1.0, -2.0, 0.1), Vector3::new(0.1, 0.2, 1.5)),
        v_o_b: Vector3::new(0.1, 0.2, 0.3),
        angular_rate_b: Vector3::zeros(),
        covariance: NavCovariance::identity(),
        state: TrackingState::Tracking,
        quality: 80,
        reset_counter: 2,
        jumps: 0,
        origin: plumbline_estimator::OriginUncertainty::default(),
    }
}

/// Estimate of a frame.
pub fn estimate() -> Estimate {
    let Odometry { stamp, pose_o_b, v_o_b, covariance, state, quality, reset_counter, .. } = odometry();
    Estimate {
        frame_sequence: 3,
        stamp,
        state,
        pose_o_b,
        v_o_b,
        bias_gyro: Vector3::x() * 0.01,
        bias_accel: Vector3::y() * 0.02,
        covariance,
        origin: plumbline_estimator::OriginUncertainty::default(),
        bias_variances: BiasVariances::repeat(1e-6),
        time_offset_s: 0.001,
        time_offset_sigma_s: 0.0001,
        pose_b_c0: Isometry3::translation(0.1, 0.0, 0.0),
        quality,
        health: HealthBits(5),
        reset_counter,
        figures: FrameFigures {
            points_tracked: 90,
            keyframes: 7,
            is_keyframe: true,
            ..FrameFigures::default()
        },
    }
}
