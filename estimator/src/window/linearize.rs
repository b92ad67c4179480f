//! Linearization: factors at the present states become normal equations, landmarks eliminated.
//!
//! Landmarks are linearized in motions of cameras and frames, and the sum of all is lifted to rig and frames once
//! ([`super::motions`]). Each landmark's small block is eliminated as soon as its observations are summed
//! ([`super::eliminate`]).
//! Jacobians of frames in the prior are taken at their first estimates, residuals always at the present
//! state.

use super::camera_sums::CameraSums;
use super::dense::NormalEquations;
use super::eliminate::Eliminated;
use super::factor::{Linearization, RobustSum};
use super::feature::{Estimated, Feature, Jacobians};
use super::landmark::{Landmark, MAX_OBSERVATIONS};
use super::landmark_sums::{LandmarkSums, Rows};
use super::motions::{Lifts, MotionEquations};
use super::poses::Poses;
use super::prior::Prior;
use super::problem::Problem;
use super::state::{FRAME_DIM, FrameMatrix, Rig, unknown_of_frame};
use super::zero_velocity_factor::zero_velocity;
use nalgebra::SMatrix;

/// Information that keeps the bearing of a landmark regular, in squared standard deviations of a pixel.
pub(super) const LANDMARK_REGULARIZATION: f64 = 1e-6;

/// Purpose of evaluating the factors of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Purpose {
    /// Their cost alone.
    Cost,
    /// Normal equations, the landmarks' own blocks damped.
    Equations {
        /// Share of its diagonal that is added to a landmark's block.
        damping: f64,
    },
    /// Normal equations of what speaks of a frame that leaves the window.
    Leaving {
        /// Its index.
        frame: usize,
    },
}

/// Cost of the factors of frame `index` that `purpose` needs; their normal equations are added to `target`, if there is one.
fn evaluate_frame(
    problem: &Problem<'_>,
    index: usize,
    purpose: Purpose,
    mut target: Option<&mut NormalEquations>,
) -> f64 {
    let (needs_motion, needs_rest) = match purpose {
        Purpose::Leaving { frame } => (index == frame || index == frame + 1, index == frame),
        Purpose::Cost | Purpose::Equations { .. } => (true, true),
    };
    let mut cost = 0.0;
    if needs_motion {
        cost += motion(problem, index, target.as_deref_mut().map(|equations| (equations, index)));
    }
    if needs_rest {
        cost += zero_velocity(&problem.frames[index], target.map(|equations| (equations, index)));
    }
    cost
}

/// Cost of the inertial factor that leads to frame `index`, if there is one, in squared standard deviations. On request its
/// normal equations are added to `linearization`.
fn motion(problem: &Problem<'_>, index: usize, linearization: Option<(&mut NormalEquations, usize)>) -> f64 {
    let Some(from) = index.checked_sub(1).map(|before| &problem.frames[before]) else { return 0.0 };
    let to = &problem.frames[index];
    let Some(factor) = &to.inertial else { return 0.0 };
    let Some(information) = factor.information() else { return 0.0 };
    let (states, gravity_o) = ([&from.nav, &to.nav], &problem.options.gravity_o);
    let Some((equations, index)) = linearization else {
        let r = factor.residual(states, gravity_o, None);
        return 0.5 * (r.transpose() * information * r)[0];
    };
    let first = problem.options.first_estimates;
    let mut jacobians = [FrameMatrix::zeros(); 2];
    let at = [from.jacobian_state(first), to.jacobian_state(first)];
    let r = factor.residual(states, gravity_o, Some(Linearization { at, jacobians: &mut jacobians }));
    let [by_from, by_to] = jacobians;
    let (row, column) = (unknown_of_frame(index - 1), unknown_of_frame(index));
    // The information is symmetric; whole columns of a product are quicker than products of columns.
    let [weighted_from, weighted_to] = [&by_from, &by_to].map(|by| by.transpose() * information);
    equations.add_block(row, row, &(weighted_from * by_from));
    equations.add_block(row, column, &(weighted_from * by_to));
    equations.add_block(column, column, &(weighted_to * by_to));
    let gradient = equations.gradient_mut();
    let (g_from, g_to) = (weighted_from * r, weighted_to * r);
    for k in 0..FRAME_DIM {
        gradient[row + k] += g_from[k];
        gradient[column + k] += g_to[k];
    }
    0.5 * (r.transpose() * information * r)[0]
}

