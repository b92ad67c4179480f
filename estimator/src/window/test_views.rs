//! Random poses and views for the tests of the factors.

use super::feature::{BodyPose, View};
use super::state::{Mount, NavState, Rig};
use crate::geometry::exp_so3;
use nalgebra::{Isometry3, Translation3, Vector3};
use proptest::prelude::*;

pub fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1.0..1.0f64).prop_map(move |v| Vector3::from(v) * scale)
}

pub fn isometry(p_scale: f64, angle: f64) -> impl Strategy<Value = Isometry3<f64>> {
    (vector(p_scale), vector(angle))
        .prop_map(|(p, phi)| Isometry3::from_parts(Translation3::from(p), exp_so3(&phi)))
}

/// Hands the view from a camera of the host to one of the target to `use_it`.
pub fn with_view<T>(
    rig: &Rig,
    (host, target): (&NavState, &NavState),
    cameras: (usize, usize),
    use_it: impl FnOnce(&View<'_>) -> T,
) -> T {
    use_it(&View {
        host: &BodyPose::of(host),
        host_mount: &Mount::of(rig, cameras.0),
        target: &BodyPose::of(target),
        target_mount: &Mount::of(rig, cameras.1),
    })
}
