//! Zero-velocity detection from images and IMU together.
//!
//! Images alone cannot distinguish a vehicle at rest from a moving object that fills the view, the IMU alone not
//! from steady flight; both have to agree for a while.

use nalgebra::{Vector2, Vector3};
use plumbline_config::Portable;

/// Common motion of the image between two frames at rest stays below this, px: ten times what noise
/// leaves in the median of a hundred points.
const MAX_FLOW_PX: f64 = 0.06;
/// A limit below this is lost in the noise, px.
const MIN_FLOW_PX: f64 = 0.03;
/// A vehicle that moves faster than this is not taken for one at rest, m/s: where things are far away the image has to be
/// the stiller, and beyond some fifteen metres it does not tell.
const MAX_OVERLOOKED_M_S: f64 = 0.02;
/// Sum of the common motion since the vehicle came to rest, px.
const MAX_DRIFT_PX: f64 = 1.0;
/// Angular rate at rest, bias removed, rad/s.
const MAX_RATE_RAD_S: f64 = 0.03;
/// Difference of the mean specific force from gravity, m/s².
const MAX_FORCE_ERROR_M_S2: f64 = 0.5;
/// Time for which the motion must be small to count as rest, s.
const TIME_TO_BE_STILL_S: f64 = 0.5;
/// Frames in a row that count as being at rest at least, however slow the camera is.
const MIN_FRAMES_TO_BE_STILL: u32 = 2;

/// Follows how still the vehicle is.
#[derive(Clone, Debug)]
pub struct ZeroVelocityDetector {
    frames_to_be_still: u32,
    /// Flow per velocity of a thing a metre away, px per frame and m/s.
    px_per_m_s: f64,
    frames: u32,
    drift_px: Vector2<f64>,
}

impl ZeroVelocityDetector {
    /// For a camera of `rate_hz` frames a second and a focal length of `focal_px`.
    pub fn new(rate_hz: f64, focal_px: f64) -> Self {
        let frames = (TIME_TO_BE_STILL_S * rate_hz).round() as u32;
        Self {
            frames_to_be_still: frames.max(MIN_FRAMES_TO_BE_STILL),
            px_per_m_s: focal_px / rate_hz,
            frames: 0,
            drift_px: Vector2::zeros(),
        }
    }

    /// Largest flow of a vehicle at rest that sees things at `depth_m`; `None` where the image does not tell.
    fn flow_limit_px(&self, depth_m: f64) -> Option<f64> {
        let overlooked_px = MAX_OVERLOOKED_M_S * self.px_per_m_s / depth_m;
        Some(overlooked_px.at_most(MAX_FLOW_PX)).filter(|limit_px| *limit_px >= MIN_FLOW_PX)
    }

    /// Forgets how long the vehicle has stood still.
    pub fn clear(&mut self) {
        self.frames = 0;
        self.drift_px = Vector2::zeros();
    }

    /// Judges the image motion, mean angular rate (rad/s) and specific force (m/s²) since the last frame.
    /// `bias_gyro` is `None` before it is known. `depth_m` is that of what is seen: 0 before it is known, infinite where
    /// nothing is.
    pub fn update(
        &mut self,
        flow_px: Option<Vector2<f64>>,
        imu_mean: Option<(Vector3<f64>, Vector3<f64>)>,
        bias_gyro: Option<&Vector3<f64>>,
        gravity_m_s2: f64,
        depth_m: f64,
    ) {
        let is_quiet = match (flow_px, imu_mean, self.flow_limit_px(depth_m)) {
            (Some(flow_px), Some((gyro, accel)), Some(limit_px)) => {
                let rate = bias_gyro.map_or(0.0, |b| (gyro - b).norm());
                self.drift_px += flow_px;
                flow_px.amax() < limit_px
                    && self.drift_px.amax() < MAX_DRIFT_PX * (limit_px / MAX_FLOW_PX)
                    && rate < MAX_RATE_RAD_S
                    && (accel.norm() - gravity_m_s2).abs() < MAX_FORCE_ERROR_M_S2
            }
            _ => false,
        };
        if is_quiet {
            self.frames += 1;
        } else {
            self.clear();
        }
    }

    /// True if the vehicle has stood still for a while.
    pub fn is_still(&self) -> bool {
        self.frames >= self.frames_to_be_still
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of rest until the detector says so, from the second frame on.
    fn frames_until_still(rate_hz: f64) -> u32 {
        let mut detector = ZeroVelocityDetector::new(rate_hz, 458.0);
        let flow = Some(Vector2::new(0.01, -0.01));
        let mean = Some((Vector3::zeros(), Vector3::new(0.0, 0.0, 9.81)));
        (1..1000)
            .find(|_| {
                detector.update(flow, mean, None, 9.81, 0.0);
                detector.is_still()
            })
            .expect("rest is seen")
    }

    #[test]
    fn half_a_second_is_half_a_second_at_any_rate() {
        assert_eq!([10.0, 20.0, 60.0].map(frames_until_still), [5, 10, 30]);
        assert_eq!(frames_until_still(1.0), 2);
    }
}