/// Normal equations of a window with all the memory that making them needs.
#[derive(Clone, Debug)]
pub struct Linearizer {
    /// The normal equations of rig and frames.
    pub equations: NormalEquations,
    landmarks: LandmarkEquations,
    pub(super) lifts: Lifts,
    /// One entry for each point, in the order of the store.
    pub points: Vec<Eliminated<3>>,
    /// One entry for each line, in the order of the store.
    pub lines: Vec<Eliminated<4>>,
    /// Poses at which it works.
    pub(super) poses: Poses,
}

impl Linearizer {
    /// Room for `unknowns`, `points` and `lines`.
    pub fn new(unknowns: usize, points: usize, lines: usize, rig: &Rig) -> Self {
        Self {
            equations: NormalEquations::new(unknowns),
            landmarks: LandmarkEquations::default(),
            lifts: Lifts::default(),
            points: vec![Eliminated::empty(); points],
            lines: vec![Eliminated::empty(); lines],
            poses: Poses::new(rig),
        }
    }

    /// Starts anew with no information about the rig and the frames of `problem`.
    fn begin(&mut self, problem: &Problem<'_>) {
        let frames = problem.frames.len();
        self.equations.reset(unknown_of_frame(frames));
        self.landmarks.motions.reset(frames, problem.options.lenses.is_some());
        self.landmarks.cameras.reset(frames, problem.options.cameras);
        self.landmarks.cost = 0.0;
        self.poses.refresh(problem.rig, problem.frames, problem.options.first_estimates);
        self.poses.lift(&mut self.lifts, frames, problem.options);
    }

    /// Evaluates every factor of the problem at its states; returns their cost, and leaves the normal equations unless the
    /// cost alone is asked for. This is the only list of factors.
    pub fn evaluate(&mut self, problem: &Problem<'_>, prior: &mut Prior, purpose: Purpose) -> f64 {
        let is_cost = purpose == Purpose::Cost;
        if is_cost {
            self.poses.refresh(problem.rig, problem.frames, problem.options.first_estimates);
        } else {
            self.begin(problem);
        }
        let mut target = (!is_cost).then_some(&mut self.equations);
        let mut cost = prior.evaluate(problem.rig, problem.frames, target.as_deref_mut());
        for index in 0..problem.frames.len() {
            cost += evaluate_frame(problem, index, purpose, target.as_deref_mut());
        }
        cost += self.evaluate_landmarks(problem, purpose);
        if !is_cost {
            self.lift_landmarks();
        }
        cost
    }

    /// Evaluates the factors of points and lines, each landmark eliminated; returns their robust cost.
    fn evaluate_landmarks(&mut self, problem: &Problem<'_>, purpose: Purpose) -> f64 {
        let (damping, host) = match purpose {
            Purpose::Cost => {
                return self.cost_of(problem, problem.points) + self.cost_of(problem, problem.lines);
            }
            Purpose::Equations { damping } => (damping, None),
            Purpose::Leaving { frame } => (0.0, Some(frame)),
        };
        let is_wanted = |by: u8| host.is_none_or(|host| usize::from(by) == host);
        let Self { points, lines, landmarks, poses, lifts, .. } = self;
        for (point, entry) in problem.points.iter().zip(points).filter(|(point, _)| is_wanted(point.host)) {
            landmarks.add(entry, (poses, lifts), problem, point, damping);
        }
        for (line, entry) in problem.lines.iter().zip(lines).filter(|(line, _)| is_wanted(line.host)) {
            landmarks.add(entry, (poses, lifts), problem, line, damping);
        }
        landmarks.cost
    }

    /// Moves the equations of the landmarks into the normal equations.
    fn lift_landmarks(&mut self) {
        let LandmarkEquations { motions, cameras, .. } = &mut self.landmarks;
        cameras.finish(&self.lifts, motions);
        motions.lift(&self.lifts, &mut self.equations);
    }

