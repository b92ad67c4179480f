//! What every kind of landmark has in common: parameters in the camera that hosts it, seen from another.

use super::manhattan::Manhattan;
use super::state::{Mount, NavState};
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use std::fmt::Debug;

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

/// Where a factor looks from and to.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Pose of the host's body.
    pub host: &'a BodyPose,
    /// Mounting of the host's camera.
    pub host_mount: &'a Mount,
    /// Pose of the observer's body.
    pub target: &'a BodyPose,
    /// Mounting of the observer's camera.
    pub target_mount: &'a Mount,
}

/// Derivatives of a residual of two components by everything it depends on.
#[derive(Clone, Debug)]
pub struct Jacobians<const D: usize> {
    /// By the host's pose (position, attitude).
    pub host: SMatrix<f64, 2, 6>,
    /// By the observer's pose.
    pub target: SMatrix<f64, 2, 6>,
    /// By the rig (12 of extrinsics, time offset).
    pub rig: SMatrix<f64, 2, 13>,
    /// By the landmark's own parameters.
    pub landmark: SMatrix<f64, 2, D>,
}

/// Parameters of a landmark in its host camera.
pub trait Feature: Copy + Debug + PartialEq {
    /// What a camera measures of it.
    type Measurement: Copy + Debug;

    /// Difference of prediction and measurement in standard deviations; `time_offset_step_s` is
    /// `td - td_frame`. `None` where the observer cannot see it.
    fn residual(
        &self,
        view: &View<'_>,
        measured: &Self::Measurement,
        time_offset_step_s: f64,
    ) -> Option<Vector2<f64>>;

    /// The measurement with its rate of change as an observer with angular rate `rate_b` (rad/s) and
    /// velocity `v_b` (m/s), both in its body frame, would see it.
    fn with_rate(
        &self,
        view: &View<'_>,
        measured: &Self::Measurement,
        rate_b: &Vector3<f64>,
        v_b: &Vector3<f64>,
    ) -> Option<Self::Measurement>;

    /// The same landmark hosted by the observer; `None` where it cannot see it.
    fn hosted_by_target(&self, view: &View<'_>) -> Option<Self>;

    /// What the structure of the scene says against it, in standard deviations; nothing about most features.
    fn structural_residual(
        &self,
        _structure: &Manhattan,
        _host: &BodyPose,
        _mount: &Mount,
    ) -> Option<Vector2<f64>> {
        None
    }
}

/// A feature of `D` degrees of freedom.
pub trait Estimated<const D: usize>: Feature {
    /// Derivatives of [`Feature::residual`]; `None` where the observer cannot see it.
    fn jacobians(&self, view: &View<'_>, measured: &Self::Measurement) -> Option<Jacobians<D>>;

    /// Derivatives of [`Feature::structural_residual`]; those by the heading apart.
    fn structural_jacobians(
        &self,
        _structure: &Manhattan,
        _host: &BodyPose,
        _mount: &Mount,
    ) -> Option<(Jacobians<D>, Vector2<f64>)> {
        None
    }

    /// The feature with the step `d` applied.
    #[must_use]
    fn plus(&self, d: &SVector<f64, D>) -> Self;
}
