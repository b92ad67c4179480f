//! Poses of the cameras in the odometry frame, in which landmarks are linearized, and the lift of their normal
//! equations to rig and frames.
//!
//! A step `(t, theta)` of a camera's pose moves it in `O` about a pivot `c` near the window, which keeps the numbers
//! small however far the flight has led:
//!
//! ```text
//! R_oc <- Exp(theta) R_oc      p_oc - c <- Exp(theta) (p_oc - c) + t
//! ```
//!
//! Moved alike, host and observer see the same: so the derivative of a reprojection by the observer's camera is that by
//! the host's with the other sign, and two rows of twelve columns hold all of an observation. What steps of frames and rig
//! do to the cameras is one matrix `L` for all landmarks. It is applied once to their sum, `L'HL` and `L'b`, and to the
//! mixed derivatives of each, `WL`.

use super::dense::NormalEquations;
use super::state::{
    BodyPose, CAMERA_GLOBALS, CAMERA_HEADING, CAMERA_TIME_OFFSET, HEADING, MAX_FRAMES, MAX_VISUAL, Mount,
    NavState, POSE_DIM, RIG_DIM, Rig, unknown_of_camera, visual_of_frame,
};
use crate::geometry::skew;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Most unknowns of the cameras: the globals, and both cameras of every frame.
pub(super) const MAX_CAMERA: usize = unknown_of_camera(2 * MAX_FRAMES);
/// Degrees of freedom of the rig's extrinsics.
const EXTRINSICS_DIM: usize = Rig::TIME_OFFSET;

/// Pose of a camera in `O`.
#[derive(Clone, Debug)]
pub struct CameraPose {
    /// Takes coordinates from the camera to `O`.
    pub rot_o_c: Matrix3<f64>,
    /// Position of the camera in `O`, from the pivot, m.
    pub p_o_c: Vector3<f64>,
}

impl CameraPose {
    /// The camera that `mount` holds to `body`.
    #[must_use]
    pub fn of(body: &BodyPose, mount: &Mount, pivot_o: &Vector3<f64>) -> Self {
        Self {
            rot_o_c: body.rot_o_b * mount.rot_b_c,
            p_o_c: body.rot_o_b * mount.p_b_c + (body.p_o_b - pivot_o),
        }
    }
}

/// Where a factor looks from and to.
#[derive(Clone, Copy, Debug)]
pub struct CameraView<'a> {
    /// The camera that hosts the landmark.
    pub host: &'a CameraPose,
    /// The camera that observes it.
    pub target: &'a CameraPose,
}

/// How the pose of a camera follows from its frame's and the rig: derivatives of its step.
#[derive(Clone, Debug)]
pub struct Lift([[f64; LIFT_COLUMNS]; POSE_DIM]);

/// Columns of a lift: extrinsics, the frame's pose, and what makes them a multiple of the vector width.
const LIFT_COLUMNS: usize = 20;
const AT_FRAME: usize = EXTRINSICS_DIM;
const LIFT_END: usize = AT_FRAME + POSE_DIM;

impl Lift {
    /// For the camera that `mount` holds to `body`, with the unknowns of the rig that `rig_mask` admits.
    #[must_use]
    pub fn of(
        body: &BodyPose,
        mount: &Mount,
        pivot_o: &Vector3<f64>,
        rig_mask: &SVector<f64, RIG_DIM>,
    ) -> Self {
        let camera = CameraPose::of(body, mount, pivot_o);
        let step = |by_p: &Matrix3<f64>, by_rot: &Matrix3<f64>, arm: &Vector3<f64>| {
            let mut step = SMatrix::<f64, POSE_DIM, POSE_DIM>::zeros();
            step.fixed_view_mut::<3, 3>(NavState::P, NavState::P).copy_from(by_p);
            step.fixed_view_mut::<3, 3>(NavState::P, NavState::ROT).copy_from(&(skew(arm) * by_rot));
            step.fixed_view_mut::<3, 3>(NavState::ROT, NavState::ROT).copy_from(by_rot);
            step
        };
        let by_frame = step(&Matrix3::identity(), &body.rot_o_b, &(body.p_o_b - pivot_o));
        let by_rig = step(&body.rot_o_b, &camera.rot_o_c, &camera.p_o_c) * mount.by_rig;
        Self(std::array::from_fn(|i| {
            std::array::from_fn(|k| match k {
                0..AT_FRAME => by_rig[(i, k)] * rig_mask[k],
                AT_FRAME..LIFT_END => by_frame[(i, k - AT_FRAME)],
                _ => 0.0,
            })
        }))
    }

    /// By the extrinsics.
    #[must_use]
    pub fn by_rig(&self) -> SMatrix<f64, POSE_DIM, EXTRINSICS_DIM> {
        SMatrix::from_fn(|i, k| self.0[i][k])
    }

    /// By the frame's pose.
    #[must_use]
    pub fn by_frame(&self) -> SMatrix<f64, POSE_DIM, POSE_DIM> {
        SMatrix::from_fn(|i, k| self.0[i][AT_FRAME + k])
    }

    /// A row by the camera's pose as one by extrinsics and the frame's pose.
    #[inline(always)]
    fn lifted(&self, row: &[f64; POSE_DIM]) -> [f64; LIFT_COLUMNS] {
        let mut out = [0.0; LIFT_COLUMNS];
        for (factor, lift) in row.iter().zip(&self.0) {
            for k in 0..LIFT_COLUMNS {
                out[k] += factor * lift[k];
            }
        }
        out
    }
}

