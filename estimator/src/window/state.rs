//! States of the window: the navigation state of each frame, and the calibration of the rig.
//!
//! Unknowns are steps of the error state, with right perturbations `R <- R Exp(dtheta)` (Forster et al. 2017,
//! section III). All of them in order, as in the normal equations: rig ([`Rig::P_B_C0`] and following), then for each
//! frame position, attitude, velocity and biases ([`NavState::P`] and following). While landmarks are linearized, the unknowns are *motions*: of each camera on its
//! mount, and of each frame in `O` ([`super::motions`]).

use crate::estimate::Estimate;
use crate::geometry::{exp_so3, log_so3, skew};
use crate::inertial::Preintegration;
use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};
use plumbline_config::options::{CameraConfig, RigConfig};
use plumbline_config::{MAX_WINDOW_FRAMES, Timestamp, ValidSetup};

/// Dimension of a frame's error state.
pub const FRAME_DIM: usize = 15;
/// A 15x15 block.
pub type FrameMatrix = SMatrix<f64, FRAME_DIM, FRAME_DIM>;
/// A 15-vector.
pub type FrameVector = SVector<f64, FRAME_DIM>;
/// Dimension of the pose within it.
pub const POSE_DIM: usize = 6;
/// Dimension of the rig's error state: left camera against body (position, attitude), right camera
/// against left (position, attitude), time offset, intrinsics of both cameras.
pub const RIG_DIM: usize = Rig::INTRINSICS + 2 * INTRINSICS_DIM;
/// Refined intrinsics of a camera: focal length, and principal point in both directions.
pub const INTRINSICS_DIM: usize = 3;
/// Their priors are those of a good calibration, since a wrong one shows in spite of them: it may be further off.
const INTRINSICS_TIMES: f64 = 4.0;
/// Most frames in the window: those that validation admits, and one more while a frame is exchanged.
pub const MAX_FRAMES: usize = MAX_WINDOW_FRAMES + 1;

/// Place of the first unknown of frame `index` among all unknowns.
#[must_use]
pub const fn unknown_of_frame(index: usize) -> usize {
    RIG_DIM + FRAME_DIM * index
}

/// Position, attitude, velocity and biases of the body at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NavState {
    /// Position of `B` in `O`, m.
    pub p_o_b: Vector3<f64>,
    /// Attitude: takes coordinates from `B` to `O`.
    pub rot_o_b: UnitQuaternion<f64>,
    /// Velocity of `B` in `O`, m/s.
    pub v_o_b: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub bias_accel: Vector3<f64>,
}

impl NavState {
    /// Offset of the position in the error state, m.
    pub const P: usize = 0;
    /// Offset of the attitude, rad.
    pub const ROT: usize = 3;
    /// Offset of the velocity, m/s.
    pub const V: usize = 6;
    /// Offset of the gyroscope bias, rad/s.
    pub const BIAS_GYRO: usize = 9;
    /// Offset of the accelerometer bias, m/s².
    pub const BIAS_ACCEL: usize = 12;

    /// State of an estimate.
    #[must_use]
    pub fn of(estimate: &Estimate) -> Self {
        Self {
            p_o_b: estimate.pose_o_b.translation.vector,
            rot_o_b: estimate.pose_o_b.rotation,
            v_o_b: estimate.v_o_b,
            bias_gyro: estimate.bias_gyro,
            bias_accel: estimate.bias_accel,
        }
    }

