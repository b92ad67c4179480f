//! Linearization: factors at the present states become normal equations, landmarks eliminated.
//!
//! Each landmark's small block is eliminated as soon as its observations are summed ([`super::eliminate`]).
//! Jacobians of frames in the prior are taken at their first estimates, residuals always at the present
//! state.

use super::dense::NormalEquations;
use super::eliminate::{Eliminated, MAX_VISUAL, eliminate};
use super::feature::{BodyPose, Estimated, Feature, View};
use super::hessian_blocks::{LandmarkHessian, add_heading, add_target, common_rows};
use super::inertial_factor;
use super::landmark::{Landmark, LineLandmark, Observation, PointLandmark};
use super::manhattan::Manhattan;
use super::state::{FRAME_DIM, Frame, GLOBAL_DIM, Mount, POSE_DIM, Rig};
use super::{MAX_FRAMES, Options};
use nalgebra::{Matrix3, SMatrix, Vector2, Vector3};

/// Information that keeps the bearing of a landmark regular, in squared standard deviations of a pixel.
const LANDMARK_REGULARIZATION: f64 = 1e-6;

/// Poses and extrinsics as matrices, at the present states and at those of the Jacobians.
#[derive(Clone, Debug)]
struct Poses {
    now: Vec<BodyPose>,
    first: Vec<BodyPose>,
    mounts: [Mount; 2],
}

/// Normal equations of a window with all the memory that making them needs.
#[derive(Clone, Debug)]
pub struct Linearizer {
    /// The normal equations of rig and frames.
    pub equations: NormalEquations,
    visual: NormalEquations,
    /// One entry for each point, in the order of the store.
    pub points: Vec<Eliminated<3>>,
    /// The same for each line.
    pub lines: Vec<Eliminated<4>>,
    poses: Poses,
}

/// What a linearization works on.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// Calibration.
    pub rig: &'a Rig,
    /// Frames in order of time.
    pub frames: &'a [Frame],
    /// Points.
    pub points: &'a [PointLandmark],
    /// Lines.
    pub lines: &'a [LineLandmark],
    /// Structure of the scene.
    pub manhattan: &'a Manhattan,
    /// Options of the window.
    pub options: &'a Options,
}

/// Cauchy's kernel: cost and weight of a squared residual (in squared standard deviations).
#[must_use]
pub fn cauchy(squared: f64, scale: f64) -> (f64, f64) {
    let c2 = scale * scale;
    let ratio = squared / c2;
    (0.5 * c2 * ratio.ln_1p(), 1.0 / (1.0 + ratio))
}

impl Linearizer {
    /// Room for `unknowns`, `points` and `lines`.
    #[must_use]
    pub fn new(unknowns: usize, points: usize, lines: usize, rig: &Rig) -> Self {
        let body = BodyPose { rot_o_b: Matrix3::identity(), p_o_b: Vector3::zeros() };
        Self {
            equations: NormalEquations::new(unknowns),
            visual: NormalEquations::new(MAX_VISUAL),
            points: vec![Eliminated::empty(); points],
            lines: vec![Eliminated::empty(); lines],
            poses: Poses {
                now: vec![body.clone(); MAX_FRAMES],
                first: vec![body; MAX_FRAMES],
                mounts: [Mount::of(rig, 0), Mount::of(rig, 1)],
            },
        }
    }

    /// Starts anew with no information about the rig and the frames of `problem`.
    pub fn begin(&mut self, problem: &Problem<'_>) {
        let frames = problem.frames.len();
        self.equations.reset(GLOBAL_DIM + FRAME_DIM * frames);
        self.visual.reset(GLOBAL_DIM + POSE_DIM * frames);
        self.refresh_bodies(problem.rig, problem.frames, problem.options.first_estimates);
    }

    fn refresh_bodies(&mut self, rig: &Rig, frames: &[Frame], first_estimates: bool) {
        self.poses.mounts = [Mount::of(rig, 0), Mount::of(rig, 1)];
        for (k, frame) in frames.iter().enumerate() {
            self.poses.now[k] = BodyPose::of(&frame.nav);
            self.poses.first[k] = BodyPose::of(frame.jacobian_state(first_estimates));
        }
    }

    /// Adds point `index` of the problem and eliminates it, its own block damped; returns its robust cost.
    pub fn add_point(&mut self, problem: &Problem<'_>, index: usize, damping: f64) -> f64 {
        let Self { points, visual, poses, .. } = self;
        add_landmark(visual, &mut points[index], poses, problem, &problem.points[index], damping)
    }

    /// The same for line `index`.
    pub fn add_line(&mut self, problem: &Problem<'_>, index: usize, damping: f64) -> f64 {
        let Self { lines, visual, poses, .. } = self;
        add_landmark(visual, &mut lines[index], poses, problem, &problem.lines[index], damping)
    }