/// `L` of all cameras, and the memory that `L'HL` needs.
#[derive(Clone, Debug)]
pub struct Lifts {
    /// Frame by frame, the left camera first.
    lifts: Vec<Lift>,
    cameras: usize,
    /// Derivative of the time offset by itself: 0 where it is held fixed.
    by_time_offset: f64,
    /// `L'UL`, with the upper triangle `U` of `H`, its diagonal halved.
    half: Vec<[f64; MAX_VISUAL]>,
}

impl Default for Lifts {
    /// Room for any window.
    fn default() -> Self {
        Self {
            lifts: Vec::with_capacity(2 * MAX_FRAMES),
            cameras: 1,
            by_time_offset: 0.0,
            half: vec![[0.0; MAX_VISUAL]; MAX_VISUAL],
        }
    }
}

impl Lifts {
    /// Takes over the poses of the frames' bodies at which Jacobians are taken.
    pub fn refresh(
        &mut self,
        bodies: &[BodyPose],
        mounts: &[Mount],
        pivot_o: &Vector3<f64>,
        rig_mask: &SVector<f64, RIG_DIM>,
    ) {
        self.lifts.clear();
        self.cameras = mounts.len();
        self.by_time_offset = rig_mask[Rig::TIME_OFFSET];
        for body in bodies {
            self.lifts.extend(mounts.iter().map(|mount| Lift::of(body, mount, pivot_o, rig_mask)));
        }
    }

    /// Adds the normal equations of the cameras to those of rig, heading and poses.
    pub fn lift(&mut self, cameras: &NormalEquations, visual: &mut NormalEquations) {
        let dim = visual.dim();
        for row in &mut self.half[..dim] {
            row[..dim].fill(0.0);
        }
        for i in 0..cameras.dim() {
            let row = self.row(cameras.row(i), i);
            self.add_row(i, &row[..dim]);
            self.add_gradient(i, cameras.gradient()[i], visual.gradient_mut());
        }
        for i in 0..dim {
            for (k, to) in visual.row_mut(i).iter_mut().enumerate() {
                *to += self.half[i][i + k] + self.half[i + k][i];
            }
        }
    }

    /// Row `i` of `UL`, where `upper` is that of `H` from the diagonal on.
    fn row(&self, upper: &[f64], i: usize) -> [f64; MAX_VISUAL] {
        let mut out = [0.0; MAX_VISUAL];
        let u = |k: usize| if k == i { 0.5 * upper[0] } else { upper[k - i] };
        if i == CAMERA_TIME_OFFSET {
            out[Rig::TIME_OFFSET] = u(CAMERA_TIME_OFFSET) * self.by_time_offset;
        }
        if i <= CAMERA_HEADING {
            out[HEADING] = u(CAMERA_HEADING);
        }
        let first = i.saturating_sub(CAMERA_GLOBALS) / POSE_DIM;
        for camera in first..self.lifts.len() {
            let at = unknown_of_camera(camera);
            let row = std::array::from_fn(|k| if at + k < i { 0.0 } else { u(at + k) });
            self.add_lifted(camera, &row, &mut out);
        }
        out
    }

    /// Adds a row by the pose of `camera`, lifted, to one by rig, heading and poses.
    #[inline(always)]
    pub(super) fn add_lifted(&self, camera: usize, row: &[f64; POSE_DIM], to: &mut [f64; MAX_VISUAL]) {
        let lifted = self.lifts[camera].lifted(row);
        let at = self.pose_of(camera);
        add_times(&mut to[..AT_FRAME], 1.0, &lifted[..AT_FRAME]);
        add_times(&mut to[at..at + POSE_DIM], 1.0, &lifted[AT_FRAME..LIFT_END]);
    }

    /// Place of the pose of a camera's frame among the visual unknowns.
    fn pose_of(&self, camera: usize) -> usize {
        visual_of_frame(camera / self.cameras)
    }

    /// Adds a derivative by the time offset to a row by rig, heading and poses.
    #[inline]
    pub(super) fn add_time_offset(&self, value: f64, to: &mut [f64; MAX_VISUAL]) {
        to[Rig::TIME_OFFSET] += value * self.by_time_offset;
    }

    /// Adds row `i` of `L'` times `row`.
    fn add_row(&mut self, i: usize, row: &[f64]) {
        match i {
            CAMERA_TIME_OFFSET => add_times(&mut self.half[Rig::TIME_OFFSET], self.by_time_offset, row),
            CAMERA_HEADING => add_times(&mut self.half[HEADING], 1.0, row),
            _ => {
                let (camera, k) = ((i - CAMERA_GLOBALS) / POSE_DIM, (i - CAMERA_GLOBALS) % POSE_DIM);
                let at = self.pose_of(camera);
                let (rig, frame) = self.lifts[camera].0[k].split_at(AT_FRAME);
                for (to, factor) in self.half.iter_mut().zip(rig) {
                    add_times(to, *factor, row);
                }
                for (to, factor) in self.half[at..at + POSE_DIM].iter_mut().zip(frame) {
                    add_times(to, *factor, row);
                }
            }
        }
    }

    fn add_gradient(&self, i: usize, value: f64, to: &mut [f64]) {
        match i {
            CAMERA_TIME_OFFSET => to[Rig::TIME_OFFSET] += value * self.by_time_offset,
            CAMERA_HEADING => to[HEADING] += value,
            _ => {
                let (camera, k) = ((i - CAMERA_GLOBALS) / POSE_DIM, (i - CAMERA_GLOBALS) % POSE_DIM);
                let at = self.pose_of(camera);
                let (rig, frame) = self.lifts[camera].0[k].split_at(AT_FRAME);
                add_times(&mut to[..AT_FRAME], value, rig);
                add_times(&mut to[at..at + POSE_DIM], value, frame);
            }
        }
    }
}

/// `to += factor * from`.
fn add_times(to: &mut [f64], factor: f64, from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}