    /// Biases of the gyroscope, rad/s, and of the accelerometer, m/s².
    pub fn biases(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.bias_gyro, self.bias_accel)
    }

    /// The state with the error-state step `d` applied.
    #[must_use]
    pub fn plus(&self, d: &SVector<f64, FRAME_DIM>) -> Self {
        let part = |k: usize| Vector3::new(d[k], d[k + 1], d[k + 2]);
        let turn = exp_so3(&part(Self::ROT));
        Self {
            p_o_b: self.p_o_b + part(Self::P),
            rot_o_b: UnitQuaternion::new_normalize((self.rot_o_b * turn).into_inner()),
            v_o_b: self.v_o_b + part(Self::V),
            bias_gyro: self.bias_gyro + part(Self::BIAS_GYRO),
            bias_accel: self.bias_accel + part(Self::BIAS_ACCEL),
        }
    }

    /// The step that leads from `origin` to this state.
    #[must_use]
    pub fn minus(&self, origin: &Self) -> SVector<f64, FRAME_DIM> {
        let mut d = SVector::<f64, FRAME_DIM>::zeros();
        let turn = log_so3(&(origin.rot_o_b.inverse() * self.rot_o_b));
        d.fixed_rows_mut::<3>(Self::P).copy_from(&(self.p_o_b - origin.p_o_b));
        d.fixed_rows_mut::<3>(Self::ROT).copy_from(&turn);
        d.fixed_rows_mut::<3>(Self::V).copy_from(&(self.v_o_b - origin.v_o_b));
        d.fixed_rows_mut::<3>(Self::BIAS_GYRO).copy_from(&(self.bias_gyro - origin.bias_gyro));
        d.fixed_rows_mut::<3>(Self::BIAS_ACCEL).copy_from(&(self.bias_accel - origin.bias_accel));
        d
    }

    /// True if every component is a finite number.
    pub fn is_finite(&self) -> bool {
        let vectors = [&self.p_o_b, &self.v_o_b, &self.bias_gyro, &self.bias_accel];
        vectors.into_iter().flatten().chain(self.rot_o_b.coords.iter()).all(|x| x.is_finite())
    }

    /// The state after the motion `pre`, at this state's biases (Forster et al. 2017, equation 26, solved for the
    /// later state).
    #[must_use]
    pub fn after(&self, pre: &Preintegration, gravity_o: &Vector3<f64>) -> Self {
        let delta = pre.corrected(&self.bias_gyro, &self.bias_accel);
        let dt = pre.dt_s;
        Self {
            p_o_b: self.p_o_b + self.v_o_b * dt + gravity_o * (0.5 * dt * dt) + self.rot_o_b * delta.p,
            rot_o_b: UnitQuaternion::new_normalize((self.rot_o_b * delta.rot).into_inner()),
            v_o_b: self.v_o_b + gravity_o * dt + self.rot_o_b * delta.v,
            ..self.clone()
        }
    }

    /// The pose.
    pub fn pose_o_b(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.p_o_b), self.rot_o_b)
    }
}

/// When a frame was taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTime {
    /// On the IMU's axis.
    pub stamp: Timestamp,
    /// The offset `t_imu - t_camera` by which it was put there, s.
    pub time_offset_s: f64,
}

impl FrameTime {
    /// Time of the frame by another offset, s.
    #[must_use]
    pub fn by_offset(self, time_offset_s: f64) -> Self {
        Self { stamp: self.stamp.plus_seconds(time_offset_s - self.time_offset_s), time_offset_s }
    }
}

/// The rig's calibration, refined online within its priors.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Pose of the left camera in the body, `T_BC0`.
    pub pose_b_c0: Isometry3<f64>,
    /// Pose of the right camera in the left, `T_C0C1`; identity for a single camera.
    pub pose_c0_c1: Isometry3<f64>,
    /// `t_imu - t_camera`, s.
    pub time_offset_s: f64,
    /// Steps of the intrinsics of each camera from those configured ([`super::lens`]).
    pub intrinsics: [Vector3<f64>; 2],
}

impl Rig {
    /// Offset of the left camera's position in the body in the error state, m.
    pub const P_B_C0: usize = 0;
    /// Offset of its attitude, rad.
    pub const ROT_B_C0: usize = 3;
    /// Offset of the right camera's position in the left camera, m.
    pub const P_C0_C1: usize = 6;
    /// Offset of its attitude, rad.
    pub const ROT_C0_C1: usize = 9;
    /// Offset of the time offset, s.
    pub const TIME_OFFSET: usize = 12;
    /// Offset of the intrinsics of the left camera, then of the right one: focal length as a share, principal point in
    /// focal lengths.
    pub const INTRINSICS: usize = 13;