    /// Adds the inertial factor that leads to frame `index`; returns its cost.
    pub fn add_motion(&mut self, problem: &Problem<'_>, index: usize) -> f64 {
        let (from, to) = (&problem.frames[index - 1], &problem.frames[index]);
        let Some(motion) = &to.motion else { return 0.0 };
        let Some(information) = inertial_factor::information(motion, &problem.options.imu_noise) else {
            return 0.0;
        };
        let gravity = &problem.options.gravity_o;
        let r = inertial_factor::residual(motion, &from.nav, &to.nav, gravity);
        let first = problem.options.first_estimates;
        let (by_from, by_to) =
            inertial_factor::jacobians(motion, from.jacobian_state(first), to.jacobian_state(first), gravity);
        let (row, column) = (GLOBAL_DIM + (index - 1) * FRAME_DIM, GLOBAL_DIM + index * FRAME_DIM);
        let weighted_from = by_from.tr_mul(&information);
        let weighted_to = by_to.tr_mul(&information);
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

    /// Adds the knowledge that the vehicle stands still in frame `index`; returns its cost.
    pub fn add_zero_velocity(&mut self, problem: &Problem<'_>, index: usize) -> f64 {
        let frame = &problem.frames[index];
        if !frame.is_still {
            return 0.0;
        }
        let information = 1.0 / (problem.options.still_sigma_m_s * problem.options.still_sigma_m_s);
        let at = GLOBAL_DIM + index * FRAME_DIM + 6;
        for k in 0..3 {
            self.equations.add(at + k, at + k, information);
            self.equations.gradient_mut()[at + k] += information * frame.nav.v_o_b[k];
        }
        0.5 * information * frame.nav.v_o_b.norm_squared()
    }

    /// Moves what the landmarks said of rig and poses into the normal equations.
    pub fn finish(&mut self) {
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
        self.refresh_bodies(problem.rig, problem.frames, problem.options.first_estimates);
        let mut cost = 0.0;
        cost += self.cost_of(problem, problem.points) + self.cost_of(problem, problem.lines);
        for (index, frame) in problem.frames.iter().enumerate() {
            if let (Some(motion), true) = (&frame.motion, index > 0) {
                let from = &problem.frames[index - 1].nav;
                let r = inertial_factor::residual(motion, from, &frame.nav, &problem.options.gravity_o);
                if let Some(information) = inertial_factor::information(motion, &problem.options.imu_noise) {
                    cost += 0.5 * (r.transpose() * information * r)[0];
                }
            }
            if frame.is_still {
                cost += 0.5 * frame.nav.v_o_b.norm_squared() / problem.options.still_sigma_m_s.powi(2);
            }
        }
        cost
    }

    /// Robust cost of landmarks at the poses last refreshed.
    fn cost_of<F: Feature>(&self, problem: &Problem<'_>, landmarks: &[Landmark<F>]) -> f64 {
        let mut cost = 0.0;
        for landmark in landmarks.iter().filter(|l| l.is_triangulated) {
            for observation in &landmark.observations {
                if let Some(r) = self.residual(problem, landmark, observation) {
                    cost += cauchy(r.norm_squared(), problem.options.cauchy_scale).0;
                }
            }
            let host = &self.poses.now[usize::from(landmark.host)];
            let mount = &self.poses.mounts[usize::from(landmark.host_camera)];
            if let Some(r) = landmark.feature.structural_residual(problem.manhattan, host, mount) {
                cost += cauchy(r.norm_squared(), problem.options.cauchy_scale).0;
            }
        }
        cost
    }

    /// Sets the image rates of the observations in frame `index` from its predicted motion (`rate_b` in
    /// rad/s): rates differenced from images would carry their noise into the time offset.
    pub fn predict_rates<F: Feature>(
        &mut self,
        rig: &Rig,
        frames: &[Frame],
        landmarks: &mut [Landmark<F>],
        rate_b: &Vector3<f64>,
        index: usize,
    ) {
        self.refresh_bodies(rig, frames, false);
        let v_b = frames[index].nav.rot_o_b.inverse() * frames[index].nav.v_o_b;
        for landmark in landmarks.iter_mut().filter(|l| l.is_triangulated) {
            for k in (0..landmark.observations.len()).rev() {
                let observation = landmark.observations[k];
                match usize::from(observation.frame) {
                    frame if frame > index => continue,
                    frame if frame < index => break,
                    _ => {}
                }
                let view = self.poses.view(&self.poses.now, landmark, index, observation.camera);
                if let Some(m) = landmark.feature.with_rate(&view, &observation.measured, rate_b, &v_b) {
                    landmark.observations[k].measured = m;
                }
            }
        }
    }

    /// Gives the landmarks of frame `from` that the newest frame still sees their earliest other keyframe as host;
    /// what frame `from` saw of them is forgotten. A landmark without another view keeps its host.
    pub fn rehost<F: Feature>(
        &mut self,
        rig: &Rig,
        frames: &[Frame],
        landmarks: &mut [Landmark<F>],
        from: usize,
    ) {
        let newest = frames.len().saturating_sub(1);
        self.refresh_bodies(rig, frames, false);
        for landmark in landmarks.iter_mut().filter(|l| usize::from(l.host) == from && l.is_triangulated) {
            let mut views = landmark.observations.iter().filter(|o| usize::from(o.frame) != from);
            if !views.clone().any(|o| usize::from(o.frame) == newest) {
                continue;
            }
            let Some(heir) = views.find(|o| frames[usize::from(o.frame)].is_keyframe).copied() else {
                continue;
            };
            let view = self.poses.view(&self.poses.now, landmark, usize::from(heir.frame), heir.camera);
            let Some(feature) = landmark.feature.hosted_by_target(&view) else { continue };
            landmark.feature = feature;
            landmark.host = heir.frame;
            landmark.host_camera = heir.camera;
            landmark.observations.retain(|o| usize::from(o.frame) != from);
        }
    }

    /// The residual of one observation at the poses last refreshed, in standard deviations.
    #[must_use]
    pub fn residual<F: Feature>(
        &self,
        problem: &Problem<'_>,
        landmark: &Landmark<F>,
        observation: &Observation<F::Measurement>,
    ) -> Option<Vector2<f64>> {
        let frame = usize::from(observation.frame);
        let step_s = problem.rig.time_offset_s - problem.frames[frame].time_offset_s;
        let view = self.poses.view(&self.poses.now, landmark, frame, observation.camera);
        landmark.feature.residual(&view, &observation.measured, step_s)
    }
}

impl Poses {
    fn view<'a, F: Feature>(
        &'a self,
        bodies: &'a [BodyPose],
        landmark: &Landmark<F>,
        frame: usize,
        camera: u8,
    ) -> View<'a> {
        View {
            host: &bodies[usize::from(landmark.host)],
            host_mount: &self.mounts[usize::from(landmark.host_camera)],
            target: &bodies[frame],
            target_mount: &self.mounts[usize::from(camera)],
        }
    }
}

