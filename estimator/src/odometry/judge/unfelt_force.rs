//! Accelerations that the images show and an axis of the accelerometer does not feel.
//!
//! Over the longest span of [`super::force_watch`] the images show a gain of velocity without gravity, and the readings feel one, both in the axes
//! of the body in the middle of the span. From one span to the next they change by `s` and by `f`; biases and tilts hardly do. An axis that
//! measures has `f = s + n`, one that reads a constant and noise, whatever the vehicle does, has `f = n`, with `n` of variance `σ²`. The
//! logarithm of their likelihood ratio is
//!
//! ```text
//! l = s (s / 2 - f) / σ²
//! ```
//!
//! where the images are right. Of a vehicle that hardly moves they show their own errors, of variance `σ²` as well, which no axis feels and which
//! make `l` positive. Half of it is taken as evidence, less the most that errors add by chance,
//!
//! ```text
//! e = l / 2 - ln(2) / 2
//! ```
//!
//! since then the mean of `exp(e)` is at most one for an axis that measures, whatever the motion: of errors alone it is one. The sum over time, held
//! between zero and the bound, decides (Page 1954, "Continuous inspection schemes"): it rises while the images show motion that the axis misses,
//! and falls as the axis follows. For an axis that reads a constant, `exp(-l)` has a mean of one at most as it is: it is believed again by `l`
//! alone, and not where it has nothing to feel.

use super::force_watch::{Gain, SPAN_FRAMES};
use heapless::Deque;
use nalgebra::Vector3;
use plumbline_config::Portable;
use std::f64::consts::LN_2;

/// Sum that decides: three axes with a span of 0.8 s each make 13,500 trials an hour, of which `exp(-16)` each are wrong: one in a thousand hours.
const DECIDES: f64 = 16.0;

/// Evidence against the axes of the accelerometer.
#[derive(Clone, Debug, Default)]
pub(super) struct UnfeltForce {
    /// What was felt and seen over the spans that end with the last frames on end, oldest first, m/s in `B`.
    gains: Deque<[Vector3<f64>; 2], SPAN_FRAMES>,
    sums: Vector3<f64>,
    is_unfelt: [bool; 3],
}

impl UnfeltForce {
    /// The newest frame tells no gain.
    pub(super) fn pass_over(&mut self) {
        self.gains.clear();
    }

    /// Takes the gain up to the newest frame, `dt_s` after the one before.
    pub(super) fn add(&mut self, gain: &Gain, dt_s: f64) {
        let rot_b_o = gain.rot_o_b.inverse();
        let newest = [gain.felt, gain.seen].map(|gained| rot_b_o * (gained - gain.by_gravity));
        let before = if self.gains.is_full() { self.gains.pop_front() } else { None };
        let _ = self.gains.push_back(newest);
        let Some(before) = before else { return };
        let [felt, seen] = [newest[0] - before[0], newest[1] - before[1]];
        // Spans that end with frames on end share most of their frames.
        let share = (dt_s / gain.span_s).at_most(1.0);
        for axis in 0..3 {
            let axis_o = gain.rot_o_b * Vector3::ith(axis, 1.0);
            let variance = 2.0 * axis_o.dot(&(gain.covariance * axis_o));
            let ratio = seen[axis] * (0.5 * seen[axis] - felt[axis]) / variance;
            let evidence = if self.is_unfelt[axis] { ratio } else { 0.5 * (ratio - LN_2) };
            if evidence.is_finite() {
                self.sums[axis] = (self.sums[axis] + share * evidence).clamp(0.0, DECIDES);
            }
            self.is_unfelt[axis] =
                self.sums[axis] >= DECIDES || (self.is_unfelt[axis] && self.sums[axis] > 0.0);
        }
    }

    /// True if an axis does not feel what the images show.
    pub(super) fn is_contradicted(&self) -> bool {
        self.is_unfelt.contains(&true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, UnitQuaternion};
    use proptest::prelude::*;
    use std::f64::consts::SQRT_2;

    const PERIOD_S: f64 = 0.05;

    fn noise(k: usize) -> Vector3<f64> {
        let t = k as f64;
        Vector3::new(libm::sin(1e4 * t), libm::cos(2e4 * t), libm::sin(3e4 * t)) * 0.03
    }

    /// Standard deviation of a gain, m/s.
    const SIGMA_M_S: f64 = 0.06;

    /// Frames after which an axis is contradicted; of the frame of number `k`, `flown(k)` are what is felt and what is seen, m/s in `B`.
    fn contradicted(frames: usize, flown: impl Fn(usize) -> [Vector3<f64>; 2]) -> Vec<usize> {
        let mut watch = UnfeltForce::default();
        let mut contradicted = Vec::new();
        for k in 0..frames {
            let rot_o_b = UnitQuaternion::new(Vector3::new(0.3, 0.2, 0.02 * k as f64));
            let [felt, seen] = flown(k).map(|gained_b| rot_o_b * gained_b);
            let by_gravity = Vector3::new(0.0, 0.0, -4.0);
            let gain = Gain {
                felt: felt + by_gravity,
                seen: seen + by_gravity,
                by_gravity,
                rot_o_b,
                covariance: Matrix3::identity() * SIGMA_M_S.squared(),
                span_s: 0.8,
            };
            watch.add(&gain, PERIOD_S);
            if watch.is_contradicted() {
                contradicted.push(k);
            }
        }
        contradicted
    }

    fn sway(k: usize) -> Vector3<f64> {
        let t = PERIOD_S * k as f64;
        Vector3::new(libm::sin(1.7 * t), libm::cos(1.1 * t), libm::sin(2.3 * t)) * 0.4 + Vector3::z() * 4.0
    }

    proptest! {
        #[test]
        fn no_axis_that_feels_what_is_seen_is_contradicted(size in 0.0..20.0, scale in 0.9..1.1) {
            prop_assert!(contradicted(400, |k| [sway(k) * size * scale + noise(k), sway(k) * size]).is_empty());
        }

        #[test]
        fn an_axis_that_reads_a_constant_is_contradicted_until_it_feels_again(axis in 0_usize..3, constant in -5.0..5.0) {
            let found = contradicted(400, |k| {
                let mut felt = sway(k);
                if (100..300).contains(&k) {
                    felt[axis] = constant;
                }
                [felt + noise(k), sway(k)]
            });
            let [first, last] = [found.first(), found.last()].map(|k| k.copied().unwrap_or(0));
            prop_assert!((101..300).contains(&first) && (299..390).contains(&last), "{first} to {last}");
        }
    }

    #[test]
    fn errors_of_the_images_are_no_motion_that_an_axis_misses() {
        // Ten minutes in which the images err by as much as is stated, from span to span.
        let seen = |k: usize| {
            let t = (k / SPAN_FRAMES) as f64;
            Vector3::new(libm::sin(1e4 * t * t), libm::cos(2e4 * t * t), libm::sin(3e4 * t * t))
                * SIGMA_M_S
                * SQRT_2
        };
        assert!(contradicted(12_000, |k| [noise(k), seen(k)]).is_empty());
    }

    #[test]
    fn an_even_turn_has_nothing_to_feel() {
        let even = Vector3::new(1.5, 0.0, 4.0);
        assert!(contradicted(400, |k| [even + noise(k), even - noise(k)]).is_empty());
    }
}
