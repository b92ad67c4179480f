//! Poses of the cameras in the odometry frame, from a pivot near the window: landmarks are linearized there
//! ([`super::motions`]).

use super::quad::QuadMatrix;
use super::state::{BodyPose, Mount};
use nalgebra::{Matrix3, Vector3};

/// Pose of a camera in `O`.
#[derive(Clone, Debug)]
pub struct CameraPose {
    /// Takes coordinates from the camera to `O`.
    pub rot_o_c: Matrix3<f64>,
    /// Position of the camera in `O`, from the pivot, m.
    pub p_o_c: Vector3<f64>,
    /// The rotation again, as what is done for each observation wants it.
    pub(super) lanes: QuadMatrix,
}

impl CameraPose {
    /// The camera that `mount` holds to `body`.
    pub fn of(body: &BodyPose, mount: &Mount, pivot_o: &Vector3<f64>) -> Self {
        Self::new(body.rot_o_b * mount.rot_b_c, body.rot_o_b * mount.p_b_c + (body.p_o_b - pivot_o))
    }

    /// The camera at `p_o_c` that `rot_o_c` takes coordinates from.
    pub fn new(rot_o_c: Matrix3<f64>, p_o_c: Vector3<f64>) -> Self {
        Self { rot_o_c, p_o_c, lanes: QuadMatrix::of(&rot_o_c) }
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

/// Motion of a camera in its own axes.
#[derive(Clone, Copy, Debug)]
pub struct CameraMotion {
    /// Angular rate, rad/s.
    pub rate_c: Vector3<f64>,
    /// Velocity, m/s.
    pub v_c: Vector3<f64>,
}

impl CameraMotion {
    /// Motion of the camera that `mount` holds to a body of this angular rate and velocity, both in its axes.
    pub fn of(mount: &Mount, rate_b: &Vector3<f64>, v_b: &Vector3<f64>) -> Self {
        let to_camera = |v: &Vector3<f64>| mount.rot_b_c.tr_mul(v);
        Self { rate_c: to_camera(rate_b), v_c: to_camera(&(v_b + rate_b.cross(&mount.p_b_c))) }
    }
}
