//! Samples of inertial sensors.

use crate::Timestamp;
use nalgebra::Vector3;

/// One reading of the inertial measurement unit, in the body frame `B` (the IMU's own).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Measurement time.
    pub stamp: Timestamp,
    /// Angular rate of `B`, rad/s, with bias and noise.
    pub gyro: Vector3<f64>,
    /// Specific force in `B`, m/s² (at rest it points up, +9.81), with bias and noise.
    pub accel: Vector3<f64>,
}

impl ImuSample {
    /// True if every component is a finite number.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.gyro.iter().chain(self.accel.iter()).all(|x| x.is_finite())
    }
}
