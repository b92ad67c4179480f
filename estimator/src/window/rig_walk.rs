//! Slow walk of the rig's calibration: what keeps systematic errors from becoming certainty.
//!
//! A rig is stiff, but what is estimated of it is not the rig alone: coloured forces, scale errors and a lens model that
//! fits only nearly act on its parameters like a calibration. They do not average out, and as a constant the rig would
//! gather information about itself without limit. Each refined parameter `x`, counted from its configured value, is
//! therefore an Ornstein-Uhlenbeck process, `x' = a x + w` with `w ~ N(0, q)`, of the configured standard deviation `s`:
//!
//! ```text
//! q = floor² dt / memory        a² = 1 - q / s²
//! ```
//!
//! Where nothing is measured its variance becomes `s²`, and its mean the configured value. The prior `d'Hd/2 + b'd` of
//! [`super::prior`], whose steps `d` begin `e` from the configured rig, is written in the steps `d'` after `dt`,
//! `d_k = (d'_k + e_k) / a - e_k`; then `w` is eliminated:
//!
//! ```text
//! H' = H - h h' q / (1 + q H_kk)        b' = b - h b_k q / (1 + q H_kk)
//! ```
//!
//! with `h` column `k` of `H`. Directions that no measurement sees (`H n = 0`, `n` without a share of the rig) stay unseen.
//!
//! A configured value that measurements refute, by more than some standard deviations, loses weight as under a
//! Cauchy kernel: good calibrations may have tight priors, and a wrong one does not bend the estimate for long.
//!
//! A tight prior hides for long that it is wrong: `x` hardly moves. But it moves by more than it may. With the variance `P`
//! of its error, `x` varies by `s² - P` if the prior holds, and the data alone put it at `d = x s² / (s² - P)`. Focal
//! length and baseline, which make the scale of all motions and turns, are refuted by the innovation `x / sqrt(s² - P)`, and their
//! prior becomes `N(0, d²)`, of which one `d` is the most likely draw: what was inferred under the old one follows, and is as
//! uncertain as it is.

