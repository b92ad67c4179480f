//! Motions: the unknowns in which landmarks are linearized and eliminated, and the lift of their normal equations to
//! rig and frames.
//!
//! A motion `(t, theta)` of a frame moves its body, cameras and all, in `O` about a pivot `c` near the window, which
//! keeps the numbers small however far the flight has led; one of a camera moves it on its mount, in its own axes:
//!
//! ```text
//! R_ob <- Exp(theta) R_ob      p_ob - c <- Exp(theta) (p_ob - c) + t
//! R_bc <- R_bc Exp(theta)      p_bc <- p_bc + R_bc t
//! ```
//!
//! A projection depends on the camera's pose only, so frame and extrinsics share one Jacobian. A landmark's derivatives
//! by both are a few products of terms that its factor has computed: no matrix of derivatives is applied per landmark.
//! The sum over all landmarks is lifted once, `M'HM` and `M'b`, with the matrix `M` of the motions' derivatives by rig
//! and frames ([`Lifts`]).
//!
//! The gradient is one more column, that of the residuals ([`RESIDUAL`]): what is done to the matrix is done to it as well.

use super::dense::NormalEquations;
use super::state::{
    BodyPose, INTRINSICS_DIM, MAX_FRAMES, Mount, NavState, POSE_DIM, RIG_DIM, Rig, unknown_of_frame,
};
use super::tiles::{LANES, add_times};
use crate::geometry::skew;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Place of the time offset: after the motions of both cameras.
pub const TIME_OFFSET: usize = 2 * POSE_DIM;
/// Place of the residual.
pub const RESIDUAL: usize = TIME_OFFSET + 1;
/// Columns before those of the intrinsics: a multiple of the vector width.
pub const POSED: usize = 16;
/// Columns of the intrinsics of a camera: the vector width.
pub const LENS: usize = LANES;
/// Columns before those of the frames.
pub const GLOBALS: usize = POSED + 2 * LENS;
/// Most columns.
pub const MAX_MOTIONS: usize = motion_of_frame(MAX_FRAMES).next_multiple_of(LANES);
/// A row by all motions.
pub type MotionRow = [f64; MAX_MOTIONS];
/// Degrees of freedom of the rig's extrinsics: as many as those of the motions of its cameras.
const EXTRINSICS_DIM: usize = Rig::TIME_OFFSET;

/// Place of the motion of camera 0 or 1 on its mount.
pub const fn motion_of_camera(camera: usize) -> usize {
    POSE_DIM * camera
}

/// Place of the intrinsics of camera 0 or 1.
pub const fn motion_of_lens(camera: usize) -> usize {
    POSED + LENS * camera
}

/// Columns before those of the frames that are in use.
pub const fn globals_in_use(has_lenses: bool) -> usize {
    if has_lenses { GLOBALS } else { POSED }
}

/// Motion and unknown of each intrinsic parameter.
fn lens_unknowns() -> impl Iterator<Item = (usize, usize)> {
    (0..2).flat_map(|k| (0..INTRINSICS_DIM).map(move |i| (motion_of_lens(k) + i, Rig::of_lens(k) + i)))
}

/// Place of the motion of frame `index`.
pub const fn motion_of_frame(index: usize) -> usize {
    GLOBALS + POSE_DIM * index
}

/// The six entries of a row at a motion.
#[inline]
pub(super) fn motion_at(row: &mut [f64], at: usize) -> &mut [f64; POSE_DIM] {
    (&mut row[at..at + POSE_DIM]).try_into().expect("has six entries")
}

/// Motion in `O` about the pivot by one in the axes of what lies at `p`, from the pivot, and `rot` takes to `O`.
fn in_o(rot: &Matrix3<f64>, p: &Vector3<f64>) -> SMatrix<f64, POSE_DIM, POSE_DIM> {
    let mut by = SMatrix::<f64, POSE_DIM, POSE_DIM>::zeros();
    by.fixed_view_mut::<3, 3>(NavState::P, NavState::P).copy_from(rot);
    by.fixed_view_mut::<3, 3>(NavState::P, NavState::ROT).copy_from(&(skew(p) * rot));
    by.fixed_view_mut::<3, 3>(NavState::ROT, NavState::ROT).copy_from(rot);
    by
}

