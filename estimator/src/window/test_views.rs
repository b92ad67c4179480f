//! Random poses and views for the tests of the factors.

use super::camera_poses::{CameraPose, CameraView};
use super::feature::Jacobians;
use super::motions::{frame_motion, on_mount};
use super::state::{BodyPose, Mount, NavState, RIG_DIM, Rig};
use crate::geometry::exp_so3;
use nalgebra::{Isometry3, SMatrix, Translation3, Vector3};
use proptest::prelude::*;

pub fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(move |v| Vector3::from(v) * scale)
}

pub fn isometry(p_scale: f64, angle: f64) -> impl Strategy<Value = Isometry3<f64>> {
    (vector(p_scale), vector(angle))
        .prop_map(|(p, phi)| Isometry3::from_parts(Translation3::from(p), exp_so3(&phi)))
}

/// Calls `use_it` with the view as poses of the cameras, from a pivot some way off.
pub fn with_cameras<T>(
    rig: &Rig,
    (host, target): (&NavState, &NavState),
    cameras: (usize, usize),
    use_it: impl FnOnce(CameraView<'_>) -> T,
) -> T {
    let pose =
        |nav: &NavState, camera: usize| CameraPose::of(&BodyPose::of(nav), &Mount::of(rig, camera), &PIVOT_O);
    use_it(CameraView { host: &pose(host, cameras.0), target: &pose(target, cameras.1) })
}

/// Pivot of the cameras of random views.
pub const PIVOT_O: Vector3<f64> = Vector3::new(0.7, -1.1, 0.4);

/// Derivatives of a residual by host, observer and rig.
#[derive(Clone, Debug)]
pub struct Lifted {
    pub host: SMatrix<f64, 2, 6>,
    pub target: SMatrix<f64, 2, 6>,
    pub rig: SMatrix<f64, 2, RIG_DIM>,
}

impl Lifted {
    /// Lifted derivatives that follow from `j` by motions.
    pub fn of<const D: usize>(
        j: &Jacobians<D>,
        rig: &Rig,
        (host, target): (&NavState, &NavState),
        cameras: (usize, usize),
    ) -> Self {
        let time_offset = j.time_offset;
        let by_frame = |nav: &NavState| frame_motion(&BodyPose::of(nav), &PIVOT_O);
        let by_rig = |camera: usize| on_mount(&Mount::of(rig, camera));
        let j = [&j.camera, &j.host, &j.target]
            .map(|by| SMatrix::<f64, 2, 6>::from_fn(|d, k| by[d][k / 3][k % 3]));
        let mut by_all = SMatrix::<f64, 2, RIG_DIM>::zeros();
        by_all.fixed_columns_mut::<12>(0).copy_from(&(j[1] * by_rig(cameras.0) - j[2] * by_rig(cameras.1)));
        by_all.set_column(Rig::TIME_OFFSET, &time_offset);
        Self { host: j[0] * by_frame(host), target: -j[0] * by_frame(target), rig: by_all }
    }
}
