//! Linearization: factors at the present states become normal equations, landmarks eliminated.
//!
//! Landmarks are linearized in the poses of the cameras, and the sum of all is lifted to rig and frames once
//! ([`super::camera_poses`]). Each landmark's small block is eliminated as soon as its observations are summed
//! ([`super::eliminate`]).
//! Jacobians of frames in the prior are taken at their first estimates, residuals always at the present
//! state.

use super::camera_poses::{Lifts, MAX_CAMERA};
use super::dense::NormalEquations;
use super::eliminate::{Eliminated, MAX_LANDMARK_DIM, Scratch, eliminate};
use super::factor::{Linearization, cauchy};
use super::feature::{Estimated, Feature, Jacobians, StructuralJacobians};
use super::hessian_blocks::{Blocks, add_heading, rows};
use super::landmark::Landmark;
use super::options::Options;
use super::poses::Poses;
use super::problem::Problem;
use super::state::{
    FRAME_DIM, FrameMatrix, MAX_VISUAL, Rig, unknown_of_camera, unknown_of_frame, unknown_of_visual,
    visual_of_frame,
};
use super::zero_velocity_factor::zero_velocity;
use nalgebra::{SMatrix, Vector2};

/// Information that keeps the bearing of a landmark regular, in squared standard deviations of a pixel.
pub(super) const LANDMARK_REGULARIZATION: f64 = 1e-6;

/// Normal equations of a window with all the memory that making them needs.
#[derive(Clone, Debug)]
pub struct Linearizer {
    /// The normal equations of rig and frames.
    pub equations: NormalEquations,
    visual: NormalEquations,
    cameras: NormalEquations,
    lifts: Lifts,
    scratch: Scratch,
    /// One entry for each point, in the order of the store.
    pub points: Vec<Eliminated<3>>,
    /// The same for each line.
    pub lines: Vec<Eliminated<4>>,
    /// Poses at which it works.
    pub(super) poses: Poses,
}

impl Linearizer {
    /// Room for `unknowns`, `points` and `lines`.
    #[must_use]
    pub fn new(unknowns: usize, points: usize, lines: usize, rig: &Rig) -> Self {
        Self {
            equations: NormalEquations::new(unknowns),
            visual: NormalEquations::new(MAX_VISUAL),
            cameras: NormalEquations::new(MAX_CAMERA),
            lifts: Lifts::default(),
            scratch: [[0.0; MAX_VISUAL]; MAX_LANDMARK_DIM],
            points: vec![Eliminated::empty(); points],
            lines: vec![Eliminated::empty(); lines],
            poses: Poses::new(rig),
        }
    }

    /// Starts anew with no information about the rig and the frames of `problem`.
    pub fn begin(&mut self, problem: &Problem<'_>) {
        let frames = problem.frames.len();
        self.equations.reset(unknown_of_frame(frames));
        self.visual.reset(visual_of_frame(frames));
        self.cameras.reset(unknown_of_camera(problem.options.cameras * frames));
        self.poses.refresh(problem.rig, problem.frames, problem.options.first_estimates);
        self.poses.lift(&mut self.lifts, frames, problem.options);
    }

    /// Adds point `index` of the problem and eliminates it, its own block damped; returns its robust cost.
    pub fn add_point(&mut self, problem: &Problem<'_>, index: usize, damping: f64) -> f64 {
        let Self { points, visual, cameras, poses, lifts, scratch, .. } = self;
        let equations = Equations { visual, cameras, lifts, scratch };
        add_landmark(equations, &mut points[index], poses, problem, &problem.points[index], damping)
    }

    /// The same for line `index`.
    pub fn add_line(&mut self, problem: &Problem<'_>, index: usize, damping: f64) -> f64 {
        let Self { lines, visual, cameras, poses, lifts, scratch, .. } = self;
        let equations = Equations { visual, cameras, lifts, scratch };
        add_landmark(equations, &mut lines[index], poses, problem, &problem.lines[index], damping)
    }

