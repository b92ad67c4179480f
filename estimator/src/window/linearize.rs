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
use super::feature::{Estimated, Feature, Jacobians, StructuralJacobians};
use super::landmark::{Landmark, MAX_OBSERVATIONS};
use super::landmark_sums::{LandmarkSums, Rows};
use super::motions::{Lifts, MotionEquations};
use super::options::Options;
use super::poses::Poses;
use super::problem::Problem;
use super::state::{FRAME_DIM, FrameMatrix, Rig, unknown_of_frame};
use super::zero_velocity_factor::zero_velocity;
use nalgebra::{SMatrix, Vector2};

/// Information that keeps the bearing of a landmark regular, in squared standard deviations of a pixel.
pub(super) const LANDMARK_REGULARIZATION: f64 = 1e-6;

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
    #[must_use]
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
    pub fn begin(&mut self, problem: &Problem<'_>) {
        let frames = problem.frames.len();
        self.equations.reset(unknown_of_frame(frames));
        self.landmarks.motions.reset(frames);
        self.landmarks.cameras.reset(frames, problem.options.cameras);
        self.landmarks.costs = RobustSum::new(problem.options.cauchy_scale);
        self.poses.refresh(problem.rig, problem.frames, problem.options.first_estimates);
        self.poses.lift(&mut self.lifts, frames, problem.options);
    }

    /// Adds point `index` of the problem and eliminates it, its own block damped.
    pub fn add_point(&mut self, problem: &Problem<'_>, index: usize, damping: f64) {
        let Self { points, landmarks, poses, lifts, .. } = self;
        landmarks.add(&mut points[index], (poses, lifts), problem, &problem.points[index], damping);
    }

    /// Adds line `index` of the problem and eliminates it, its own block damped.
    pub fn add_line(&mut self, problem: &Problem<'_>, index: usize, damping: f64) {
        let Self { lines, landmarks, poses, lifts, .. } = self;
        landmarks.add(&mut lines[index], (poses, lifts), problem, &problem.lines[index], damping);
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
        // The information is symmetric; whole columns of a product are quicker than products of columns.
        let [weighted_from, weighted_to] = [&by_from, &by_to].map(|by| by.transpose() * information);
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

    /// Moves the equations of the landmarks into the normal equations; returns their robust cost.
    pub fn finish(&mut self) -> f64 {
        let LandmarkEquations { motions, cameras, costs } = &mut self.landmarks;
        cameras.finish(&self.lifts, motions);
        motions.lift(&self.lifts, &mut self.equations);
        costs.cost()
    }

    /// The robust cost of all factors but the prior, without linearizing.
    #[must_use]
    pub fn cost(&mut self, problem: &Problem<'_>) -> f64 {
        self.poses.refresh(problem.rig, problem.frames, problem.options.first_estimates);
        let mut costs = RobustSum::new(problem.options.cauchy_scale);
        self.add_costs(problem, problem.points, &mut costs);
        self.add_costs(problem, problem.lines, &mut costs);
        let mut cost = costs.cost();
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

    /// Adds the robust costs of landmarks at the poses last refreshed.
    fn add_costs<F: Feature>(&self, problem: &Problem<'_>, landmarks: &[Landmark<F>], costs: &mut RobustSum) {
        for landmark in landmarks.iter().filter(|l| l.is_triangulated) {
            let placed = self.poses.placed(landmark);
            for observation in &landmark.observations {
                if let Some(r) = self.poses.residual::<F>(problem, &placed, observation) {
                    costs.add(r.norm_squared());
                }
            }
            if let Some(r) = self.poses.structural_residual(problem, landmark, None) {
                costs.add(r.norm_squared());
            }
        }
    }
}

/// Where landmarks go.
#[derive(Clone, Debug)]
struct LandmarkEquations {
    /// What elimination takes away, and in the end all of it.
    motions: MotionEquations,
    /// What observations tell of the cameras.
    cameras: CameraSums,
    costs: RobustSum,
}

impl Default for LandmarkEquations {
    /// Room for any window.
    fn default() -> Self {
        Self {
            motions: MotionEquations::default(),
            cameras: CameraSums::default(),
            costs: RobustSum::new(1.0),
        }
    }
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
        entry.reset(self.motions.dim());
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
        for observation in &landmark.observations {
            let Some(r) = poses.residual::<F>(problem, &now, observation) else { continue };
            let scale = self.costs.add(r.norm_squared()).sqrt();
            // There is room for all.
            let _ = seen.push((observation, r * scale, scale));
        }
        let (mut j, mut rows) = (Jacobians::zeros(), Rows::ZERO);
        for &(observation, r, scale) in &seen {
            if poses.linearize(landmark, &first, (observation, scale), &mut j).is_none() {
                continue;
            }
            let target = camera_of(problem, observation.frame, observation.camera);
            let frame = usize::from(observation.frame);
            span = (span.0.min(frame), span.1.max(frame));
            let cameras = (landmark.host_camera, observation.camera);
            rows.set(&j, &r, cameras, host == target);
            self.cameras.add(target, &rows.by_camera);
            sums.add(&rows, Some(frame), entry);
        }
        self.add_structural(entry, &mut sums, poses, problem, landmark);
        let mut own = sums.finish(entry, usize::from(landmark.host));
        own += SMatrix::<f64, D, D>::identity() * LANDMARK_REGULARIZATION;
        for k in 0..D {
            own[(k, k)] *= 1.0 + damping;
        }
        entry.eliminate(&mut self.motions, own, span);
    }

    /// Adds that a landmark lies along a direction of the Manhattan world, if it does.
    fn add_structural<F: Estimated<D>, const D: usize>(
        &mut self,
        entry: &mut Eliminated<D>,
        sums: &mut LandmarkSums<D>,
        poses: &Poses,
        problem: &Problem<'_>,
        landmark: &Landmark<F>,
    ) {
        let mut j = StructuralJacobians { feature: Jacobians::zeros(), heading: Vector2::zeros() };
        let Some(r) = poses.structural_residual(problem, landmark, Some(&mut j)) else { return };
        let scale = self.costs.add(r.norm_squared()).sqrt();
        let rows = Rows::structural(&j, &r, scale, landmark.host_camera);
        self.cameras.add_structural(&rows.by_camera);
        sums.add(&rows, None, entry);
    }
}

#[cfg(test)]
#[path = "linearize_tests.rs"]
mod tests;
