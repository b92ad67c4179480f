//! The solver: damped Gauss-Newton over rig, frames and landmarks, a bounded number of steps.

use super::Window;
use super::eliminate::Eliminated;
use super::feature::Estimated;
use super::landmark::LandmarkStore;
use super::line::HostedLine;
use super::linearize::Purpose;
use super::motions::MotionRow;
use super::problem::Problem;
use super::reprojection::InversePoint;
use super::state::{FRAME_DIM, FrameMatrix, MAX_FRAMES, NavState, RIG_DIM, Rig, unknown_of_frame};
use crate::estimate::{BiasVariances, NavCovariance};
use nalgebra::SVector;
use plumbline_config::Portable;

/// A step that lowers the cost by less than this (in squared standard deviations, of points as stated) ends the iteration: it is far below what
/// noise adds to the cost of a single observation.
const SMALL_DECREASE: f64 = 0.02;
/// Damping after a rejected step, its growth by further ones and its decay by accepted ones.
pub(super) const FIRST_DAMPING: f64 = 1e-3;
const DAMPING_GROWTH: f64 = 30.0;
/// Less damping than this after a rejected step is none.
const LEAST_DAMPING: f64 = 1e-8;
const DAMPING_DECAY: f64 = 0.1;
/// Position, attitude and velocity: the parts of a frame's state whose covariance is given out.
const COVARIANCE_DIM: usize = NavState::BIAS_GYRO;

/// Outcome of a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Steps taken.
    pub iterations: u32,
    /// Robust cost at the end, in squared standard deviations.
    pub cost: f64,
    /// The normal equations could not be factored.
    pub is_not_positive_definite: bool,
}

/// States to return to when a step is rejected.
#[derive(Clone, Debug)]
pub struct Backup {
    rig: Rig,
    frames: Vec<NavState>,
    points: Vec<InversePoint>,
    lines: Vec<HostedLine>,
}

impl Backup {
    /// Room for `points` and `lines`.
    pub fn new(points: usize, lines: usize, rig: &Rig) -> Self {
        Self {
            rig: rig.clone(),
            frames: Vec::with_capacity(MAX_FRAMES),
            points: Vec::with_capacity(points),
            lines: Vec::with_capacity(lines),
        }
    }
}

impl Window {
    /// Improves all states by at most `max_iterations` steps of damped Gauss-Newton (Levenberg-Marquardt with the
    /// damping on the diagonal). Where the cost at the present states is no finite number, they stay as they are,
    /// there is no covariance, and the outcome is [`Outcome::is_not_positive_definite`].
    pub fn optimize(&mut self, max_iterations: usize) -> Outcome {
        self.refresh_anchor();
        self.unfinished = None;
        let mut outcome = Outcome { cost: self.linearize(0.0), ..Outcome::default() };
        if !outcome.cost.is_finite() {
            self.factor.dim = 0;
            return Outcome { is_not_positive_definite: true, ..outcome };
        }
        let (damping, is_lower) =
            if max_iterations > 0 { self.iterate(max_iterations, &mut outcome) } else { (0.0, true) };
        if damping > 0.0 || max_iterations == 0 {
            // The covariance is that of the undamped equations.
            let _ = self.linearize(0.0);
            outcome.is_not_positive_definite |= !self.factor.compute(&self.linearizer.equations, 0.0);
        }
        // The step of the newest frame that the equations still ask for.
        self.unfinished = (damping > 0.0 && !outcome.is_not_positive_definite).then(|| {
            let at = self.solve() - FRAME_DIM;
            SVector::from_column_slice(&self.solution[at..at + COVARIANCE_DIM])
        });
        self.adapt_damping(damping, is_lower);
        self.follow_lenses();
        outcome
    }

    /// Solves the equations last factored for the step that they ask for; returns the number of unknowns.
    fn solve(&mut self) -> usize {
        let gradient = self.linearizer.equations.gradient();
        for (x, g) in self.solution.iter_mut().zip(gradient) {
            *x = -g;
        }
        self.factor.solve(&mut self.solution[..gradient.len()]);
        gradient.len()
    }

    /// Where solutions on end need damping, the next one begins with as much as served the last: a few steps a frame do not
    /// find it anew each time.
    fn adapt_damping(&mut self, damping: f64, is_lower: bool) {
        self.first_damping = match (damping > 0.0, is_lower) {
            (false, _) => FIRST_DAMPING,
            (true, true) => (self.first_damping / DAMPING_GROWTH).at_least(LEAST_DAMPING),
            (true, false) => (self.first_damping * DAMPING_GROWTH).at_most(FIRST_DAMPING),
        };
    }

    /// Steps from the states just linearized, at least one, until one is small; returns the damping at the end, and whether the last step was
    /// kept.
    fn iterate(&mut self, max_iterations: usize, outcome: &mut Outcome) -> (f64, bool) {
        let mut damping = 0.0;
        let small = SMALL_DECREASE / self.options.point_sigma.squared();
        // Linearizations are what costs time: a rejected step takes two of them.
        let mut linearizations = 1;
        loop {
            outcome.iterations += 1;
            let decrease = self.find_step(damping);
            outcome.is_not_positive_definite |= decrease.is_none();
            let is_last =
                decrease.is_some_and(|decrease| decrease < small) || linearizations >= max_iterations;
            let is_lower = decrease.is_some() && self.is_step_lower(damping, is_last, &mut outcome.cost);
            if is_last {
                return (damping, is_lower);
            }
            damping = if is_lower { damping * DAMPING_DECAY } else { self.more(damping) };
            linearizations += 1;
            if !is_lower {
                linearizations += 1;
                let _ = self.linearize(damping);
            }
        }
    }