/// Derivatives, in rows, of motions by rig and frames, and of cameras' motions in `O` by those of their mounts.
#[derive(Clone, Debug)]
pub struct Lifts {
    /// Motion of each camera in `O` by that on its mount; frame by frame, the left camera first.
    pub(super) in_o: Vec<[[f64; POSE_DIM]; POSE_DIM]>,
    /// Cameras of a frame.
    pub(super) cameras: usize,
    /// Motion of each frame by its attitude, rows widened to a multiple of the vector width; by its position it is the identity.
    by_attitude: Vec<[[f64; LANES]; POSE_DIM]>,
    /// Motions of the cameras by the extrinsics.
    by_rig: [[f64; EXTRINSICS_DIM]; EXTRINSICS_DIM],
    /// 0 where the time offset is held fixed, and 1 where it is not.
    by_time_offset: f64,
}

impl Default for Lifts {
    /// Room for any window.
    fn default() -> Self {
        Self {
            in_o: Vec::with_capacity(2 * MAX_FRAMES),
            cameras: 1,
            by_attitude: Vec::with_capacity(MAX_FRAMES),
            by_rig: [[0.0; EXTRINSICS_DIM]; EXTRINSICS_DIM],
            by_time_offset: 0.0,
        }
    }
}

impl Lifts {
    /// Takes over the poses of the frames' bodies at which Jacobians are taken, and the unknowns of the rig that `rig_mask`
    /// admits.
    pub fn refresh(
        &mut self,
        bodies: &[BodyPose],
        mounts: &[Mount],
        pivot_o: &Vector3<f64>,
        rig_mask: &SVector<f64, RIG_DIM>,
    ) {
        self.cameras = mounts.len();
        self.by_time_offset = rig_mask[Rig::TIME_OFFSET];
        self.by_rig = [[0.0; EXTRINSICS_DIM]; EXTRINSICS_DIM];
        for (camera, mount) in mounts.iter().enumerate() {
            let by_rig = on_mount(mount);
            for (i, row) in self.by_rig[motion_of_camera(camera)..].iter_mut().take(POSE_DIM).enumerate() {
                *row = std::array::from_fn(|k| by_rig[(i, k)] * rig_mask[k]);
            }
        }
        self.in_o.clear();
        self.by_attitude.clear();
        for body in bodies {
            let by_frame = frame_motion(body, pivot_o);
            let row = |i| std::array::from_fn(|k| if k < 3 { by_frame[(i, NavState::ROT + k)] } else { 0.0 });
            self.by_attitude.push(std::array::from_fn(row));
            for mount in mounts {
                let (rot, p) =
                    (body.rot_o_b * mount.rot_b_c, body.rot_o_b * mount.p_b_c + body.p_o_b - pivot_o);
                let by = in_o(&rot, &p);
                self.in_o.push(std::array::from_fn(|i| std::array::from_fn(|k| by[(i, k)])));
            }
        }
    }

    /// The motions of a step of all unknowns, with a one for the residual.
    pub fn motions_of(&self, step: &[f64]) -> MotionRow {
        let mut motions = [0.0; MAX_MOTIONS];
        for (to, row) in motions.iter_mut().zip(&self.by_rig) {
            *to = row.iter().zip(step).map(|(by, x)| by * x).sum();
        }
        motions[TIME_OFFSET] = self.by_time_offset * step[Rig::TIME_OFFSET];
        motions[RESIDUAL] = 1.0;
        for (motion, unknown) in lens_unknowns() {
            motions[motion] = step[unknown];
        }
        for (frame, by_attitude) in self.by_attitude.iter().enumerate() {
            let at = unknown_of_frame(frame);
            let (p, turn) = (&step[at + NavState::P..], &step[at + NavState::ROT..]);
            let to = motion_at(&mut motions, motion_of_frame(frame));
            for (to, row) in to.iter_mut().zip(by_attitude) {
                *to = row[0] * turn[0] + row[1] * turn[1] + row[2] * turn[2];
            }
            for k in 0..3 {
                to[k] += p[k];
            }
        }
        motions
    }