use super::Window;
use super::state::{INTRINSICS_DIM, RIG_DIM, Rig};
use crate::geometry::exp_so3;
use nalgebra::{SVector, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Parameters that walk alike.
struct Floor {
    /// First unknown, and number of unknowns.
    unknowns: (usize, usize),
    /// Standard deviation that is forgotten within the memory time, m, rad, s or focal lengths: about the repeatability of a careful
    /// calibration.
    sigma: f64,
    /// Memory time against `rig.memory_s`.
    memory: f64,
}

const fn floor(first: usize, count: usize, sigma: f64, memory: f64) -> Floor {
    Floor { unknowns: (first, count), sigma, memory }
}

/// Memory of what ties the cameras to each other: no error of the IMU acts on it.
const PAIR_MEMORY: f64 = 20.0;
const FLOORS: [Floor; 6] = [
    floor(Rig::P_B_C0, 3, 1e-3, 1.0),
    floor(Rig::ROT_B_C0, 3, 3e-4, 1.0),
    floor(Rig::P_C0_C1, 3, 5e-5, PAIR_MEMORY),
    floor(Rig::ROT_C0_C1, 3, 1e-4, PAIR_MEMORY),
    floor(Rig::TIME_OFFSET, 1, 3e-4, 1.0),
    floor(Rig::INTRINSICS, 2 * INTRINSICS_DIM, 1e-4, PAIR_MEMORY),
];

/// Distance of a parameter from its configured value up to which that has its full weight, in standard deviations.
const REFUTED_SIGMAS: f64 = 2.5;

/// Innovation that refutes a configured value, in standard deviations. Sound flights before low texture, where errors of matches
/// are alike, reach 4 to 5, others 2.5.
const INNOVATION_SIGMAS: f64 = 5.0;

/// Error of a focal length or baseline, as a share, that counts as a wrong one. Sound flights before low texture reach 0.009.
const LEAST_OFF: f64 = 0.03;

/// Share of the configured variance that data explain before they judge it: known a hundred times less well than it is configured, a baseline
/// is what the errors of a start in motion make of it.
const LEAST_EXPLAINED: f64 = 1e-4;

/// Largest share of a parameter's configured variance that it walks by at once.
const MAX_SHARE: f64 = 0.9;

/// Walk of the rig: its memory, and the time it has reached.
#[derive(Clone, Copy, Debug)]
pub(super) struct RigWalk {
    /// `rig.memory_s`; 0 for a rig that is a constant.
    memory_s: f64,
    /// Time up to which the prior has walked.
    walked_to: Option<Timestamp>,
    /// Share of the configured information that each parameter of the prior still has.
    weights: SVector<f64, RIG_DIM>,
    /// Error of focal length and baseline by the frame before, where that refuted the configured value, else 0: a single solution that has not
    /// settled proves nothing.
    refuted_before: [f64; 2],
}

impl RigWalk {
    /// Walk with a memory of `memory_s`; a constant for 0.
    pub(super) fn new(memory_s: f64) -> Self {
        Self { memory_s, walked_to: None, weights: SVector::repeat(1.0), refuted_before: [0.0; 2] }
    }

    /// Forgets since when, and what was refuted.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.memory_s);
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
        self.doubt_configured_rig();
        let offsets = self.prior.rig.minus(&self.configured_rig);
        for Floor { unknowns: (first, count), sigma: floor, memory } in FLOORS {
            for k in first..first + count {
                let configured = self.options.rig_sigmas[k] / self.rig_walk.weights[k].sqrt();
                if configured > 0.0 {
                    let walked = configured.at_most(floor) / configured;
                    let share = (walked * walked * share / memory).at_most(MAX_SHARE);
                    self.prior.equations.shrink(k, (1.0 - share).sqrt(), offsets[k]);
                    self.prior.equations.walk(k, configured * configured * share);
                }
            }
        }
    }

    /// Begins anew with cameras that may have been turned on the body so that they show turns `turned` by so much, rad: turned back by it, and as
    /// uncertain.
    pub fn doubt_mounting(&mut self, turned: &Vector3<f64>) {
        for k in Rig::ROT_B_C0..Rig::ROT_B_C0 + 3 {
            let sigma = &mut self.options.rig_sigmas[k];
            *sigma = if *sigma > 0.0 { sigma.at_least(turned.norm()) } else { 0.0 };
        }
        let rot_b_c0 = exp_so3(&-turned) * self.rig.pose_b_c0.rotation;
        self.restore_rig();
        self.rig.pose_b_c0.rotation = rot_b_c0;
        self.clear();
    }

    /// Takes from the prior what the configured intrinsics and the configured pair say of parameters that are far from it.
    fn doubt_configured_rig(&mut self) {
        let offsets = self.rig.minus(&self.assumed_rig);
        let pair = Rig::P_C0_C1..Rig::TIME_OFFSET;
        let sigmas = self.options.rig_sigmas;
        for k in pair.chain(Rig::INTRINSICS..RIG_DIM).filter(|k| sigmas[*k] > 0.0) {
            let far = offsets[k].abs() / (REFUTED_SIGMAS * sigmas[k]);
            self.weigh_configured(k, 1.0 / far.at_least(1.0).squared());
        }
    }

    /// True if a focal length or the baseline is far from the configured one.
    pub fn is_rig_refuted(&self) -> bool {
        let (offsets, sigmas) = (self.rig.minus(&self.configured_rig), &self.options.rig_sigmas);
        let p_c0_c1 = &self.configured_rig.pose_c0_c1.translation.vector;
        let of_baseline = offsets.fixed_rows::<3>(Rig::P_C0_C1).dot(p_c0_c1) / p_c0_c1.norm_squared();
        let is_far = |off: f64, sigma: f64| off.abs() > LEAST_OFF.at_least(INNOVATION_SIGMAS * sigma);
        [0, 1].map(Rig::of_lens).into_iter().any(|k| is_far(offsets[k], sigmas[k]))
            || is_far(of_baseline, sigmas[Rig::P_C0_C1] / p_c0_c1.norm())
    }

    /// Widens the priors of focal length and baseline where the newest two solutions refute them.
    pub fn refute_configured_rig(&mut self) {
        let mut focal = SVector::<f64, RIG_DIM>::zeros();
        // The pair ties its lenses to each other: apart, either looks as well known as its prior makes the other.
        [0, 1].into_iter().for_each(|camera| focal[Rig::of_lens(camera)] = std::f64::consts::FRAC_1_SQRT_2);
        let mut baseline = SVector::<f64, RIG_DIM>::zeros();
        let p_c0_c1 = self.configured_rig.pose_c0_c1.translation.vector;
        baseline.fixed_rows_mut::<3>(Rig::P_C0_C1).copy_from(&p_c0_c1.try_normalize(0.0).unwrap_or_default());
        // Forces have errors of scale themselves.
        let tested = [(focal, 0.0), (baseline, LEAST_OFF * p_c0_c1.norm())];
        for (which, (along, least)) in tested.into_iter().enumerate() {
            let off = self
                .refuted_by(&along)
                .filter(|off| off.abs() > least && !self.is_of_accelerometer(off * along.dot(&baseline)));
            let before = std::mem::replace(&mut self.rig_walk.refuted_before[which], off.unwrap_or_default());
            if let Some(off) = off.filter(|off| off * before > 0.0) {
                for k in (0..RIG_DIM).filter(|k| along[*k] != 0.0) {
                    self.weigh_configured(k, (self.options.rig_sigmas[k] / off).squared());
                }
            }
        }
    }

    /// Distance of the rig from the configured one, as the data alone have it, in the direction `along` if they refute that.
    fn refuted_by(&mut self, along: &SVector<f64, RIG_DIM>) -> Option<f64> {
        let Self { options, rig_walk, factor, solution, .. } = self;
        let variances = options.rig_sigmas.map(f64::squared).component_div(&rig_walk.weights);
        let prior = along.component_mul(along).dot(&variances);
        if factor.dim < RIG_DIM || prior == 0.0 {
            return None;
        }
        solution[..factor.dim].fill(0.0);
        solution[..RIG_DIM].copy_from_slice(along.as_slice());
        factor.solve(&mut solution[..factor.dim]);
        let explained = prior - along.dot(&SVector::from_column_slice(&solution[..RIG_DIM]));
        let offset = along.dot(&self.rig.minus(&self.assumed_rig));
        let is_refuted =
            explained > LEAST_EXPLAINED * prior && offset.abs() > INNOVATION_SIGMAS * explained.sqrt();
        is_refuted.then(|| offset * prior / explained)
    }

    /// True if an accelerometer that reads a multiple is the better explanation of a baseline that is longer by `off`, m: it would read as much too
    /// much of gravity, which becomes its bias.
    fn is_of_accelerometer(&self, off: f64) -> bool {
        let Some(newest) = self.frames.last() else { return false };
        let share = off / self.configured_rig.pose_c0_c1.translation.vector.norm();
        let of_gravity = -newest.nav.rot_o_b.inverse_transform_vector(&self.options.gravity_o) * share;
        newest.nav.bias_accel.dot(&of_gravity) > 0.5 * of_gravity.norm_squared()
    }

    /// Leaves the configured value of parameter `k` this share of its information, unless it has less.
    fn weigh_configured(&mut self, k: usize, weight: f64) {
        let lost = (self.rig_walk.weights[k] - weight) / self.options.rig_sigmas[k].squared();
        if lost > 0.0 {
            self.rig_walk.weights[k] = weight;
            let by = lost * self.prior.rig.minus(&self.assumed_rig)[k];
            self.prior.equations.add(k, k, -lost);
            self.prior.equations.gradient_mut()[k] -= by;
            // Until a keyframe leaves, the prior is made anew of what was known at the start.
            self.known_rig.information[(k, k)] -= lost;
            self.known_rig.gradient[k] -= by;
        }
    }
}

