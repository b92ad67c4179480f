//! Slow random walk of the rig's calibration: what keeps systematic errors from becoming certainty.
//!
//! A rig is stiff, but what is estimated of it is not the rig alone: coloured forces, scale errors and a lens model that
//! fits only nearly act on its parameters like a calibration. They do not average out, and as a constant the rig would
//! gather information about itself without limit. Each refined parameter `x` therefore walks, `x' = x + w` with
//! `w ~ N(0, q)` and `q = floor² dt / memory`. The prior `d'Hd/2 + b'd` of [`super::prior`], `w` eliminated, becomes
//!
//! ```text
//! H' = H - h h' q / (1 + q H_kk)        b' = b - h b_k q / (1 + q H_kk)
//! ```
//!
//! with `h` column `k` of `H`. Directions that no measurement sees (`H n = 0`) stay unseen: `h'n = 0`.

use super::Window;
use super::state::{RIG_DIM, Rig};
use plumbline_config::{Portable, Timestamp};

/// Standard deviation that a parameter forgets within the memory time: about the repeatability of a careful calibration.
/// First unknown, number of unknowns, m, rad or s.
const FLOORS: [(usize, usize, f64); 5] = [
    (Rig::P_B_C0, 3, 1e-3),
    (Rig::ROT_B_C0, 3, 3e-4),
    (Rig::P_C0_C1, 3, 5e-5),
    (Rig::ROT_C0_C1, 3, 1e-4),
    (Rig::TIME_OFFSET, 1, 3e-4),
];

/// Random walk of the rig: its memory, and the time it has reached.
#[derive(Clone, Copy, Debug)]
pub(super) struct RigWalk {
    /// `rig.memory_s`; 0 for a rig that is a constant.
    memory_s: f64,
    /// Time up to which the prior has walked.
    walked_to: Option<Timestamp>,
}

impl RigWalk {
    /// Walk with a memory of `memory_s`; a constant for 0.
    pub(super) fn new(memory_s: f64) -> Self {
        Self { memory_s, walked_to: None }
    }

    /// Forgets since when.
    pub(super) fn clear(&mut self) {
        self.walked_to = None;
    }

    /// Share of `floor²` to walk by until `now`.
    fn advance(&mut self, now: Timestamp) -> f64 {
        let before = self.walked_to.replace(now);
        match before {
            Some(before) if self.memory_s > 0.0 => now.seconds_since(before).at_least(0.0) / self.memory_s,
            _ => 0.0,
        }
    }
}

impl Window {
    /// Lets the rig of the prior walk up to the time of the newest frame. A parameter whose configured standard deviation is
    /// below its floor walks by that instead; one that is held fixed does not walk.
    pub(super) fn walk_rig(&mut self) {
        let Some(newest) = self.frames.last() else { return };
        let share = self.rig_walk.advance(newest.stamp);
        if share == 0.0 {
            return;
        }
        for (first, count, floor) in FLOORS {
            for k in first..first + count {
                let sigma = self.options.rig_sigmas[k].at_most(floor);
                self.prior.equations.walk(k, sigma * sigma * share);
            }
        }
    }
}

/// Every parameter of the rig has its floor.
const _: () = {
    let (mut at, mut k) = (0, 0);
    while k < FLOORS.len() {
        assert!(FLOORS[k].0 == at);
        at += FLOORS[k].1;
        k += 1;
    }
    assert!(at == RIG_DIM);
};

#[cfg(test)]
mod tests {
    use super::super::dense::NormalEquations;
    use super::super::test_room::Room;
    use super::*;
    use nalgebra::DMatrix;

    fn dense(equations: &NormalEquations) -> DMatrix<f64> {
        DMatrix::from_fn(equations.dim(), equations.dim(), |i, j| equations.get(i, j))
    }

    #[test]
    fn a_walk_adds_its_variance_to_the_parameter_and_moves_no_mean() {
        let mut equations = NormalEquations::new(6);
        equations.reset(6);
        for i in 0..6 {
            for j in i..6 {
                equations.add(i, j, 1.0 / (1.0 + (j - i) as f64));
            }
            equations.add(i, i, 2.0 + i as f64);
            equations.gradient_mut()[i] = 0.3 * i as f64 - 0.7;
        }
        let solve = |equations: &NormalEquations| {
            let inverse = dense(equations).try_inverse().expect("is regular");
            let gradient = nalgebra::DVector::from_column_slice(equations.gradient());
            (-(&inverse * gradient), inverse)
        };
        let (mean, covariance) = solve(&equations);
        equations.walk(2, 0.05);
        let (walked_mean, walked) = solve(&equations);
        assert!((walked_mean - mean).norm() < 1e-12);
        let mut expected = covariance;
        expected[(2, 2)] += 0.05;
        assert!((walked - expected).norm() < 1e-12);
    }

    #[test]
    fn the_rig_is_never_better_known_than_its_memory_allows() {
        let second = |k: i64| Timestamp::from_nanos(k * 1_000_000_000);
        for memory_s in [30.0, 0.0] {
            let mut window = Room::default().window();
            window.rig_walk = RigWalk::new(memory_s);
            let k = Rig::ROT_B_C0;
            for time in 0..600 {
                window.frames.last_mut().expect("there is one").stamp = second(time);
                window.walk_rig();
                // A measurement a second, as good as the floor.
                window.prior.equations.add(k, k, 1.0 / (3e-4 * 3e-4));
            }
            let sigma = window.prior.equations.get(k, k).powf(-0.5) / 3e-4;
            // Steady state: variance = sqrt(q / information rate), here 30^-1/4 = 0.43 floors.
            let expected = if memory_s > 0.0 { 0.43 } else { 600.0_f64.powf(-0.5) };
            assert!((sigma / expected - 1.0).abs() < 0.15, "{memory_s}: {sigma}");
        }
    }

    #[test]
    fn what_is_held_fixed_does_not_walk() {
        let mut window = Room::default().window();
        window.options.rig_sigmas[Rig::TIME_OFFSET] = 0.0;
        window.rig_walk = RigWalk::new(30.0);
        window.prior.equations.add(Rig::TIME_OFFSET, Rig::TIME_OFFSET, 1e8);
        let before = window.prior.equations.get(Rig::TIME_OFFSET, Rig::TIME_OFFSET);
        for time in 1..10 {
            window.frames.last_mut().expect("there is one").stamp =
                Timestamp::from_nanos(time * 1_000_000_000);
            window.walk_rig();
        }
        assert_eq!(
            window.prior.equations.get(Rig::TIME_OFFSET, Rig::TIME_OFFSET).to_bits(),
            before.to_bits()
        );
    }
}
