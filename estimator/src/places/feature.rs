//! A feature of a keyframe: where the left camera sees it, how far it is, and what it looks like.
//!
//! A stereo pair measures of a point the direction `(x, y)` in the left camera and the inverse depth `rho`. The two
//! are kept apart, because their errors are: the direction is out by as much as a corner detector wanders (about a
//! pixel), the inverse depth by as much as patches align (a third of one, divided by the baseline).

use super::descriptor::Descriptor;
use nalgebra::{Matrix3, Vector2, Vector3};
use plumbline_config::Portable;

/// Points whose inverse depth is known worse than this, relative, are of no use as points of a map.
const MAX_RELATIVE_SIGMA: f32 = 0.25;

/// A feature in the left camera `C`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Descriptor of its patch.
    pub descriptor: Descriptor,
    /// Ideal normalized coordinates in the left camera.
    pub xy: Vector2<f32>,
    /// Standard deviation of each of [`Self::xy`].
    pub sigma_xy: f32,
    /// Inverse depth along the optical axis, 1/m; 0 when unknown.
    pub inverse_depth: f32,
    /// Standard deviation of the inverse depth, 1/m; infinite when unknown.
    pub sigma_inverse_depth: f32,
}

impl Feature {
    /// True if its depth is measured.
    pub fn has_depth(&self) -> bool {
        self.sigma_inverse_depth.is_finite()
    }

    /// True if it is a point: in front of the camera, with a depth of sufficient accuracy.
    pub fn is_point(&self) -> bool {
        self.inverse_depth > 0.0 && self.sigma_inverse_depth <= MAX_RELATIVE_SIGMA * self.inverse_depth
    }

    /// Direction with unit depth.
    pub fn ray_c(&self) -> Vector3<f64> {
        Vector3::new(f64::from(self.xy.x), f64::from(self.xy.y), 1.0)
    }

    /// Position in the left camera, m; meaningful for a [point](Self::is_point).
    pub fn position_c(&self) -> Vector3<f64> {
        self.ray_c() / f64::from(self.inverse_depth)
    }

    /// Covariance of [`Self::position_c`], m².
    pub fn covariance_c(&self) -> Matrix3<f64> {
        let depth = 1.0 / f64::from(self.inverse_depth);
        let across = (f64::from(self.sigma_xy) * depth).squared();
        let along = self.ray_c() * (depth * depth * f64::from(self.sigma_inverse_depth));
        Matrix3::from_diagonal(&Vector3::new(across, across, 0.0)) + along * along.transpose()
    }
}