/// Every parameter of the rig has its floor.
const _: () = {
    let (mut at, mut k) = (0, 0);
    while k < FLOORS.len() {
        assert!(FLOORS[k].unknowns.0 == at);
        at += FLOORS[k].unknowns.1;
        k += 1;
    }
    assert!(at == RIG_DIM);
};

#[cfg(test)]
mod tests {
    use super::super::calibration::KnownRig;
    use super::super::dense::NormalEquations;
    use super::super::test_room::Room;
    use super::*;
    use nalgebra::{DMatrix, DVector};

    fn dense(equations: &NormalEquations) -> DMatrix<f64> {
        DMatrix::from_fn(equations.dim(), equations.dim(), |i, j| equations.get(i, j))
    }

    /// Equations of six unknowns that hang together.
    fn six_unknowns() -> NormalEquations {
        let mut equations = NormalEquations::new(6);
        equations.reset(6);
        for i in 0..6 {
            for j in i..6 {
                equations.add(i, j, 1.0 / (1.0 + (j - i) as f64));
            }
            equations.add(i, i, 2.0 + i as f64);
            equations.gradient_mut()[i] = 0.3 * i as f64 - 0.7;
        }
        equations
    }

    /// Their solution, and its covariance.
    fn solve(equations: &NormalEquations) -> (DVector<f64>, DMatrix<f64>) {
        let inverse = dense(equations).try_inverse().expect("is regular");
        let gradient = DVector::from_column_slice(equations.gradient());
        (-(&inverse * gradient), inverse)
    }