    /// Takes the step just found, and linearizes with `damping` where it ends unless it is the last; goes back where that raises the `cost`.
    fn is_step_lower(&mut self, damping: f64, is_last: bool, cost: &mut f64) -> bool {
        self.save();
        self.take_step();
        let now = if is_last { self.cost() } else { self.linearize(damping) };
        let is_lower = now <= *cost;
        if is_lower {
            *cost = now;
        } else {
            self.restore();
        }
        is_lower
    }

    /// Normal equations at the present states, landmarks damped; returns the cost.
    pub(super) fn linearize(&mut self, damping: f64) -> f64 {
        self.evaluate(Purpose::Equations { damping })
    }

    /// The cost at the present states.
    pub(super) fn cost(&mut self) -> f64 {
        self.evaluate(Purpose::Cost)
    }

    /// Every factor at the present states; returns the cost.
    pub(super) fn evaluate(&mut self, purpose: Purpose) -> f64 {
        let Self { rig, frames, points, lines, prior, linearizer, options, .. } = self;
        let frames = Problem::of_frames(rig, frames, options);
        let problem = Problem { points: points.all(), lines: lines.all(), ..frames };
        linearizer.evaluate(&problem, prior, purpose)
    }

    /// Solves for a step; returns the decrease of the cost that it predicts, or `None` when the equations cannot be solved.
    fn find_step(&mut self, damping: f64) -> Option<f64> {
        if !self.factor.compute(&self.linearizer.equations, damping) {
            return None;
        }
        self.solve();
        let gradient = self.linearizer.equations.gradient();
        Some(-0.5 * gradient.iter().zip(&self.solution).map(|(g, x)| g * x).sum::<f64>())
    }

    /// Takes the step just found.
    fn take_step(&mut self) {
        let dim = self.linearizer.equations.gradient().len();
        self.rig = self.rig.plus(&SVector::from_column_slice(&self.solution[..RIG_DIM]));
        for (k, frame) in self.frames.iter_mut().enumerate() {
            let at = unknown_of_frame(k);
            frame.nav = frame.nav.plus(&SVector::from_column_slice(&self.solution[at..at + FRAME_DIM]));
        }
        let motions = self.linearizer.lifts.motions_of(&self.solution[..dim]);
        move_landmarks(&mut self.points, &self.linearizer.points, &motions);
        move_landmarks(&mut self.lines, &self.linearizer.lines, &motions);
    }

    /// Damping after one more rejected step.
    fn more(&self, damping: f64) -> f64 {
        if damping == 0.0 { self.first_damping } else { damping * DAMPING_GROWTH }
    }

    fn save(&mut self) {
        self.backup.rig.clone_from(&self.rig);
        self.backup.frames.clear();
        self.backup.frames.extend(self.frames.iter().map(|f| f.nav.clone()));
        self.backup.points.clear();
        self.backup.points.extend(self.points.all().iter().map(|l| l.feature));
        self.backup.lines.clear();
        self.backup.lines.extend(self.lines.all().iter().map(|l| l.feature));
    }

    fn restore(&mut self) {
        self.rig.clone_from(&self.backup.rig);
        for (frame, nav) in self.frames.iter_mut().zip(&self.backup.frames) {
            frame.nav.clone_from(nav);
        }
        for (landmark, point) in self.points.all_mut().iter_mut().zip(&self.backup.points) {
            landmark.feature = *point;
        }
        for (landmark, line) in self.lines.all_mut().iter_mut().zip(&self.backup.lines) {
            landmark.feature = *line;
        }
    }

    /// Covariance of position, attitude and velocity of the newest frame (in the order of the error state, m, rad and
    /// m/s in `O`), and variance of the time offset (s²), by the last factorization. Where a solution ended before its time,
    /// what it still asked for counts as one standard deviation. `None` before the first, where that
    /// failed, after a cost that was no finite number, and where it is none itself.
    pub fn newest_covariance(&mut self) -> Option<(NavCovariance, f64)> {
        let of_frame = self.covariance_of_newest()?;
        let mut covariance = of_frame.fixed_view::<COVARIANCE_DIM, COVARIANCE_DIM>(0, 0).into_owned();
        if let Some(step) = &self.unfinished {
            covariance += step * step.transpose();
        }
        let time_offset = self.factor.variance(Rig::TIME_OFFSET, &mut self.solution);
        covariance.iter().all(|x| x.is_finite()).then_some((covariance, time_offset))
    }

    /// Variances of the biases of the newest frame by the last factorization; `None` as of [`Self::newest_covariance`].
    pub fn newest_bias_variances(&self) -> Option<BiasVariances> {
        let of_frame = self.covariance_of_newest()?;
        let variances = BiasVariances::from_fn(|k, _| of_frame[(COVARIANCE_DIM + k, COVARIANCE_DIM + k)]);
        variances.iter().all(|x| x.is_finite()).then_some(variances)
    }

    /// Covariance of the newest frame's state: its unknowns are the last of all.
    pub(crate) fn covariance_of_newest(&self) -> Option<FrameMatrix> {
        let is_whole = self.factor.dim == unknown_of_frame(self.frames.len());
        self.factor.last_covariance().filter(|_| is_whole && !self.frames.is_empty())
    }
}

/// Gives every landmark that took part its step, given those of the motions.
fn move_landmarks<F: Estimated<D>, const D: usize>(
    store: &mut LandmarkStore<F>,
    eliminated: &[Eliminated<D>],
    motions: &MotionRow,
) {
    for (landmark, entry) in store.all_mut().iter_mut().zip(eliminated) {
        if entry.is_used {
            landmark.feature = landmark.feature.plus(&entry.step(motions));
        }
    }
}

#[cfg(test)]
#[path = "solve_tests.rs"]
mod tests;
