//! Odometry and estimates for tests.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::{
    Estimate, FrameFigures, HealthBits, NavCovariance, Odometry, OriginUncertainty, TrackingState,
};

/// A vehicle in flight, turned and moving in all axes, with a full covariance.
pub(crate) fn odometry() -> Odometry {
    let spread = NavCovariance::from_fn(|i, j| 0.01 * ((3 * i + 5 * j + i * j) as f64).sin());
    Odometry {
        sequence: 7,
        stamp: Timestamp::from_nanos(1_403_715_273_262_142_976),
        pose_o_b: Isometry3::from_parts(
            Translation3::new(1.0, -2.0, 0.5),
            UnitQuaternion::from_euler_angles(0.3, -0.4, 2.0),
        ),
        v_o_b: Vector3::new(0.7, -1.1, 0.4),
        angular_rate_b: Vector3::new(0.1, -0.2, 0.3),
        covariance: spread * spread.transpose() + NavCovariance::identity() * 1e-4,
        state: TrackingState::Tracking,
        quality: 80,
        reset_counter: 2,
        jumps: 0,
        origin: OriginUncertainty::default(),
    }
}

/// An estimate in this state.
pub(super) fn estimate(state: TrackingState) -> Estimate {
    let odometry = odometry();
    Estimate {
        frame_sequence: 1,
        stamp: odometry.stamp,
        state,
        pose_o_b: odometry.pose_o_b,
        v_o_b: odometry.v_o_b,
        bias_gyro: Vector3::zeros(),
        bias_accel: Vector3::zeros(),
        covariance: odometry.covariance,
        origin: OriginUncertainty::default(),
        bias_variances: nalgebra::SVector::zeros(),
        time_offset_s: 0.0,
        time_offset_sigma_s: 0.0,
        pose_b_c0: Isometry3::identity(),
        quality: odometry.quality,
        health: HealthBits::default(),
        reset_counter: odometry.reset_counter,
        figures: FrameFigures::default(),
    }
}