    /// The rig as configured.
    #[must_use]
    pub fn of(config: &ValidSetup) -> Self {
        let pose_b_c0 = config.left().pose_b_c();
        let pose_c0_c1 =
            config.camera.get(1).map_or_else(Isometry3::identity, |c| pose_b_c0.inverse() * c.pose_b_c());
        let intrinsics = [Vector3::zeros(); 2];
        Self { pose_b_c0, pose_c0_c1, time_offset_s: config.rig.time_offset_s, intrinsics }
    }

    /// Offset of the intrinsics of camera 0 or 1.
    #[must_use]
    pub const fn of_lens(camera: usize) -> usize {
        Self::INTRINSICS + INTRINSICS_DIM * camera
    }

    /// Pose of camera 0 or 1 in the body.
    pub fn pose_b_c(&self, camera: usize) -> Isometry3<f64> {
        if camera == 0 { self.pose_b_c0 } else { self.pose_b_c0 * self.pose_c0_c1 }
    }

    /// The rig with the error-state step `d` applied.
    #[must_use]
    pub fn plus(&self, d: &SVector<f64, RIG_DIM>) -> Self {
        let moved = |pose: &Isometry3<f64>, k: usize| {
            let p = pose.translation.vector + Vector3::new(d[k], d[k + 1], d[k + 2]);
            let rot = pose.rotation * exp_so3(&Vector3::new(d[k + 3], d[k + 4], d[k + 5]));
            Isometry3::from_parts(Translation3::from(p), UnitQuaternion::new_normalize(rot.into_inner()))
        };
        Self {
            pose_b_c0: moved(&self.pose_b_c0, Self::P_B_C0),
            pose_c0_c1: moved(&self.pose_c0_c1, Self::P_C0_C1),
            time_offset_s: self.time_offset_s + d[Self::TIME_OFFSET],
            intrinsics: [0, 1].map(|k| self.intrinsics[k] + d.fixed_rows::<INTRINSICS_DIM>(Self::of_lens(k))),
        }
    }

    /// The step that leads from `origin` to this rig.
    #[must_use]
    pub fn minus(&self, origin: &Self) -> SVector<f64, RIG_DIM> {
        let mut d = SVector::<f64, RIG_DIM>::zeros();
        for (k, to, from) in [
            (Self::P_B_C0, &self.pose_b_c0, &origin.pose_b_c0),
            (Self::P_C0_C1, &self.pose_c0_c1, &origin.pose_c0_c1),
        ] {
            d.fixed_rows_mut::<3>(k).copy_from(&(to.translation.vector - from.translation.vector));
            d.fixed_rows_mut::<3>(k + 3).copy_from(&log_so3(&(from.rotation.inverse() * to.rotation)));
        }
        d[Self::TIME_OFFSET] = self.time_offset_s - origin.time_offset_s;
        for (k, (to, from)) in self.intrinsics.iter().zip(&origin.intrinsics).enumerate() {
            d.fixed_rows_mut::<INTRINSICS_DIM>(Self::of_lens(k)).copy_from(&(to - from));
        }
        d
    }

    /// True if every parameter that has a standard deviation is within `times` that of `origin`; intrinsics within
    /// [`INTRINSICS_TIMES`] as many.
    pub fn is_within(&self, times: f64, origin: &Self, sigmas: &SVector<f64, RIG_DIM>) -> bool {
        let offsets = self.minus(origin);
        let times = |k: usize| if k < Self::INTRINSICS { times } else { INTRINSICS_TIMES * times };
        let is_within = |k: usize| sigmas[k] == 0.0 || offsets[k].abs() <= times(k) * sigmas[k];
        (0..RIG_DIM).all(is_within)
    }