    #[test]
    fn a_walk_adds_its_variance_to_the_parameter_and_moves_no_mean() {
        let mut equations = six_unknowns();
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
    fn a_parameter_relaxes_like_its_exact_filter() {
        let second = |k: i64| Timestamp::from_nanos(k * 1_000_000_000);
        let (mut window, k) = (Room::default().window(), Rig::ROT_C0_C1 + 1);
        window.rig_walk = RigWalk::new(2.0);
        let (sigma, floor) = (3e-4, 1e-4);
        window.options.rig_sigmas.fill(sigma);
        window.configured_rig = window.prior.rig.clone();
        window.assumed_rig = window.prior.rig.clone();
        window.rig = window.configured_rig.clone();
        let offset = 4e-4;
        window.prior.rig =
            window.configured_rig.plus(&SVector::from_fn(|i, _| if i == k { offset } else { 0.0 }));
        // Better known at first than in the end, and less well.
        for first in [5e-5_f64, 2e-3] {
            window.prior.equations.reset(window.prior.equations.dim());
            window.prior.equations.add(k, k, first.powi(-2));
            window.rig_walk.clear();
            let (mut variance, mut mean) = (first * first, offset);
            for time in 0..4000 {
                window.frames.last_mut().expect("there is one").stamp = second(time);
                window.walk_rig();
                if time > 0 {
                    let q = floor * floor / (2.0 * PAIR_MEMORY);
                    let a = (1.0 - q / (sigma * sigma)).sqrt();
                    (variance, mean) = (a * a * variance + q, a * mean);
                }
                let information = window.prior.equations.get(k, k);
                let at = offset - window.prior.equations.gradient()[k] / information;
                assert!((information * variance - 1.0).abs() < 1e-6, "{first} {time}: {information}");
                assert!((at - mean).abs() < 1e-9, "{first} {time}: {at} {mean}");
            }
            assert!((variance.sqrt() / sigma - 1.0).abs() < 1e-3 && mean.abs() < 1e-2 * offset);
        }
    }

    #[test]
    fn what_ties_a_parameter_to_others_relaxes_with_it() {
        let mut equations = six_unknowns();
        let (mean, covariance) = solve(&equations);
        let (a, offset) = (0.8, 0.4);
        equations.shrink(2, a, offset);
        let (shrunk_mean, shrunk) = solve(&equations);
        let mut by = DMatrix::identity(6, 6);
        by[(2, 2)] = a;
        let mut expected = mean;
        expected[2] = a * (expected[2] + offset) - offset;
        assert!((shrunk_mean - expected).norm() < 1e-12);
        assert!((shrunk - &by * covariance * &by).norm() < 1e-12);
    }

    #[test]
    fn a_refuted_value_bends_the_estimate_less() {
        let mut window = Room::default().window();
        window.rig_walk = RigWalk::new(1e9);
        let (k, sigma) = (Rig::INTRINSICS, window.options.rig_sigmas[Rig::INTRINSICS]);
        window.configured_rig = window.rig.clone();
        window.assumed_rig = window.rig.clone();
        window.prior.start(&window.configured_rig.clone(), &window.known_rig.clone());
        // Measured ten standard deviations off, three times as well as configured.
        let (off, information) = (10.0 * sigma, 9.0 / (sigma * sigma));
        window.prior.equations.add(k, k, information);
        window.prior.equations.gradient_mut()[k] -= information * off;
        let mut found = 0.0;
        for time in 0..5 {
            found = -window.prior.equations.gradient()[k] / window.prior.equations.get(k, k);
            let step = SVector::from_fn(|i, _| if i == k { found } else { 0.0 });
            window.rig = window.configured_rig.plus(&step);
            window.frames.last_mut().expect("there is one").stamp =
                Timestamp::from_nanos((1 + time) * 1_000_000_000);
            window.walk_rig();
        }
        // The full prior would hold it a tenth of the way back.
        assert!((found / off - 1.0).abs() < 0.01, "{found} of {off}");
        assert!(window.prior.equations.get(k, k) > information);
    }

    /// Puts the rig where the prior has it; returns the common focal length under the prior of the window, and its standard deviation, in those configured.
    fn solve_focal(window: &mut Window) -> (f64, f64) {
        let sigma = window.options.rig_sigmas[Rig::INTRINSICS];
        let (mean, covariance) = solve(&window.prior.equations);
        assert!(window.factor.compute(&window.prior.equations, 0.0));
        window.rig = window.prior.rig.plus(&SVector::from_fn(|k, _| mean[k]));
        let [a, b] = [Rig::of_lens(0), Rig::of_lens(1)];
        let variance = covariance[(a, a)] + 2.0 * covariance[(a, b)] + covariance[(b, b)];
        (0.5 * (mean[a] + mean[b]) / sigma, 0.5 * variance.sqrt() / sigma)
    }

    #[test]
    fn a_tight_prior_gives_way_to_data_that_refute_it() {
        for (off, is_refuted, is_wrong) in [(-200.0, true, true), (60.0, true, false), (48.0, false, false)] {
            let mut window = Room::default().window();
            window.options.rig_sigmas.fill(2e-4);
            window.configured_rig = window.rig.clone();
            window.assumed_rig = window.rig.clone();
            window.known_rig = KnownRig::within(&window.options.rig_sigmas);
            window.prior.start(&window.rig.clone(), &window.known_rig.clone());
            // The focal length is measured to ten sigmas, that both lenses have the same to a tenth of one.
            let of_data = |sigmas: f64| (sigmas * 2e-4).powi(-2);
            let [a, b] = [Rig::of_lens(0), Rig::of_lens(1)];
            for (i, j, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0)] {
                let equations = &mut window.prior.equations;
                equations.add(i, j, 0.25 * of_data(10.0) * sign * sign + sign * of_data(0.1));
                equations.gradient_mut()[i] -= if i == j { 0.5 * of_data(10.0) * off * 2e-4 } else { 0.0 };
            }
            let before = window.prior.equations.get(a, a);
            assert!(solve_focal(&mut window).0.abs() < 1.0);
            window.refute_configured_rig();
            assert_eq!(window.prior.equations.get(a, a), before, "by a single solution");
            window.refute_configured_rig();
            let (found, sigma) = solve_focal(&mut window);
            assert_eq!(window.prior.equations.get(a, a) < before, is_refuted, "{off}");
            assert_eq!(
                (found / off - 1.0).abs() < 0.1 && (9.0..10.5).contains(&sigma),
                is_refuted,
                "{off}: {found} {sigma}"
            );
            assert_eq!(window.is_rig_refuted(), is_wrong, "{off}");
        }
    }