    /// A row by motions as one by extrinsics, time offset and poses, in the same places.
    fn lift_columns(&self, row: &mut [f64], from: usize) {
        if from < EXTRINSICS_DIM {
            let mut lifted = [0.0; EXTRINSICS_DIM];
            for (x, by) in row.iter().zip(&self.by_rig) {
                for k in 0..EXTRINSICS_DIM {
                    lifted[k] += x * by[k];
                }
            }
            row[..EXTRINSICS_DIM].copy_from_slice(&lifted);
        }
        row[TIME_OFFSET] *= self.by_time_offset;
        let first = from.saturating_sub(GLOBALS) / POSE_DIM;
        for (frame, by_attitude) in self.by_attitude.iter().enumerate().skip(first) {
            let motion = motion_at(row, motion_of_frame(frame));
            let mut lifted = [0.0; LANES];
            for (x, by) in motion.iter().zip(by_attitude) {
                for k in 0..LANES {
                    lifted[k] += x * by[k];
                }
            }
            motion[NavState::ROT..].copy_from_slice(&lifted[..3]);
        }
    }
}

/// Motion of a camera on its mount by the extrinsics.
pub(super) fn on_mount(mount: &Mount) -> SMatrix<f64, POSE_DIM, EXTRINSICS_DIM> {
    let mut by_rig = mount.by_rig;
    let by_p = mount.rot_b_c.tr_mul(&mount.by_rig.fixed_rows::<3>(NavState::P));
    by_rig.fixed_rows_mut::<3>(NavState::P).copy_from(&by_p);
    by_rig
}

/// Motion of a frame by its pose.
pub(super) fn frame_motion(body: &BodyPose, pivot_o: &Vector3<f64>) -> SMatrix<f64, POSE_DIM, POSE_DIM> {
    let mut by = in_o(&body.rot_o_b, &(body.p_o_b - pivot_o));
    by.fixed_view_mut::<3, 3>(NavState::P, NavState::P).copy_from(&Matrix3::identity());
    by
}

/// The normal equations of motions, the gradient in the column of the residual. Of the symmetric matrix the upper triangle counts.
#[derive(Clone, Debug)]
pub struct MotionEquations {
    /// Columns in use.
    pub(super) dim: usize,
    /// True if intrinsics take part.
    pub(super) has_lenses: bool,
    pub(super) rows: Vec<MotionRow>,
}

impl Default for MotionEquations {
    /// Room for any window.
    fn default() -> Self {
        Self { dim: GLOBALS, has_lenses: true, rows: vec![[0.0; MAX_MOTIONS]; MAX_MOTIONS] }
    }
}

impl MotionEquations {
    /// Starts anew with the motions of `frames`.
    pub fn reset(&mut self, frames: usize, has_lenses: bool) {
        self.dim = motion_of_frame(frames);
        self.has_lenses = has_lenses;
        for row in &mut self.rows[..self.dim] {
            row[..self.dim.next_multiple_of(LANES)].fill(0.0);
        }
    }

    /// Adds them to those of all unknowns. They are used up.
    pub fn lift(&mut self, lifts: &Lifts, equations: &mut NormalEquations) {
        let dim = self.dim;
        self.complete_blocks();
        let used = globals_in_use(self.has_lenses);
        for (i, row) in self.rows[..dim].iter_mut().enumerate().filter(|(i, _)| !(used..GLOBALS).contains(i))
        {
            lifts.lift_columns(&mut row[..dim], i);
        }
        self.lift_rows_of_rig(lifts);
        for (frame, by_attitude) in lifts.by_attitude.iter().enumerate() {
            self.lift_rows_of_frame(frame, by_attitude);
        }
        for i in (0..RESIDUAL).chain(GLOBALS..dim) {
            let to = unknown_of_motion(i);
            let row = equations.row_mut(to);
            for k in i.min(RESIDUAL)..RESIDUAL {
                row[unknown_of_motion(k) - to] += self.rows[i][k];
            }
            self.move_frames(i, to, equations);
            let gradient = if i < RESIDUAL { self.rows[i][RESIDUAL] } else { self.rows[RESIDUAL][i] };
            equations.gradient_mut()[to] += gradient;
        }
        if self.has_lenses {
            self.move_lenses(equations);
        }
    }

