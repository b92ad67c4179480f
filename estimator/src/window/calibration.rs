//! Uncertainty of the rig: the covariance of its error state, and what of it a start begins with.

use super::Window;
use super::state::{RIG_DIM, Rig};
use nalgebra::{SMatrix, SVector};
use plumbline_config::Portable;

/// Covariance of the rig's error state, in the order and units of [`Rig::P_B_C0`] and following.
pub type RigCovariance = SMatrix<f64, RIG_DIM, RIG_DIM>;

/// Growth of the variances of a rig that outlives a reset: whatever led to it may have misled the calibration too.
const KEPT_GROWTH: f64 = 9.0;

/// Information about a rig, and its gradient there.
#[derive(Clone, Debug)]
pub struct KnownRig {
    pub(super) information: RigCovariance,
    pub(super) gradient: SVector<f64, RIG_DIM>,
}

impl KnownRig {
    /// A rig known by its standard deviations; 0 is held fixed.
    pub fn within(sigmas: &SVector<f64, RIG_DIM>) -> Self {
        let information = sigmas.map(|sigma| if sigma > 0.0 { 1.0 / (sigma * sigma) } else { 0.0 });
        Self { information: RigCovariance::from_diagonal(&information), gradient: SVector::zeros() }
    }

    /// A rig known with `covariance`, but for the growth of its variances, and no less well than by the standard
    /// deviations of the configured rig, `offset` away; `None` where that is no covariance.
    fn kept(
        covariance: &RigCovariance,
        sigmas: &SVector<f64, RIG_DIM>,
        offset: &SVector<f64, RIG_DIM>,
    ) -> Option<Self> {
        let is_free = |k: usize| sigmas[k] > 0.0;
        let regular = RigCovariance::from_fn(|i, k| match is_free(i) && is_free(k) {
            true => covariance[(i, k)] / (sigmas[i] * sigmas[k]),
            false => f64::from(u8::from(i == k)),
        });
        let inverse = regular.cholesky()?.inverse() / KEPT_GROWTH;
        let configured = Self::within(sigmas).information * (1.0 - 1.0 / KEPT_GROWTH);
        let learnt = RigCovariance::from_fn(|i, k| match is_free(i) && is_free(k) {
            true => inverse[(i, k)] / (sigmas[i] * sigmas[k]),
            false => 0.0,
        });
        Some(Self { information: learnt + configured, gradient: configured * offset })
    }
}

impl Window {
    /// Keeps for the next start what this window has learnt of the rig; without it, the next start knows the configured standard
    /// deviations.
    pub fn keep_rig(&mut self) {
        let offset = self.rig.minus(&self.configured_rig);
        let covariance = self.rig_covariance();
        self.kept_rig =
            covariance.and_then(|known| KnownRig::kept(&known, &self.options.rig_sigmas, &offset));
    }

    /// Covariance of the rig's error state by the last factorization (right perturbation, m, rad and s), zero for what is held
    /// fixed. `None` before the first factorization, and where it is no covariance.
    pub(super) fn rig_covariance(&mut self) -> Option<RigCovariance> {
        let dim = self.factor.dim;
        if dim < RIG_DIM {
            return None;
        }
        let mut covariance = RigCovariance::zeros();
        let mask = self.options.rig_mask;
        for column in (0..RIG_DIM).filter(|k| mask[*k] != 0.0) {
            self.solve_for_rig(column);
            for row in (0..RIG_DIM).filter(|k| mask[*k] != 0.0) {
                covariance[(row, column)] = self.solution[row];
            }
        }
        let covariance = (covariance + covariance.transpose()) * 0.5;
        let is_one = (0..RIG_DIM).all(|k| {
            let variance: f64 = covariance[(k, k)];
            variance.is_finite() && (variance > 0.0) == (self.options.rig_mask[k] != 0.0)
        });
        is_one.then_some(covariance)
    }

    /// Puts column `k` of the inverse of the last factorization into `solution`.
    fn solve_for_rig(&mut self, k: usize) {
        let dim = self.factor.dim;
        self.solution[..dim].fill(0.0);
        self.solution[k] = 1.0;
        self.factor.solve(&mut self.solution[..dim]);
    }

