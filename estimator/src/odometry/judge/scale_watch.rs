//! Scale of the pair of cameras against that of the accelerometer.
//!
//! Gains of velocity over the longest span of [`super::force_watch`], as the images show them, `y`, and as the forces make them, `x`, are
//! freed of what changes slowly, which is bias and gravity, and regressed: `y = f x`. The factor `f` is that of the configured baseline over
//! the true one. It is believed where the forces that are scaled by it explain the images: an accelerometer that fails otherwise does not.

use super::force_watch::{Gain, SPAN_FRAMES};
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Time constants of what changes slowly, and of the regression, s.
const SLOW_S: f64 = 4.0;
const MEMORY_S: f64 = 30.0;
/// Gains that share no frames, as many as factor and slow parts take up.
const FITTED_GAINS: f64 = 2.0;
/// Root mean square of the felt gains, m/s, and the share of the seen ones that the factor does not explain, from and up to which it is told.
const MIN_GAIN_M_S: f64 = 0.05;
const MOST_UNEXPLAINED: f64 = 0.2;
/// The scales disagree from this many standard deviations, and by this much, until they are known to agree within half of it. Sound flights
/// reach 1.9 standard deviations, then 0.11 off.
const SHOWS_SIGMAS: f64 = 2.5;
const LEAST_OFF: f64 = 0.06;

/// Regression of seen gains of velocity by felt ones.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ScaleWatch {
    frames: f64,
    slow: Option<[Vector3<f64>; 2]>,
    felt_squared: f64,
    product: f64,
    seen_squared: f64,
    is_contradicted: bool,
}

impl ScaleWatch {
    /// Takes a gain, `dt_s` after the one before.
    pub(super) fn add(&mut self, gain: &Gain, dt_s: f64) {
        let Gain { felt, seen, .. } = *gain;
        let slow = self.slow.get_or_insert([felt, seen]);
        let share = (dt_s / SLOW_S).at_most(1.0);
        let [felt, seen] = [(felt, 0), (seen, 1)].map(|(gain, k)| {
            slow[k] += (gain - slow[k]) * share;
            gain - slow[k]
        });
        let kept = 1.0 - (dt_s / MEMORY_S).at_most(1.0);
        let add = |sum: &mut f64, value: f64| *sum = *sum * kept + value;
        add(&mut self.frames, 1.0);
        add(&mut self.felt_squared, felt.norm_squared());
        add(&mut self.product, felt.dot(&seen));
        add(&mut self.seen_squared, seen.norm_squared());
        self.judge();
    }

    /// Judges whether the scales agree.
    fn judge(&mut self) {
        let factor = self.product / self.felt_squared;
        let unexplained = self.seen_squared - factor * self.product;
        let gains = self.frames / SPAN_FRAMES as f64 - FITTED_GAINS;
        let sigma = (unexplained / (gains * self.felt_squared)).sqrt();
        let is_told = gains > 0.0
            && self.felt_squared > MIN_GAIN_M_S.squared() * self.frames
            && unexplained < MOST_UNEXPLAINED * self.seen_squared;
        let off = (factor - 1.0).abs();
        if is_told && off > LEAST_OFF.at_least(SHOWS_SIGMAS * sigma) {
            self.is_contradicted = true;
        } else if is_told && off.at_least(sigma) < 0.5 * LEAST_OFF {
            self.is_contradicted = false;
        }
    }

    /// True if the images show another scale than the forces.
    pub(super) fn is_contradicted(&self) -> bool {
        self.is_contradicted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, UnitQuaternion};

    /// Watches five seconds of frames of a vehicle that sways, whose images show its gains times `factor`, with what else they show.
    fn watched(factor: f64, else_seen: impl Fn(f64) -> Vector3<f64>) -> bool {
        let mut watch = ScaleWatch::default();
        for k in 0..100 {
            let t = 0.05 * f64::from(k);
            let gain = Vector3::new(libm::sin(1.7 * t), libm::cos(1.1 * t), 0.3 * libm::sin(2.3 * t)) * 0.4;
            let bias = Vector3::new(0.05, -0.03, 0.02);
            watch.add(&compared(gain + bias, gain * factor + else_seen(t)), 0.05);
        }
        watch.is_contradicted()
    }

    #[test]
    fn gains_of_two_seconds_tell_no_scale() {
        let mut watch = ScaleWatch::default();
        let is_contradicted = (0..32).any(|k| {
            let felt = Vector3::new(libm::sin(0.08 * f64::from(k)), 0.0, 0.0) * 0.4;
            watch.add(&compared(felt, felt * 1.2), 0.05);
            watch.is_contradicted()
        });
        assert!(!is_contradicted, "they are hardly two that do not share their frames");
    }

    fn compared(felt: Vector3<f64>, seen: Vector3<f64>) -> Gain {
        let (by_gravity, covariance) = (Vector3::zeros(), Matrix3::identity());
        Gain { felt, seen, by_gravity, rot_o_b: UnitQuaternion::identity(), covariance, span_s: 0.8 }
    }

    fn noise(t: f64) -> Vector3<f64> {
        Vector3::new(libm::sin(1e4 * t), libm::cos(2e4 * t), libm::sin(3e4 * t)) * 0.01
    }

    #[test]
    fn a_baseline_that_is_too_long_or_too_short_is_found() {
        assert!([0.5, 0.9, 1.1, 2.0].into_iter().all(|factor| watched(factor, noise)));
    }

    #[test]
    fn scales_that_agree_are_not_contradicted() {
        assert!(![0.97, 1.0, 1.03].into_iter().any(|factor| watched(factor, noise)));
    }

    #[test]
    fn an_accelerometer_that_fails_otherwise_has_no_scale() {
        let other = |t: f64| Vector3::new(libm::sin(5.1 * t), libm::sin(4.3 * t), libm::cos(3.7 * t)) * 0.3;
        assert!(!watched(0.4, other));
        assert!(!watched(0.0, noise), "nothing of it is seen");
    }

    #[test]
    fn hovering_tells_no_scale() {
        let mut watch = ScaleWatch::default();
        (0..200).for_each(|k| watch.add(&compared(noise(f64::from(k)), Vector3::zeros()), 0.05));
        assert!(!watch.is_contradicted());
    }
}
