//! The true state of the vehicle, where a data set or a simulator knows it.

use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;

/// True state at one time. Frames: `W` world (z up), `B` body (the IMU's own).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthState {
    /// Time on the IMU's axis.
    pub stamp: Timestamp,
    /// Pose of the body in the world, metres.
    pub pose_w_b: Isometry3<f64>,
    /// Velocity of the body in the world, m/s.
    pub v_w_b: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub bias_accel: Vector3<f64>,
}
