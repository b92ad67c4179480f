//! Whether the estimate can be right: what it is good for, and when it is given up.

use super::Odometer;
use crate::estimate::HealthBits;
use crate::input::ResetKind;
use crate::window::feature::Feature;
use crate::window::landmark::{Landmark, LandmarkStore};
use crate::window::state::NavState;
use plumbline_config::Timestamp;

/// Fewest landmarks in view that hold an estimate against drift.
pub(super) const MIN_LANDMARKS_IN_VIEW: usize = 5;
/// Landmarks in view that give full quality.
const PLENTY_LANDMARKS: f64 = 60.0;

impl Odometer {
    /// Landmarks seen in the newest frame.
    pub(super) fn landmarks_in_view(&self) -> usize {
        let Some(newest) = self.window.frames.len().checked_sub(1) else { return 0 };
        in_view(&self.window.points, newest) + in_view(&self.window.lines, newest)
    }

    /// Resets when the estimate cannot be right, or has been blind for too long.
    pub(super) fn judge(&mut self, stamp: Timestamp, health: &mut HealthBits) {
        if self.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW {
            self.last_seen = Some(stamp);
        }
        let velocity_sigma =
            (NavState::V..NavState::V + 3).map(|k| self.covariance[(k, k)]).fold(0.0, f64::max).sqrt();
        if velocity_sigma > self.options.health.max_velocity_sigma_m_s {
            health.insert(HealthBits::VELOCITY_UNCERTAIN);
        }
        let is_held = self
            .last_reset
            .is_some_and(|last| stamp.seconds_since(last) < self.options.health.reset_holdoff_s);
        let is_blind_too_long =
            self.last_seen.is_some_and(|seen| stamp.seconds_since(seen) > self.options.health.max_blind_s);
        if !self.is_plausible() || (is_blind_too_long && !is_held) {
            self.reset(ResetKind::Soft);
            self.last_reset = Some(stamp);
        }
    }

    /// Whether speed and biases are ones that a vehicle can have.
    pub(super) fn is_plausible(&self) -> bool {
        let health = &self.options.health;
        self.window.frames.last().is_some_and(|frame| {
            let nav = &frame.nav;
            nav.is_finite()
                && nav.v_o_b.norm() < health.max_speed_m_s
                && nav.bias_gyro.norm() < health.max_gyro_bias_rad_s
                && nav.bias_accel.norm() < health.max_accel_bias_m_s2
        })
    }

    /// 0..=100 from landmarks in view and the certainty of the velocity.
    pub(super) fn quality(&self, in_view: usize) -> i8 {
        let by_landmarks = (in_view as f64 / PLENTY_LANDMARKS).min(1.0);
        let velocity_sigma =
            (NavState::V..NavState::V + 3).map(|k| self.covariance[(k, k)]).fold(0.0, f64::max).sqrt();
        let by_velocity = (1.0 - velocity_sigma / self.options.health.max_velocity_sigma_m_s).clamp(0.0, 1.0);
        (100.0 * by_landmarks.min(by_velocity)).round() as i8
    }
}

/// Landmarks with a depth that a frame sees.
fn in_view<F: Feature>(store: &LandmarkStore<F>, frame: usize) -> usize {
    let is_seen =
        |l: &&Landmark<F>| l.is_triangulated && l.observations.iter().any(|o| usize::from(o.frame) == frame);
    store.all().iter().filter(is_seen).count()
}
