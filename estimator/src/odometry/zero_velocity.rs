//! Standing still, told from images and IMU together.
//!
//! Images alone cannot tell a vehicle at rest from a moving object that fills the view, the IMU alone cannot
//! tell it from steady flight; both have to agree for a while.

use super::measurements::MedianFlow;
use nalgebra::{Vector2, Vector3};

/// Common motion of the image between two frames at rest stays below this, px: ten times what noise
/// leaves in the median of a hundred points.
const MAX_FLOW_PX: f64 = 0.06;
/// Sum of the common motion since the vehicle came to rest, px.
const MAX_DRIFT_PX: f64 = 1.0;
/// Angular rate at rest, bias removed, rad/s.
const MAX_RATE_RAD_S: f64 = 0.03;
/// Difference of the mean specific force from gravity, m/s².
const MAX_FORCE_ERROR_M_S2: f64 = 0.5;
/// Frames in a row that count as being at rest (half a second).
const FRAMES_TO_BE_STILL: u32 = 10;

/// Follows how still the vehicle is.
#[derive(Clone, Debug, Default)]
pub struct ZeroVelocityDetector {
    frames: u32,
    drift_px: Vector2<f64>,
}

impl ZeroVelocityDetector {
    /// Takes the image motion, mean angular rate (rad/s) and specific force (m/s²) since the last frame.
    /// `bias_gyro` is `None` before it is known.
    pub fn update(
        &mut self,
        flow: Option<MedianFlow>,
        imu_mean: Option<(Vector3<f64>, Vector3<f64>)>,
        bias_gyro: Option<&Vector3<f64>>,
        gravity_m_s2: f64,
    ) {
        let is_quiet = match (flow, imu_mean) {
            (Some(flow), Some((gyro, accel))) => {
                let rate = bias_gyro.map_or(0.0, |b| (gyro - b).norm());
                self.drift_px += flow.px;
                flow.px.amax() < MAX_FLOW_PX
                    && self.drift_px.amax() < MAX_DRIFT_PX
                    && rate < MAX_RATE_RAD_S
                    && (accel.norm() - gravity_m_s2).abs() < MAX_FORCE_ERROR_M_S2
            }
            _ => false,
        };
        if is_quiet {
            self.frames += 1;
        } else {
            *self = Self::default();
        }
    }

    /// Whether the vehicle has stood still for a while.
    #[must_use]
    pub fn is_still(&self) -> bool {
        self.frames >= FRAMES_TO_BE_STILL
    }
}
