//! Zero-velocity detection from images and IMU together.
//!
//! Images alone cannot distinguish a vehicle at rest from a moving object that fills the view, the IMU alone not
//! from steady flight; both have to agree for a while.

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
/// What holds for this long counts as being at rest, s.
const TIME_TO_BE_STILL_S: f64 = 0.5;
/// Frames in a row that count as being at rest at least, however slow the camera is.
const MIN_FRAMES_TO_BE_STILL: u32 = 2;

/// Follows how still the vehicle is.
#[derive(Clone, Debug)]
pub struct ZeroVelocityDetector {
    frames_to_be_still: u32,
    frames: u32,
    drift_px: Vector2<f64>,
}

impl ZeroVelocityDetector {
    /// For a camera of `rate_hz` frames a second.
    #[must_use]
    pub fn new(rate_hz: f64) -> Self {
        let frames = (TIME_TO_BE_STILL_S * rate_hz).round() as u32;
        Self { frames_to_be_still: frames.max(MIN_FRAMES_TO_BE_STILL), frames: 0, drift_px: Vector2::zeros() }
    }

    /// Forgets how long the vehicle has stood still.
    pub fn clear(&mut self) {
        self.frames = 0;
        self.drift_px = Vector2::zeros();
    }

    /// Judges the image motion, mean angular rate (rad/s) and specific force (m/s²) since the last frame.
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
            self.clear();
        }
    }

    /// Whether the vehicle has stood still for a while.
    #[must_use]
    pub fn is_still(&self) -> bool {
        self.frames >= self.frames_to_be_still
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of rest until the detector says so, from the second frame on.
    fn frames_until_still(rate_hz: f64) -> u32 {
        let mut detector = ZeroVelocityDetector::new(rate_hz);
        let flow = Some(MedianFlow { px: Vector2::new(0.01, -0.01), count: 100 });
        let mean = Some((Vector3::zeros(), Vector3::new(0.0, 0.0, 9.81)));
        (1..1000)
            .find(|_| {
                detector.update(flow, mean, None, 9.81);
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
