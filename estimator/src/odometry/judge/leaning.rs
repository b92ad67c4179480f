//! Corrections that lean to one side.
//!
//! What a frame corrects of its prediction is white as long as the noise of both is known, and each correction has the covariance by which the
//! frame lowers that of the prediction. A force that is wrong by little, a crowd that drifts or a stream that is somewhat late corrects
//! every frame to the same side instead, each time by less than a single frame could tell. The running mean of the corrections shows it first: where
//! it leans by more than chance, the published estimate is as uncertain along it as the corrections of that time add up to, whoever is wrong.

use crate::estimate::NavCovariance;
use crate::geometry::log_so3;
use crate::window::state::{FrameMatrix, NavState};
use nalgebra::{Matrix3, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Time constant of the running means, s.
const MEMORY_S: f64 = 0.25;
/// A mean leans from this many standard deviations. In sound flights a tenth of the frames do.
const LEANS_SIGMAS: f64 = 2.5;
/// Standard deviation, as a multiple of the sum of what leans.
const SIGMA_SHARE: f64 = 1.4;
/// Parts of the state that are corrected, and for how long what leaned is uncertain afterwards, s: velocities are soon corrected, positions and
/// tilts stay off with the landmarks that they moved.
const PARTS: [(usize, f64); 3] = [(NavState::P, 2.0), (NavState::ROT, 2.0), (NavState::V, 0.3)];

/// Corrections of a part of the state.
#[derive(Clone, Copy, Debug, Default)]
struct Lean {
    mean: Vector3<f64>,
    /// Running mean of the expected covariance of a correction.
    expected: Matrix3<f64>,
    /// The largest standard deviation of the last frames, and when it was last reached.
    held: Option<(Timestamp, Vector3<f64>)>,
}

impl Lean {
    /// Takes a correction `d` with the covariance `expected` at `stamp`; `share` is the weight of the newest.
    fn add(
        &mut self,
        stamp: Timestamp,
        [share, held_s]: [f64; 2],
        d: &Vector3<f64>,
        expected: &Matrix3<f64>,
    ) {
        self.mean += (d - self.mean) * share;
        self.expected += (expected - self.expected) * share;
        let length = self.mean.norm();
        let direction = self.mean / length;
        let variance = direction.dot(&(self.expected * direction)) * share / (2.0 - share);
        let leans = length > LEANS_SIGMAS * variance.at_least(0.0).sqrt();
        let sigma = self.mean * (SIGMA_SHARE / share);
        let held = self.held_at(stamp, held_s);
        if leans && held.is_none_or(|held| held.norm_squared() <= sigma.norm_squared()) {
            self.held = Some((stamp, sigma));
        }
    }

    fn held_at(&self, stamp: Timestamp, held_s: f64) -> Option<Vector3<f64>> {
        self.held.filter(|(last, _)| stamp.seconds_since(*last) < held_s).map(|(_, sigma)| sigma)
    }
}

/// Watches what frames correct of their predictions.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Leaning {
    parts: [Lean; 3],
}

/// Correction that a frame made to its prediction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corrected<'a> {
    pub(super) stamp: Timestamp,
    pub(super) dt_s: f64,
    /// The state as predicted and as it is.
    pub(super) states: [&'a NavState; 2],
    /// Covariance of either.
    pub(super) covariances: [&'a FrameMatrix; 2],
}

impl Leaning {
    pub(super) fn add(&mut self, corrected: &Corrected<'_>) {
        let [before, after] = corrected.states;
        let d = [
            after.p_o_b - before.p_o_b,
            log_so3(&(before.rot_o_b.inverse() * after.rot_o_b)),
            after.v_o_b - before.v_o_b,
        ];
        if !d.iter().flatten().all(|x| x.is_finite()) {
            return;
        }
        let share = (corrected.dt_s / MEMORY_S).at_most(1.0);
        let [predicted, updated] = corrected.covariances;
        for ((lean, (part, held_s)), d) in self.parts.iter_mut().zip(PARTS).zip(&d) {
            let expected = predicted.fixed_view::<3, 3>(part, part) - updated.fixed_view::<3, 3>(part, part);
            lean.add(corrected.stamp, [share, held_s], d, &expected);
        }
    }

    /// Nothing could be learnt from the frame of `stamp`: what leaned is as uncertain as before.
    pub(super) fn prolong_suspicion(&mut self, stamp: Timestamp) {
        for (lean, (_, held_s)) in self.parts.iter_mut().zip(PARTS) {
            lean.held = lean.held_at(stamp, held_s).map(|sigma| (stamp, sigma));
        }
    }

    /// Adds to the `covariance` of a state at `stamp` what leaning corrections hide.
    pub(super) fn add_to(&self, covariance: &mut NavCovariance, stamp: Timestamp) {
        for (lean, (part, held_s)) in self.parts.iter().zip(PARTS) {
            if let Some(sigma) = lean.held_at(stamp, held_s) {
                let mut block = covariance.fixed_view_mut::<3, 3>(part, part);
                block += sigma * sigma.transpose();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest standard deviation of the velocity, m/s, after four seconds of frames that correct it by `d` m/s, expected to be 0.01.
    fn sigma_after(d: impl Fn(usize) -> f64) -> f64 {
        let (before, mut leaning) = (FrameMatrix::identity() * 2e-4, Leaning::default());
        let after = FrameMatrix::identity() * 1e-4;
        for k in 0..80 {
            let v_o_b = Vector3::new(0.0, d(k), 0.0);
            leaning.add(&Corrected {
                stamp: stamp(k),
                dt_s: 0.05,
                states: [&NavState::default(), &NavState { v_o_b, ..NavState::default() }],
                covariances: [&before, &after],
            });
        }
        sigma_at(&leaning, stamp(79))
    }

    fn stamp(k: usize) -> Timestamp {
        Timestamp::default().plus_seconds(0.05 * k as f64)
    }

    fn sigma_at(leaning: &Leaning, stamp: Timestamp) -> f64 {
        let mut covariance = NavCovariance::zeros();
        leaning.add_to(&mut covariance, stamp);
        covariance.diagonal().max().sqrt()
    }

    #[test]
    fn corrections_to_both_sides_leave_the_estimate_certain() {
        assert_eq!(sigma_after(|k| if k % 2 == 0 { 0.015 } else { -0.015 }), 0.0);
    }

    #[test]
    fn corrections_to_one_side_make_it_as_uncertain_as_their_sum() {
        let sigma = sigma_after(|_| 0.009);
        assert!((sigma - 1.4 * 5.0 * 0.009).abs() < 1e-3, "{sigma}");
    }

    #[test]
    fn what_leaned_is_uncertain_for_a_while() {
        let lean = |last: usize| sigma_after(move |k| if k <= last { 0.02 } else { 0.0 });
        assert!(lean(75) > 0.03 && lean(60) == 0.0, "{} {}", lean(75), lean(60));
    }

    #[test]
    fn a_state_that_is_no_number_is_passed_over() {
        assert_eq!(sigma_after(|k| if k == 40 { f64::NAN } else { 0.0 }), 0.0);
    }
}