    /// Adds the inertial factor that leads to frame `index`; returns its cost.
    pub fn add_motion(&mut self, problem: &Problem<'_>, index: usize) -> f64 {
        let [from, to] = [&problem.frames[index - 1], &problem.frames[index]];
        let Some(factor) = &to.inertial else { return 0.0 };
        let Some(information) = factor.information() else { return 0.0 };
        let first = problem.options.first_estimates;
        let mut jacobians = [FrameMatrix::zeros(); 2];
        let at = [from.jacobian_state(first), to.jacobian_state(first)];
        let linearization = Linearization { at, jacobians: &mut jacobians };
        let r = factor.residual([&from.nav, &to.nav], &problem.options.gravity_o, Some(linearization));
        let [by_from, by_to] = jacobians;
        let (row, column) = (unknown_of_frame(index - 1), unknown_of_frame(index));
        let weighted_from = by_from.tr_mul(information);
        let weighted_to = by_to.tr_mul(information);
        self.equations.add_block(row, row, &(weighted_from * by_from));
        self.equations.add_block(row, column, &(weighted_from * by_to));
        self.equations.add_block(column, column, &(weighted_to * by_to));
        let gradient = self.equations.gradient_mut();
        let (g_from, g_to) = (weighted_from * r, weighted_to * r);
        for k in 0..FRAME_DIM {
            gradient[row + k] += g_from[k];
            gradient[column + k] += g_to[k];
        }
        0.5 * (r.transpose() * information * r)[0]
    }

    /// Adds that the vehicle stands still in frame `index`, if it does; returns its cost.
    pub fn add_zero_velocity(&mut self, problem: &Problem<'_>, index: usize) -> f64 {
        let sigma = problem.options.still_sigma_m_s;
        zero_velocity(&problem.frames[index], sigma, Some((&mut self.equations, index)))
    }

    /// Moves the equations of the landmarks, reduced to rig, heading and poses, into the normal equations.
    pub fn finish(&mut self) {
        self.lifts.lift(&self.cameras, &mut self.visual);
        for i in 0..self.visual.dim() {
            let to = unknown_of_visual(i);
            for (k, value) in self.visual.row(i).iter().enumerate() {
                self.equations.add(to, unknown_of_visual(i + k), *value);
            }
            self.equations.gradient_mut()[to] += self.visual.gradient()[i];
        }
    }

    /// The robust cost of all factors but the prior, without linearizing.
    #[must_use]
    pub fn cost(&mut self, problem: &Problem<'_>) -> f64 {
        self.poses.refresh(problem.rig, problem.frames, problem.options.first_estimates);
        let mut cost = 0.0;
        cost += self.cost_of(problem, problem.points) + self.cost_of(problem, problem.lines);
        let Options { gravity_o, still_sigma_m_s, .. } = problem.options;
        for (index, frame) in problem.frames.iter().enumerate() {
            if let (Some(factor), true) = (&frame.inertial, index > 0)
                && let Some(information) = factor.information()
            {
                let r = factor.residual([&problem.frames[index - 1].nav, &frame.nav], gravity_o, None);
                cost += 0.5 * (r.transpose() * information * r)[0];
            }
            cost += zero_velocity(frame, *still_sigma_m_s, None);
        }
        cost
    }

    /// Robust cost of landmarks at the poses last refreshed.
    fn cost_of<F: Feature>(&self, problem: &Problem<'_>, landmarks: &[Landmark<F>]) -> f64 {
        let scale = problem.options.cauchy_scale;
        let mut cost = 0.0;
        for landmark in landmarks.iter().filter(|l| l.is_triangulated) {
            for observation in &landmark.observations {
                if let Some(r) = self.poses.residual(problem, landmark, observation, None) {
                    cost += cauchy(r.norm_squared(), scale).0;
                }
            }
            if let Some(r) = self.poses.structural_residual(problem, landmark, None) {
                cost += cauchy(r.norm_squared(), scale).0;
            }
        }
        cost
    }
}