    /// Robust cost of landmarks at the poses last refreshed.
    fn cost_of<F: Feature>(&self, problem: &Problem<'_>, landmarks: &[Landmark<F>]) -> f64 {
        let of_each = landmarks.iter().filter(|l| l.is_triangulated).map(|landmark| {
            let placed = self.poses.placed(landmark);
            let mut costs = RobustSum::new(problem.options.cauchy_scale * F::sigma(problem.options));
            for observation in &landmark.observations {
                let measured = problem.moved_lenses.moved::<F>(observation);
                if let Some(r) = self.poses.residual::<F>(problem, &placed, (observation, &measured)) {
                    costs.add(r.norm_squared());
                }
            }
            costs.cost() * landmark.information(problem.frames, problem.options)
        });
        of_each.sum()
    }
}

/// Where landmarks go.
#[derive(Clone, Debug, Default)]
struct LandmarkEquations {
    /// Terms that elimination subtracts, and in the end all of them.
    motions: MotionEquations,
    /// Information of observations about the cameras.
    cameras: CameraSums,
    /// Robust cost of the landmarks.
    cost: f64,
}

/// Number of a camera of a frame among all cameras of the window.
fn camera_of(problem: &Problem<'_>, frame: u8, camera: u8) -> usize {
    usize::from(frame) * problem.options.cameras + usize::from(camera)
}

impl LandmarkEquations {
    /// Adds a landmark and eliminates it, its own block damped.
    fn add<F: Estimated<D>, const D: usize>(
        &mut self,
        entry: &mut Eliminated<D>,
        (poses, lifts): (&Poses, &Lifts),
        problem: &Problem<'_>,
        landmark: &Landmark<F>,
        damping: f64,
    ) {
        entry.reset(self.motions.dim);
        if !landmark.is_triangulated {
            return;
        }
        let host = camera_of(problem, landmark.host, landmark.host_camera);
        self.cameras.begin_host(host, lifts, &mut self.motions);
        let (now, first) = (poses.placed(landmark), poses.placed_first(landmark));
        let mut sums = LandmarkSums::<D>::default();
        let mut span = (usize::from(landmark.host), usize::from(landmark.host));
        // Residuals and weights first: divisions and roots of one need not wait for those of another.
        let mut seen = heapless::Vec::<_, MAX_OBSERVATIONS>::new();
        let mut costs = RobustSum::new(problem.options.cauchy_scale * F::sigma(problem.options));
        let information = landmark.information(problem.frames, problem.options);
        let root = information.sqrt();
        for observation in &landmark.observations {
            let measured = problem.moved_lenses.moved::<F>(observation);
            let Some(r) = poses.residual::<F>(problem, &now, (observation, &measured)) else { continue };
            let scale = costs.add(r.norm_squared()).sqrt() * root;
            // There is room for all.
            let _ = seen.push((observation, F::weighed(&measured, scale), r * scale, scale));
        }
        self.cost += costs.cost() * information;
        let (mut j, mut rows) = (Jacobians::zeros(), Rows::ZERO);
        for &(observation, ref measured, ref r, scale) in &seen {
            if poses.linearize(landmark, &first, (observation, measured), &mut j).is_none() {
                continue;
            }
            let target = camera_of(problem, observation.frame, observation.camera);
            let frame = usize::from(observation.frame);
            span = (span.0.min(frame), span.1.max(frame));
            let cameras = (landmark.host_camera, observation.camera);
            rows.set(&j, r, cameras, host == target);
            let by_lens = poses.by_lens::<F>(problem, &first, (observation, scale));
            self.cameras.add(target, &rows.by_camera, by_lens.as_ref());
            sums.add(&rows, frame, entry);
            if let Some(by_lens) = &by_lens {
                sums.add_lens(&rows, by_lens, usize::from(observation.camera));
            }
        }
        let mut own = sums.finish(entry, usize::from(landmark.host));
        own += SMatrix::<f64, D, D>::identity() * LANDMARK_REGULARIZATION;
        for k in 0..D {
            own[(k, k)] *= 1.0 + damping;
        }
        entry.eliminate(&mut self.motions, own, span);
    }
}

#[cfg(test)]
#[path = "linearize_tests.rs"]
mod tests;