    /// Contradiction between the configured attitude of the cameras to each other and what is seen of it, standard deviations about
    /// the axis where it is largest: an estimate of variance `P` that includes a configured value of variance `s²` differs from that
    /// by `s² - P` (score test; Rao 1948). 0 before the first factorization, and once the value has lost its weight by it.
    pub fn pair_contradiction(&mut self) -> f64 {
        let offset = self.rig.minus(&self.configured_rig);
        let is_known = self.factor.dim >= RIG_DIM;
        let axes = (Rig::ROT_C0_C1..Rig::TIME_OFFSET).filter(|_| is_known);
        axes.map(|k| {
            self.solve_for_rig(k);
            let seen = self.configured_variance(k) - self.solution[k];
            if seen > 0.0 { offset[k].abs() / seen.sqrt() } else { 0.0 }
        })
        .fold(0.0, Portable::at_least)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_room::Room;
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn it_is_that_part_of_the_inverse_of_the_normal_equations() {
        let mut window = Room::default().window();
        window.options.rig_mask.fill(1.0);
        window.optimize(3);
        assert!(window.factor.compute(&window.linearizer.equations, 0.0));
        let found = window.rig_covariance().unwrap();
        let equations = &window.linearizer.equations;
        let dim = window.factor.dim;
        let dense = DMatrix::from_fn(dim, dim, |i, j| {
            let (i, j) = (i.min(j), i.max(j));
            equations.row(i)[j - i]
        });
        let inverse = dense.try_inverse().unwrap();
        for i in 0..RIG_DIM {
            for j in 0..RIG_DIM {
                let scale = (inverse[(i, i)] * inverse[(j, j)]).sqrt();
                let error = (found[(i, j)] - inverse[(i, j)]) / scale;
                assert!(error.abs() < 1e-4, "{i} {j}: {error}");
            }
        }
    }

    #[test]
    fn a_pair_that_is_bent_contradicts_its_calibration_and_a_sound_one_does_not() {
        let mut window = Room { frames: 6, ..Room::default() }.window();
        window.optimize(3);
        assert!(window.factor.compute(&window.linearizer.equations, 0.0));
        assert!(window.pair_contradiction() < 1.0);
        for k in Rig::ROT_C0_C1..Rig::TIME_OFFSET {
            let turn = SVector::from_fn(|i, _| if i == k { 8.0 * window.options.rig_sigmas[k] } else { 0.0 });
            window.configured_rig = window.rig.plus(&turn);
            assert!(window.pair_contradiction() > 8.0, "{k}");
        }
    }

    #[test]
    fn a_reset_keeps_what_was_learnt_of_the_rig_and_nothing_that_was_not() {
        let mut window = Room { frames: 6, ..Room::default() }.window();
        window.optimize(3);
        assert!(window.factor.compute(&window.linearizer.equations, 0.0));
        let learnt = window.rig_covariance().unwrap();
        window.keep_rig();
        window.clear();
        let known = window.known_rig.information;
        let sigmas = window.options.rig_sigmas;
        let after = known.cholesky().expect("all of it is free").inverse();
        let mut shares = Vec::new();
        for k in 0..RIG_DIM {
            let (before, after) = (learnt[(k, k)].sqrt(), after[(k, k)].sqrt());
            assert!(
                after <= 1.0001 * sigmas[k] && after <= 3.0001 * before && after > before,
                "{k}: {before} {after}"
            );
            shares.push(after / sigmas[k]);
        }
        // The room shows the time offset to a fifth of what is configured, and nothing of the lever arm.
        assert!(shares[Rig::TIME_OFFSET] < 0.65 && shares[Rig::P_B_C0] > 0.99, "{shares:?}");
        // Another reset, of which nothing is to be kept, begins as configured.
        window.clear();
        assert_eq!(window.known_rig.information, KnownRig::within(&sigmas).information);
        assert_eq!(window.known_rig.gradient.norm(), 0.0);
    }

    #[test]
    fn before_the_first_solution_there_is_none() {
        let mut window = Room::default().window();
        assert_eq!(window.rig_covariance(), None);
    }
}
