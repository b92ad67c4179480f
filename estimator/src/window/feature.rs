//! Common parts of every kind of landmark: parameters in the camera that hosts it, seen from another.
//!
//! Observations of it enter by the reprojection factors of points and lines ([`super::reprojection`], [`super::line`]).

use super::OUTLIER_SIGMAS;
use super::camera_poses::{CameraMotion, CameraPose, CameraView};
use super::factor::Linearization;
use super::options::Options;
use super::quad::Quad;
use nalgebra::{SMatrix, SVector, Vector2};
use std::fmt::Debug;

/// Derivative by a motion ([`super::motions`]): for both components, by position and by attitude, each with a lane more.
pub type MotionJacobian = [[Quad; 2]; 2];

/// Derivatives of a residual of two components by everything it depends on.
#[derive(Clone, Debug)]
pub struct Jacobians<const D: usize> {
    /// By a motion of the host's camera in `O`. A motion of the observer's camera has the opposite sign.
    pub camera: MotionJacobian,
    /// By a motion of the host's camera, in the axes of that camera.
    pub host: MotionJacobian,
    /// By a motion of the host's camera, in the axes of the observer's camera. A motion of the observer's camera has
    /// the opposite sign.
    pub target: MotionJacobian,
    /// By the time offset.
    pub time_offset: Vector2<f64>,
    /// By the landmark's own parameters, 2xD.
    pub landmark: SMatrix<f64, 2, D>,
}

impl<const D: usize> Jacobians<D> {
    /// All zero, to be filled by a factor.
    pub fn zeros() -> Self {
        let zero = [[[0.0; 4]; 2]; 2];
        Self {
            camera: zero,
            host: zero,
            target: zero,
            time_offset: Vector2::zeros(),
            landmark: SMatrix::zeros(),
        }
    }
}

/// A request for the Jacobians of an observation, to be taken as seen from a view.
pub type ViewLinearization<'a, J> = Linearization<'a, CameraView<'a>, J>;

/// Parameters of a landmark in its host camera.
pub trait Feature: Copy + Debug + PartialEq {
    /// Measurement of it by a camera.
    type Measurement: Copy + Debug;
    /// Derivatives of its residuals: [`Jacobians`].
    type Jacobians;

    /// Where a landmark is in `O`, and what else its observations have in common.
    type Placed: Debug;

    /// Distance of an observation from its landmark beyond which it is an outlier, in standard deviations.
    fn outlier_sigmas(_options: &Options) -> f64 {
        OUTLIER_SIGMAS
    }

    /// Standard deviation of a measurement, as a multiple of the stated one.
    fn sigma(_options: &Options) -> f64 {
        1.0
    }

    /// Where the landmark is with its host camera at `host`.
    fn placed(&self, host: &CameraPose) -> Self::Placed;

    /// Difference of prediction and measurement in standard deviations, as seen from `target`;
    /// `time_offset_step_s` is `td - td_frame`. `None` where the observer cannot see it.
    fn residual_of(
        placed: &Self::Placed,
        target: &CameraPose,
        measured: &Self::Measurement,
        time_offset_step_s: f64,
    ) -> Option<Vector2<f64>>;

    /// The measurement with its weights times `scale`: residual and Jacobians are so much larger.
    fn weighed(measured: &Self::Measurement, scale: f64) -> Self::Measurement;

    /// Writes the Jacobians of that as seen from `view`, by whose host the landmark has been placed.
    fn linearize(
        placed: &Self::Placed,
        view: CameraView<'_>,
        measured: &Self::Measurement,
        jacobians: &mut Self::Jacobians,
    ) -> Option<()>;

    /// Places of a measurement in the image that belong to the two residuals, in normalized coordinates.
    fn places(measured: &Self::Measurement) -> [Vector2<f64>; 2];

    /// Derivatives of the two residuals by their places, as seen from `target`; `None` where it cannot see the landmark.
    fn by_places(
        placed: &Self::Placed,
        target: &CameraPose,
        measured: &Self::Measurement,
    ) -> Option<[Vector2<f64>; 2]>;

    /// Moves the [`Self::places`] of a measurement by what `shift` makes of them.
    fn move_places(measured: &mut Self::Measurement, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>);

    /// Moves them, and what the rows of a rolling shutter saw.
    fn move_all_places(measured: &mut Self::Measurement, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>);

    /// Residual of an observation and, on request, its Jacobians.
    fn residual(
        &self,
        view: CameraView<'_>,
        measured: &Self::Measurement,
        time_offset_step_s: f64,
        linearization: Option<ViewLinearization<'_, Self::Jacobians>>,
    ) -> Option<Vector2<f64>> {
        if let Some(Linearization { at, jacobians }) = linearization {
            Self::linearize(&self.placed(at.host), at, measured, jacobians)?;
        }
        Self::residual_of(&self.placed(view.host), view.target, measured, time_offset_step_s)
    }

    /// The measurement with its rate of change as an observing camera of this motion would see it.
    fn with_rate(
        &self,
        view: CameraView<'_>,
        measured: &Self::Measurement,
        motion: &CameraMotion,
    ) -> Option<Self::Measurement>;

    /// Returns the landmark hosted by the observer instead; `None` if the observer cannot see it.
    fn hosted_by_target(&self, view: CameraView<'_>) -> Option<Self>;
}

/// A feature of `D` degrees of freedom.
pub trait Estimated<const D: usize>: Feature<Jacobians = Jacobians<D>> {
    /// The feature with the step `d` applied.
    fn plus(&self, d: &SVector<f64, D>) -> Self;
}
