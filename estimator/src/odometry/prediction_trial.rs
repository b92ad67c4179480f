//! The trial of a frame's prediction, and what it decides: whether the samples or the images are wrong, and what moves in view.

use super::Odometer;
use super::innovation::Prediction;
use super::judgement::Velocity;
use crate::estimate::HealthBits;
use crate::inertial::buffer::Coverage;
use crate::window::sighting::Sighting;
use crate::window::trial::{Crowd, Expected, Trial};
use plumbline_config::Portable;

/// A force that set in suddenly and did not act moves a prediction by no more than this multiple of what it adds to it.
const SUDDEN_SHARE: f64 = 1.5;
/// A force of the vehicle that its accelerometer does not feel, as on an axis that is dead, m/s².
const UNMEASURED_M_S2: f64 = 6.0;
/// The velocity is wrong by no more standard deviations than this.
const VELOCITY_SIGMAS: f64 = 5.0;

impl Odometer {
    /// Tries a prediction that can be relied on (the scale is known, and the samples are believed) against what is seen, and drops what
    /// moves if the prediction holds; returns whether anything was dropped. `known` is the pose by known landmarks if it was looked for.
    pub(super) fn try_prediction(
        &mut self,
        prediction: &Prediction,
        known: Option<Sighting>,
        coverage: Coverage,
        health: &HealthBits,
    ) -> (Option<Trial>, bool) {
        let is_predicted = self.window.options.cameras > 1
            && self.velocity == Velocity::Known
            && !self.may_be_late(coverage, health)
            && !coverage.is_saturated
            && !coverage.unmeasured.is_any()
            && !self.rotation.is_distrusting()
            && !self.forces.is_contradicted()
            && !health.contains(HealthBits::IMU_CONTRADICTED);
        let sigma = prediction.velocity_sigma_m_s().filter(|_| is_predicted);
        let Some(velocity_sigma_m_s) = sigma else { return (None, false) };
        let stamp_sigma_s = self.time_sigma_s();
        let crowd = self.crowd(prediction.dt_s, velocity_sigma_m_s);
        let expected = Expected { velocity_sigma_m_s, stamp_sigma_s, crowd };
        let trial = self.window.try_prediction(&expected, known);
        let is_contradicted = trial.is_some_and(|trial| trial.is_contradicted());
        let is_dropped =
            !is_contradicted && self.window.drop_moving(velocity_sigma_m_s, crowd, trial.as_ref());
        (trial, is_dropped)
    }

    /// Bound of what a prediction over `dt_s` from a velocity of this standard deviation, m/s, can be wrong by, while something moves in view.
    fn crowd(&self, dt_s: f64, velocity_sigma_m_s: f64) -> Option<Crowd> {
        let newest = self.window.frames.last().filter(|_| self.window.is_motion_in_sight())?;
        let by_sudden = self.sudden_force.moved_m(newest.taken, dt_s);
        let by_unmeasured = 0.5 * UNMEASURED_M_S2 * dt_s.squared();
        let by_velocity = VELOCITY_SIGMAS * velocity_sigma_m_s * dt_s;
        Some(Crowd {
            wrong_m: SUDDEN_SHARE * by_sudden.unwrap_or(0.0) + by_unmeasured + by_velocity,
            is_force_sudden: by_sudden.is_some(),
        })
    }
}