    /// Adds the columns of frames of row `i`, whose unknown is `to`.
    fn move_frames(&self, i: usize, to: usize, equations: &mut NormalEquations) {
        let row = equations.row_mut(to);
        for frame in i.saturating_sub(GLOBALS) / POSE_DIM..(self.dim - GLOBALS) / POSE_DIM {
            let (at, first) =
                (motion_of_frame(frame), i.saturating_sub(motion_of_frame(frame)).min(POSE_DIM));
            let from = &self.rows[i][at + first..at + POSE_DIM];
            let at = unknown_of_frame(frame) + first - to;
            for (to, from) in row[at..].iter_mut().zip(from) {
                *to += from;
            }
        }
    }

    /// Adds rows and columns of the intrinsics.
    fn move_lenses(&self, equations: &mut NormalEquations) {
        for (i, to) in lens_unknowns() {
            for k in 0..RESIDUAL {
                equations.add(unknown_of_motion(k), to, self.rows[k][i]);
            }
            for (k, other) in lens_unknowns().filter(|(k, _)| *k >= i) {
                equations.add(to, other, self.rows[i][k]);
            }
            self.move_frames(i, to, equations);
            equations.gradient_mut()[to] += self.rows[RESIDUAL][i];
        }
    }

    /// Writes the lower triangles of the blocks on the diagonal: what is lifted together is needed whole.
    fn complete_blocks(&mut self) {
        let frames = (GLOBALS..self.dim).step_by(POSE_DIM).map(|at| at..at + POSE_DIM);
        for block in std::iter::once(0..EXTRINSICS_DIM).chain(frames) {
            for i in block.clone() {
                for k in block.start..i {
                    self.rows[i][k] = self.rows[k][i];
                }
            }
        }
    }

    fn lift_rows_of_rig(&mut self, lifts: &Lifts) {
        let dim = self.dim.next_multiple_of(LANES);
        let motions: [MotionRow; EXTRINSICS_DIM] = std::array::from_fn(|i| self.rows[i]);
        for (k, to) in self.rows[..EXTRINSICS_DIM].iter_mut().enumerate() {
            to[..dim].fill(0.0);
            for (row, by) in motions.iter().zip(&lifts.by_rig) {
                if by[k] != 0.0 {
                    add_times(&mut to[..dim], by[k], &row[..dim]);
                }
            }
        }
        let dim = self.dim;
        self.rows[TIME_OFFSET][..dim].iter_mut().for_each(|x| *x *= lifts.by_time_offset);
    }

    fn lift_rows_of_frame(&mut self, frame: usize, by_attitude: &[[f64; LANES]; POSE_DIM]) {
        let at = motion_of_frame(frame);
        let range = at / LANES * LANES..self.dim.next_multiple_of(LANES);
        let (positions, turns) = self.rows[at..at + POSE_DIM].split_at_mut(NavState::ROT);
        let motions: [MotionRow; 3] = std::array::from_fn(|i| turns[i]);
        for (k, to) in turns.iter_mut().enumerate() {
            to[range.clone()].fill(0.0);
            for (row, by) in positions.iter().chain(&motions).zip(by_attitude) {
                add_times(&mut to[range.clone()], by[k], &row[range.clone()]);
            }
        }
    }
}

/// Place among all unknowns of what has the place `motion` once it is lifted.
fn unknown_of_motion(motion: usize) -> usize {
    match motion.checked_sub(GLOBALS) {
        Some(k) => unknown_of_frame(k / POSE_DIM) + k % POSE_DIM,
        None => motion,
    }
}
