//! The problem of a window as one dense system, made from the factors one by one: what the solver is held against.

use super::Window;
use super::dense::NormalEquations;
use super::factor::{Linearization, RobustSum};
use super::feature::{Estimated, Jacobians};
use super::landmark::Landmark;
use super::linearize::LANDMARK_REGULARIZATION;
use super::problem::Problem;
use super::refined_lens::MovedLenses;
use super::state::{FRAME_DIM, FrameMatrix, NavState, RIG_DIM, Rig, unknown_of_frame};
use super::test_views::{Lifted, with_cameras};
use super::zero_velocity_factor;
use nalgebra::{DMatrix, DVector, Vector2};

/// The whole problem of a window with nothing eliminated, from the factors one by one: `H d = -b` over rig, frames,
/// points and lines in this order.
pub struct Dense {
    /// `J'J`.
    pub h: DMatrix<f64>,
    /// `J'r`.
    pub b: DVector<f64>,
    /// Unknowns of rig and frames; those of the landmarks follow.
    pub states: usize,
    /// Place of each point's unknowns.
    pub points: Vec<usize>,
    /// Place of each line's unknowns.
    pub lines: Vec<usize>,
}

/// Rows of a whitened Jacobian and residual.
struct Rows {
    j: Vec<DVector<f64>>,
    r: Vec<f64>,
    dim: usize,
}

impl Rows {
    fn add(&mut self, r: f64, parts: &[(usize, &[f64])]) {
        let mut row = DVector::zeros(self.dim);
        for (at, part) in parts {
            for (k, value) in part.iter().enumerate() {
                row[at + k] += value;
            }
        }
        self.j.push(row);
        self.r.push(r);
    }
}

impl Dense {
    /// The problem of `window`, with the landmarks' own diagonals times `1 + damping`.
    pub fn of(window: &Window, damping: f64) -> Self {
        let states = unknown_of_frame(window.frames.len());
        let used = |is_triangulated: bool, dim: usize| if is_triangulated { dim } else { 0 };
        let mut next = states;
        let mut place = |dim: usize| {
            next += dim;
            next - dim
        };
        let points: Vec<_> = window.points.all().iter().map(|l| place(used(l.is_triangulated, 3))).collect();
        let lines: Vec<_> = window.lines.all().iter().map(|l| place(used(l.is_triangulated, 4))).collect();
        let mut rows = Rows { j: Vec::new(), r: Vec::new(), dim: next };
        for (landmark, at) in window.points.all().iter().zip(&points) {
            add_landmark(&mut rows, window, landmark, *at);
        }
        for (landmark, at) in window.lines.all().iter().zip(&lines) {
            add_landmark(&mut rows, window, landmark, *at);
        }
        add_inertial(&mut rows, window);
        let j = DMatrix::from_columns(&rows.j).transpose();
        let r = DVector::from_vec(rows.r);
        let (mut h, mut b) = (j.tr_mul(&j), j.tr_mul(&r));
        for k in states..next {
            h[(k, k)] *= 1.0 + damping;
        }
        add_prior(&mut h, &mut b, window);
        Self { h, b, states, points, lines }
    }

    /// The system of rig and frames after the landmarks are eliminated.
    pub fn reduced(&self) -> (DMatrix<f64>, DVector<f64>) {
        let (n, m) = (self.states, self.h.nrows() - self.states);
        let mixed = self.h.view((0, n), (n, m));
        let landmarks = self.h.view((n, n), (m, m)).into_owned().cholesky().expect("is positive definite");
        let h = self.h.view((0, 0), (n, n)) - mixed * landmarks.solve(&mixed.transpose());
        let b = self.b.rows(0, n) - mixed * landmarks.solve(&self.b.rows(n, m).into_owned());
        (h, b)
    }

    /// The step that solves the whole system, unknowns without information held at zero.
    pub fn step(&self) -> DVector<f64> {
        let (h, scale) = equilibrated(&self.h);
        let scaled = h.cholesky().expect("is positive definite").solve(&self.b.component_mul(&scale));
        -scaled.component_mul(&scale)
    }
}

/// `S H S` with ones on its diagonal, and the diagonal of `S`; unknowns without information get a one.
pub fn equilibrated(h: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let scale = h.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 });
    let mut scaled = DMatrix::from_fn(h.nrows(), h.ncols(), |i, k| h[(i, k)] * scale[i] * scale[k]);
    for k in 0..h.nrows() {
        if h[(k, k)] == 0.0 {
            scaled[(k, k)] = 1.0;
        }
    }
    (scaled, scale)
}

