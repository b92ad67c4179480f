//! Measurements of a frame before it has a state: its points and lines, rates, and whether the vehicle stands
//! still.

use super::{Odometer, Phase};
use crate::estimate::HealthBits;
use crate::exchange::Tracked;
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Landmarks in view below which the estimate is weak.
const FEW_LANDMARKS: usize = 20;
/// Frames further apart than this many periods have lost frames between them.
const FRAME_GAP_PERIODS: f64 = 1.5;
/// An image is blurred if a turn moves what is seen in its middle by this much while it is exposed, px: a quarter of a patch.
const BLURRED_PX: f64 = 3.0;

impl Odometer {
    /// Reports frames that see too little, and cameras that see different things.
    pub(super) fn check_points(&mut self, tracked: &Tracked, health: &mut HealthBits) {
        self.judge.see(&tracked.points, tracked.is_repeating, health);
        match tracked.points.len() {
            0 => health.insert(HealthBits::NO_FEATURES),
            n if n < FEW_LANDMARKS => health.insert(HealthBits::LOW_FEATURES),
            _ => {}
        }
    }

    /// Measurements of the frame, and whether the vehicle stands still.
    pub(super) fn measure(&mut self, tracked: &Tracked, health: &mut HealthBits) {
        let (stamp, observations) = (tracked.time.stamp, &tracked.points);
        let last = self.last.map_or(stamp, |last| last.stamp);
        let dt_s = stamp.seconds_since(last);
        if dt_s > 0.0 {
            // After some ten frames a lower rate than the configured one is that of the camera.
            self.usual_s = dt_s.at_most(self.usual_s + 0.1 * dt_s);
        }
        if dt_s > FRAME_GAP_PERIODS * self.options.frame_period_s.at_least(self.usual_s) {
            health.insert(HealthBits::FRAME_GAP);
        }
        let bias_gyro = self.biases().0;
        let estimation = &mut self.estimation;
        let imu_mean = estimation.imu.mean(last.plus_nanos(-1), stamp);
        let rate_b = imu_mean.map_or_else(Vector3::zeros, |(gyro, _)| gyro - bias_gyro);
        let rate_c = [0, 1].map(|c| estimation.window.rig.pose_b_c(c).rotation.inverse() * rate_b);
        estimation.rate_b = estimation.rate_at(last, stamp, &bias_gyro);
        estimation.vibration = estimation.imu.vibration(stamp);
        estimation.is_repeating = tracked.is_repeating;
        estimation.turn = tracked.turn;
        // The front-end does not know the outliers of the frame before yet.
        let outliers = estimation.window.outliers();
        estimation.measurer.measure_points(observations, &outliers.points, &rate_c);
        estimation.measurer.measure_lines(&tracked.lines, &outliers.lines, &rate_c);
        let (points, lines) = estimation.measurer.tracks_mut();
        estimation.window.correct_intrinsics(points, lines);
        let motion = estimation.measurer.motion(observations);
        let periods = dt_s / self.options.frame_period_s;
        self.judge.see_motion(motion.ways_px.map(|way_px| Some(way_px? / periods)));
        let known_bias = (self.phase == Phase::Running).then_some(&bias_gyro);
        let depth_m = match self.phase {
            Phase::Running => estimation.measurer.median_depth_m(&estimation.window.points),
            Phase::Gathering => 0.0,
        };
        self.zero_velocity.update(motion.common, imu_mean, known_bias, self.options.gravity_m_s2, depth_m);
        if self.zero_velocity.is_still() {
            health.insert(HealthBits::STATIONARY);
        }
        if let Some(earlier) = self.start.stamp_before_last().filter(|_| self.phase == Phase::Gathering) {
            let span_s = stamp.seconds_since(earlier);
            let moments = estimation.measurer.epipolar_moments(observations, &estimation.window.rig, span_s);
            self.judge.see_gathered(moments.filter(|_| !estimation.is_repeating));
        }
        estimation.measurer.remember(observations);
        if self.blur_px() > BLURRED_PX {
            health.insert(HealthBits::BLURRED);
        }
    }

    /// Way of what the middle of the left image shows during an exposure, by the turn of the camera, px.
    fn blur_px(&self) -> f64 {
        let rot_b_c = self.estimation.window.rig.pose_b_c(0).rotation;
        let rate_c = rot_b_c.inverse() * self.estimation.rate_b;
        rate_c.xy().norm() * self.options.exposure_s * self.options.focal_px
    }
}