/// Place of a visual unknown (rig, then six of each pose) among all unknowns.
#[must_use]
pub fn unknown_of_visual(visual: usize) -> usize {
    if visual < GLOBAL_DIM {
        visual
    } else {
        let k = visual - GLOBAL_DIM;
        GLOBAL_DIM + (k / POSE_DIM) * FRAME_DIM + k % POSE_DIM
    }
}

/// Adds what the structure of the scene says of a landmark; returns its robust cost.
fn add_structural<F: Estimated<D>, const D: usize>(
    visual: &mut NormalEquations,
    entry: &mut Eliminated<D>,
    hessian: &mut LandmarkHessian<D>,
    poses: &Poses,
    problem: &Problem<'_>,
    landmark: &Landmark<F>,
) -> f64 {
    let Problem { manhattan, options, .. } = *problem;
    let (host, mount) = (usize::from(landmark.host), &poses.mounts[usize::from(landmark.host_camera)]);
    let Some(r) = landmark.feature.structural_residual(manhattan, &poses.now[host], mount) else {
        return 0.0;
    };
    let Some((j, heading)) = landmark.feature.structural_jacobians(manhattan, &poses.first[host], mount)
    else {
        return 0.0;
    };
    let (cost, weight) = cauchy(r.norm_squared(), options.cauchy_scale);
    let scale = weight.sqrt();
    let rows = common_rows(&j, &r, scale, true, options);
    hessian.add(&rows);
    add_heading(visual, entry, &rows, &(heading * scale), host);
    cost
}

/// Adds a landmark and eliminates it, its own block damped; returns its robust cost.
fn add_landmark<F: Estimated<D>, const D: usize>(
    visual: &mut NormalEquations,
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
    let dim = GLOBAL_DIM + POSE_DIM * problem.frames.len();
    for row in &mut entry.by_visual {
        row[..dim].fill(0.0);
    }
    let mut hessian = LandmarkHessian::<D>::default();
    let host = usize::from(landmark.host);
    let mut cost = 0.0;
    let mut span = (host, host);
    for observation in &landmark.observations {
        let frame = usize::from(observation.frame);
        let view = poses.view(&poses.now, landmark, frame, observation.camera);
        let step_s = problem.rig.time_offset_s - problem.frames[frame].time_offset_s;
        let Some(r) = landmark.feature.residual(&view, &observation.measured, step_s) else { continue };
        let first = poses.view(&poses.first, landmark, frame, observation.camera);
        let Some(j) = landmark.feature.jacobians(&first, &observation.measured) else { continue };
        let (c, weight) = cauchy(r.norm_squared(), problem.options.cauchy_scale);
        cost += c;
        span = (span.0.min(frame), span.1.max(frame));
        let scale = weight.sqrt();
        let rows = common_rows(&j, &r, scale, host != frame, problem.options);
        hessian.add(&rows);
        if host != frame {
            add_target(visual, entry, &rows, &j.target, scale, (host, frame));
        }
    }
    cost += add_structural(visual, entry, &mut hessian, poses, problem, landmark);
    hessian.flush(visual, entry, host);
    let mut h_ll = hessian.landmark() + SMatrix::<f64, D, D>::identity() * LANDMARK_REGULARIZATION;
    for k in 0..D {
        h_ll[(k, k)] *= 1.0 + damping;
    }
    let Some(cholesky) = h_ll.cholesky() else { return cost };
    entry.inverse = cholesky.inverse();
    entry.is_used = true;
    eliminate(visual, entry, &cholesky.l(), span);
    cost
}