fn add_landmark<F: Estimated<D>, const D: usize>(
    rows: &mut Rows,
    window: &Window,
    landmark: &Landmark<F>,
    at: usize,
) {
    if !landmark.is_triangulated {
        return;
    }
    let first_estimates = window.options.first_estimates;
    let host = usize::from(landmark.host);
    let problem = Problem::of_frames(&window.rig, &window.frames, &window.options);
    let mut add = |(j, lifted): (&Jacobians<D>, &Lifted), r: &Vector2<f64>, target: usize| {
        let weight = (RobustSum::new(problem.options.cauchy_scale * F::sigma(problem.options))
            .add(r.norm_squared())
            * landmark.information(problem.frames, problem.options))
        .sqrt();
        for d in 0..2 {
            let masked = lifted.rig.row(d).component_mul(&window.options.rig_mask.transpose());
            let by_rig: Vec<f64> = masked.iter().map(|x| x * weight).collect();
            let by_host: Vec<f64> = lifted.host.row(d).iter().map(|x| x * weight).collect();
            let by_target: Vec<f64> = lifted.target.row(d).iter().map(|x| x * weight).collect();
            let by_landmark: Vec<f64> = j.landmark.row(d).iter().map(|x| x * weight).collect();
            rows.add(
                r[d] * weight,
                &[
                    (0, &by_rig),
                    (unknown_of_frame(host), &by_host),
                    (unknown_of_frame(target), &by_target),
                    (at, &by_landmark),
                ],
            );
        }
    };
    let first = |k: usize| window.frames[k].jacobian_state(first_estimates);
    let host_camera = usize::from(landmark.host_camera);
    for o in &landmark.observations {
        let target = usize::from(o.frame);
        let cameras = (host_camera, usize::from(o.camera));
        let step_s = window.rig.time_offset_s - window.frames[target].time_offset_s;
        let mut j = Jacobians::zeros();
        let measured = MovedLenses::of(window.options.lenses.as_ref(), &window.rig).moved::<F>(o);
        with_cameras(&window.rig, (first(host), first(target)), cameras, |at| {
            let request = Linearization { at, jacobians: &mut j };
            let _ = landmark.feature.residual(at, &measured, step_s, Some(request));
        });
        let navs = (&window.frames[host].nav, &window.frames[target].nav);
        let r = with_cameras(&window.rig, navs, cameras, |now| {
            landmark.feature.residual(now, &measured, step_s, None)
        });
        let mut lifted = Lifted::of(&j, &window.rig, (first(host), first(target)), cameras);
        if let Some(lenses) = &window.options.lenses {
            let by_lens = with_cameras(&window.rig, (first(host), first(target)), cameras, |at| {
                let placed = landmark.feature.placed(at.host);
                lenses.derivatives::<F>(cameras.1, &placed, at.target, &o.measured).expect("is seen")
            });
            for (d, row) in by_lens.iter().enumerate() {
                (0..3).for_each(|k| lifted.rig[(d, Rig::of_lens(cameras.1) + k)] = row[k]);
            }
        }
        add((&j, &lifted), &r.expect("is seen"), target);
    }
    for k in 0..D {
        rows.add(0.0, &[(at + k, &[LANDMARK_REGULARIZATION.sqrt()])]);
    }
}

fn add_inertial(rows: &mut Rows, window: &Window) {
    let first = window.options.first_estimates;
    for (k, frame) in window.frames.iter().enumerate() {
        if let Some(factor) = frame.inertial.as_ref().filter(|_| k > 0) {
            let from = &window.frames[k - 1];
            let mut jacobians = [FrameMatrix::zeros(); 2];
            let at = [from.jacobian_state(first), frame.jacobian_state(first)];
            let request = Linearization { at, jacobians: &mut jacobians };
            let states = [&from.nav, &frame.nav];
            let r = factor.residual(states, &window.options.gravity_o, Some(request));
            let root =
                factor.information().expect("is known").cholesky().expect("is definite").l().transpose();
            let [by_from, by_to] = jacobians.map(|j| root * j);
            let r = root * r;
            for d in 0..FRAME_DIM {
                let (from, to): (Vec<f64>, Vec<f64>) =
                    (by_from.row(d).iter().copied().collect(), by_to.row(d).iter().copied().collect());
                rows.add(r[d], &[(unknown_of_frame(k - 1), &from), (unknown_of_frame(k), &to)]);
            }
        }
        if frame.is_still {
            for d in 0..3 {
                let sigma = zero_velocity_factor::SIGMA_M_S;
                let at = unknown_of_frame(k) + NavState::V + d;
                rows.add(frame.nav.v_o_b[d] / sigma, &[(at, &[1.0 / sigma])]);
            }
        }
    }
}

fn add_prior(h: &mut DMatrix<f64>, b: &mut DVector<f64>, window: &Window) {
    let prior = &window.prior;
    let dim = prior.equations.dim();
    let mut step = DVector::zeros(dim);
    step.rows_mut(0, RIG_DIM).copy_from(&window.rig.minus(&prior.rig));
    for (k, frame) in window.frames.iter().take(prior.frames()).enumerate() {
        step.rows_mut(unknown_of_frame(k), FRAME_DIM).copy_from(&frame.nav.minus(&frame.linearization));
    }
    let prior_h = DMatrix::from_fn(dim, dim, |i, k| prior.equations.get(i, k));
    let prior_b = DVector::from_column_slice(prior.equations.gradient());
    let moved = &prior_h * step + prior_b;
    let mut to = h.view_mut((0, 0), (dim, dim));
    to += prior_h;
    let mut to = b.rows_mut(0, dim);
    to += moved;
}

/// The normal equations of a window as a full matrix and a vector.
pub fn full(equations: &NormalEquations) -> (DMatrix<f64>, DVector<f64>) {
    let dim = equations.dim();
    let h = DMatrix::from_fn(dim, dim, |i, k| equations.get(i, k));
    (h, DVector::from_column_slice(equations.gradient()))
}