    #[test]
    fn a_start_anew_with_the_rig_that_was_found_tells_nothing_against_the_configured_one() {
        let mut window = Room::default().window();
        window.configured_rig = window.rig.clone();
        window.options.rig_sigmas.fill(2e-4);
        // Four standard deviations, by data that are gone.
        let found = SVector::from_fn(|k, _| if k >= Rig::INTRINSICS { 8e-4 } else { 0.0 });
        window.rig = window.configured_rig.plus(&found);
        window.clear();
        let k = Rig::of_lens(0);
        let before = window.prior.equations.get(k, k);
        window.doubt_configured_rig();
        assert_eq!(window.prior.equations.get(k, k).to_bits(), before.to_bits());
    }

    #[test]
    fn a_baseline_that_is_off_by_no_more_than_forces_are_does_not_give_way() {
        for (share, is_refuted) in [(0.02, false), (-0.02, false), (0.05, true), (-0.05, true)] {
            let mut window = Room::default().window();
            window.options.rig_sigmas.fill(2e-5);
            window.configured_rig = window.rig.clone();
            window.assumed_rig = window.rig.clone();
            window.known_rig = KnownRig::within(&window.options.rig_sigmas);
            window.prior.start(&window.rig.clone(), &window.known_rig.clone());
            let p_c0_c1 = window.rig.pose_c0_c1.translation.vector;
            let k = Rig::P_C0_C1 + p_c0_c1.iamax();
            // Measured to ten times the configured standard deviation.
            window.prior.equations.add(k, k, 2e-4_f64.powi(-2));
            window.prior.equations.gradient_mut()[k] -= share * p_c0_c1.norm() * 2e-4_f64.powi(-2);
            let before = window.prior.equations.get(k, k);
            let _ = solve_focal(&mut window);
            (0..2).for_each(|_| window.refute_configured_rig());
            assert_eq!(window.prior.equations.get(k, k) < before, is_refuted, "{share}");
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