/// Where landmarks go: their own blocks to the equations of the cameras, what elimination takes away to those of rig,
/// heading and poses.
struct Equations<'a> {
    visual: &'a mut NormalEquations,
    cameras: &'a mut NormalEquations,
    lifts: &'a Lifts,
    scratch: &'a mut Scratch,
}

/// Number of a camera of a frame among all cameras of the window.
fn camera_of(problem: &Problem<'_>, frame: u8, camera: u8) -> usize {
    usize::from(frame) * problem.options.cameras + usize::from(camera)
}

/// Adds a landmark and eliminates it, its own block damped; returns its robust cost.
fn add_landmark<F: Estimated<D>, const D: usize>(
    equations: Equations<'_>,
    entry: &mut Eliminated<D>,
    poses: &Poses,
    problem: &Problem<'_>,
    landmark: &Landmark<F>,
    damping: f64,
) -> f64 {
    entry.is_used = false;
    if !landmark.is_triangulated {
        return 0.0;
    }
    let Equations { visual, cameras, lifts, scratch } = equations;
    let host = camera_of(problem, landmark.host, landmark.host_camera);
    let dim = visual.dim();
    for row in &mut entry.by_visual {
        row[..dim].fill(0.0);
    }
    let mut sums = Blocks::<D>::default();
    let mut cost = 0.0;
    let mut span = (usize::from(landmark.host), usize::from(landmark.host));
    let mut j = Jacobians::zeros();
    for observation in &landmark.observations {
        let Some(r) = poses.residual(problem, landmark, observation, Some(&mut j)) else { continue };
        let target = camera_of(problem, observation.frame, observation.camera);
        let frame = usize::from(observation.frame);
        span = (span.0.min(frame), span.1.max(frame));
        let (c, weight) = cauchy(r.norm_squared(), problem.options.cauchy_scale);
        cost += c;
        let blocks = Blocks::of(&rows(&j, &r, weight.sqrt(), host != target));
        sums.add(&blocks);
        if host != target {
            blocks.add_target(cameras, (entry, lifts), (host, target));
        }
    }
    cost += add_structural(cameras, entry, &mut sums, poses, problem, landmark);
    sums.flush(cameras, (entry, lifts), host);
    let mut h_ll = sums.landmark() + SMatrix::<f64, D, D>::identity() * LANDMARK_REGULARIZATION;
    for k in 0..D {
        h_ll[(k, k)] *= 1.0 + damping;
    }
    let Some(cholesky) = h_ll.cholesky() else { return cost };
    entry.inverse = cholesky.inverse();
    entry.is_used = true;
    eliminate(visual, entry, &cholesky.l(), span, scratch);
    cost
}

/// Adds that a landmark lies along a direction of the Manhattan world, if it does; returns its robust cost.
fn add_structural<F: Estimated<D>, const D: usize>(
    cameras: &mut NormalEquations,
    entry: &mut Eliminated<D>,
    sums: &mut Blocks<D>,
    poses: &Poses,
    problem: &Problem<'_>,
    landmark: &Landmark<F>,
) -> f64 {
    let mut j = StructuralJacobians { feature: Jacobians::zeros(), heading: Vector2::zeros() };
    let Some(r) = poses.structural_residual(problem, landmark, Some(&mut j)) else { return 0.0 };
    let (cost, weight) = cauchy(r.norm_squared(), problem.options.cauchy_scale);
    let scale = weight.sqrt();
    let rows = rows(&j.feature, &r, scale, true);
    sums.add(&Blocks::of(&rows));
    let host = camera_of(problem, landmark.host, landmark.host_camera);
    add_heading(cameras, entry, &rows, &(j.heading * scale), host);
    cost
}

#[cfg(test)]
#[path = "linearize_tests.rs"]
mod tests;