    /// Standard deviations of the configured calibration, in the order of the error state; 0 is fixed.
    #[must_use]
    pub fn sigmas(rig: &RigConfig, cameras: &[CameraConfig]) -> SVector<f64, RIG_DIM> {
        let mut sigmas = SVector::<f64, RIG_DIM>::zeros();
        sigmas.fixed_rows_mut::<3>(Self::P_B_C0).fill(rig.camera_imu_translation_sigma_m);
        sigmas.fixed_rows_mut::<3>(Self::ROT_B_C0).fill(rig.camera_imu_rotation_sigma_rad);
        if cameras.len() > 1 {
            sigmas.fixed_rows_mut::<3>(Self::P_C0_C1).fill(rig.camera_camera_translation_sigma_m);
            sigmas.fixed_rows_mut::<3>(Self::ROT_C0_C1).fill(rig.camera_camera_rotation_sigma_rad);
            // What one camera alone would learn of them is the scale that its forces leave open.
            for (k, camera) in cameras.iter().enumerate().take(2) {
                let [x, y] = camera.focal_px.map(|focal_px| rig.camera_centre_sigma_px / focal_px);
                let lens = Vector3::new(rig.camera_focal_sigma, x, y);
                sigmas.fixed_rows_mut::<INTRINSICS_DIM>(Self::of_lens(k)).copy_from(&lens);
            }
        }
        sigmas[Self::TIME_OFFSET] = rig.time_offset_sigma_s;
        sigmas
    }
}

/// A body pose with its rotation as a matrix.
#[derive(Clone, Debug)]
pub struct BodyPose {
    /// Takes coordinates from `B` to `O`.
    pub rot_o_b: Matrix3<f64>,
    /// Position of `B` in `O`, m.
    pub p_o_b: Vector3<f64>,
}

impl BodyPose {
    /// The pose of a state.
    #[must_use]
    pub fn of(nav: &NavState) -> Self {
        Self { rot_o_b: nav.rot_o_b.to_rotation_matrix().into_inner(), p_o_b: nav.p_o_b }
    }
}

/// A camera's extrinsics with the matrices that factors need.
#[derive(Clone, Debug)]
pub struct Mount {
    /// Rotation from the camera to the body.
    pub rot_b_c: Matrix3<f64>,
    /// Position of the camera in the body, m.
    pub p_b_c: Vector3<f64>,
    /// Derivative of the extrinsics (position, attitude) by the rig's error state without time offset, 6x12.
    pub by_rig: nalgebra::SMatrix<f64, 6, 12>,
}

impl Mount {
    /// The extrinsics of `camera` in a rig.
    #[must_use]
    pub fn of(rig: &Rig, camera: usize) -> Self {
        let pose = rig.pose_b_c(camera);
        let identity = Matrix3::identity();
        let mut by_rig = nalgebra::SMatrix::<f64, 6, 12>::zeros();
        by_rig.fixed_view_mut::<3, 3>(NavState::P, Rig::P_B_C0).copy_from(&identity);
        if camera == 0 {
            by_rig.fixed_view_mut::<3, 3>(NavState::ROT, Rig::ROT_B_C0).copy_from(&identity);
        } else {
            let rot_b_c0 = rig.pose_b_c0.rotation.to_rotation_matrix().into_inner();
            let lever = rot_b_c0 * skew(&rig.pose_c0_c1.translation.vector);
            let rot_c1_c0 = rig.pose_c0_c1.rotation.inverse().to_rotation_matrix().into_inner();
            by_rig.fixed_view_mut::<3, 3>(NavState::P, Rig::ROT_B_C0).copy_from(&-lever);
            by_rig.fixed_view_mut::<3, 3>(NavState::P, Rig::P_C0_C1).copy_from(&rot_b_c0);
            by_rig.fixed_view_mut::<3, 3>(NavState::ROT, Rig::ROT_B_C0).copy_from(&rot_c1_c0);
            by_rig.fixed_view_mut::<3, 3>(NavState::ROT, Rig::ROT_C0_C1).copy_from(&identity);
        }
        Self {
            rot_b_c: pose.rotation.to_rotation_matrix().into_inner(),
            p_b_c: pose.translation.vector,
            by_rig,
        }
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
