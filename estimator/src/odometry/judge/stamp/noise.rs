//! Noise of the stamps of frames, by what turns of frames on end have in common.
//!
//! A frame that is stamped late by `e` seems to turn by `w e` too little, and the next one by as much too much, where `w` is the angular rate.
//! With `d` the difference between the turn by the images and that by the gyroscope along the axis of the turn, and independent errors,
//!
//! ```text
//! E[d_k d_k+1] = -w_k w_k+1 sigma²
//! ```
//!
//! A fault of the gyroscope makes differences of the same sign, and so no noise of stamps. The noise of the sightings does the same as that of
//! the stamps, and is taken out.

use nalgebra::Vector3;
use plumbline_config::Portable;

/// Turns that are remembered, as the sum of their squared rates, rad²/s²: fast ones tell more.
const MEMORY: f64 = 40.0;
/// Sum of squared rates before anything is known.
const LEAST: f64 = 1.0;
/// Rate below which a turn tells nothing, rad/s.
const SLOW_RAD_S: f64 = 0.2;
/// Noise below this is none, s: what sightings of clean flights look like, and as well as a time is known.
pub(in crate::odometry::judge) const LEAST_SIGMA_S: f64 = 5e-4;
/// A stamp is not further off than this, s, whatever a single turn says.
pub(in crate::odometry::judge) const MOST_S: f64 = 0.012;

/// Variance of the stamps.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::odometry::judge) struct StampNoise {
    /// Sum of products of differences, rad², and of rates, rad²/s².
    products: f64,
    rates: f64,
}

impl StampNoise {
    /// Takes what two frames on end turn otherwise by the images than by the gyroscope, rad, with their rates, rad/s, and the variance of a
    /// sighting, rad².
    pub(in crate::odometry::judge) fn add(
        &mut self,
        differences: [Vector3<f64>; 2],
        rates: [Vector3<f64>; 2],
        variance: f64,
    ) {
        let [w, w_next] = rates.map(|rate| rate.norm());
        if w.at_most(w_next) <= SLOW_RAD_S || !(w * w_next).is_finite() {
            return;
        }
        let of_rates = rates[0].dot(&rates[1]);
        let along = differences[0].dot(&rates[0]) / w * differences[1].dot(&rates[1]) / w_next;
        let most = MOST_S.squared() * w * w_next;
        let product = (-along * of_rates.signum() - variance).clamp(-most, most);
        let kept = MEMORY / (MEMORY + w * w_next);
        self.products = kept * (self.products + product);
        self.rates = kept * (self.rates + w * w_next);
    }

    /// Standard deviation of a stamp, s; 0 while it does not show.
    pub(in crate::odometry::judge) fn sigma_s(&self) -> f64 {
        if self.rates < LEAST {
            return 0.0;
        }
        let sigma_s = (self.products / self.rates).at_least(0.0).sqrt();
        if sigma_s < LEAST_SIGMA_S { 0.0 } else { sigma_s }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Noise that is found where a vehicle turns by `rate(k)` in frame `k`, whose stamp is late by `late_s(k)`, beside a gyroscope with a
    /// scale of `1 + error`.
    fn found(rate: impl Fn(f64) -> f64, late_s: impl Fn(i32) -> f64, error: f64) -> f64 {
        let mut noise = StampNoise::default();
        let turn = |k: i32| Vector3::new(0.0, 0.0, rate(f64::from(k)));
        let off = |k: i32| turn(k) * (error * 0.05) + turn(k) * late_s(k) - turn(k - 1) * late_s(k - 1);
        (1..400).for_each(|k| noise.add([off(k), off(k + 1)], [turn(k), turn(k + 1)], 1e-8));
        noise.sigma_s()
    }

    /// A number of the size of `k`'s hash, of mean 0 and standard deviation 1.
    pub(crate) fn drawn(k: i32) -> f64 {
        let hash = (k as u32).wrapping_mul(2_654_435_761).rotate_left(11).wrapping_mul(2_246_822_519) >> 8;
        (f64::from(hash) / f64::from(1 << 24) - 0.5) * 12.0_f64.sqrt()
    }

    #[test]
    fn noise_of_stamps_is_found() {
        for sigma_s in [1e-3, 2e-3, 4e-3] {
            let sigma = found(|k| libm::sin(0.07 * k), |k| sigma_s * drawn(k), 0.0);
            assert!((0.6..1.5).contains(&(sigma / sigma_s)), "{sigma_s}: {sigma}");
        }
    }

    #[test]
    fn a_scale_and_stamps_that_swing_are_no_noise() {
        assert_eq!(found(|k| libm::sin(0.07 * k), |_| 0.0, 0.2).to_bits(), 0);
        assert_eq!(
            found(|k| libm::sin(0.07 * k), |k| 3e-3 * libm::sin(0.04 * f64::from(k)), 0.0).to_bits(),
            0
        );
    }
}
