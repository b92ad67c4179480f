//! Camera models: a pinhole with radial-tangential or equidistant distortion.
//!
//! Frames and spaces: a point `p_c` in the camera frame `C` (z forward, x right, y down, metres) has the
//! normalized coordinates `(x, y) = (p_c.x / p_c.z, p_c.y / p_c.z)`; distortion maps those to distorted
//! normalized coordinates; the intrinsics map these to pixels, with the centre of the first pixel at
//! `(0, 0)`.
//!
//! Sources: Brown (1966) as in OpenCV's `projectPoints` for radial-tangential; Kannala and Brandt (2006)
//! as in OpenCV's `fisheye` for equidistant.
//!
//! All is `#[inline]`: this crate is compiled for a short build, its callers for speed.

use crate::Portable;
use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Closest depth that is still projected, in metres.
const MIN_DEPTH_M: f64 = 1e-6;
/// Square of the largest distance from the optical axis in normalized coordinates, 89.9 degrees: beyond, no
/// lens has an image and the powers of the radius overflow.
const MAX_RADIUS_SQUARED: f64 = 1e6;
/// Newton steps of the inverse distortion; five reach machine precision within a EuRoC image.
const UNDISTORT_STEPS: usize = 20;
/// Distorted-coordinate residual at which the inverse distortion counts as found (about 1e-8 px).
const UNDISTORT_TOLERANCE: f64 = 1e-11;
/// Halvings of a Newton step that would leave the regular part of the lens or increase the error.
const UNDISTORT_HALVINGS: usize = 8;
/// Largest angle from the optical axis that a fisheye pixel is unprojected to, rad (89.4 degrees): beyond,
/// normalized coordinates lose their meaning.
const MAX_THETA_RAD: f64 = 1.56;
/// Angles at which a fold is looked for: a tenth of a degree apart.
const FOLD_ANGLES: usize = 900;
/// Points between the axis and an angle at which the equidistant polynomial is watched for a fold.
const FOLD_SAMPLES: usize = 8;

/// How a lens bends the ideal pinhole image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Distortion {
    /// Brown's model: `r2 = x² + y²`, radial `1 + k1 r2 + k2 r2²`, tangential `p1`, `p2`.
    RadialTangential {
        /// First radial coefficient.
        k1: f64,
        /// Second radial coefficient.
        k2: f64,
        /// First tangential coefficient.
        p1: f64,
        /// Second tangential coefficient.
        p2: f64,
    },
    /// Fisheye: `theta_d = theta (1 + k1 theta² + k2 theta⁴ + k3 theta⁶ + k4 theta⁸)`.
    Equidistant {
        /// Coefficient of `theta³`.
        k1: f64,
        /// Coefficient of `theta⁵`.
        k2: f64,
        /// Coefficient of `theta⁷`.
        k3: f64,
        /// Coefficient of `theta⁹`.
        k4: f64,
    },
}

impl Distortion {
    /// Distorted normalized coordinates of the ideal ones, and the derivative of the former by the latter.
    #[must_use]
    #[inline]
    pub fn distort(&self, xy: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match *self {
            Self::RadialTangential { k1, k2, p1, p2 } => distort_radtan(xy, k1, k2, p1, p2),
            Self::Equidistant { k1, k2, k3, k4 } => distort_equidistant(xy, [k1, k2, k3, k4]),
        }
    }

    /// Angle from the optical axis beyond which a fisheye lens folds back, rad; `None` where it grows as far as pixels are
    /// unprojected.
    #[must_use]
    pub fn fold_rad(&self) -> Option<f64> {
        let Self::Equidistant { k1, k2, k3, k4 } = *self else { return None };
        let angles = (1..=FOLD_ANGLES).map(|i| MAX_THETA_RAD * i as f64 / FOLD_ANGLES as f64);
        angles.into_iter().find(|theta| d_theta_d(*theta, [k1, k2, k3, k4]) <= 0.0)
    }

    /// Whether ideal coordinates lie where the distorted radius still grows with the ideal one, that is on
    /// the branch of the model that holds the image. A polynomial fitted to a lens folds back somewhere
    /// beyond the image; what lies there would be projected into the image falsely.
    #[must_use]
    #[inline]
    pub fn is_regular(&self, xy: &Vector2<f64>) -> bool {
        let r2 = xy.norm_squared();
        match *self {
            Self::RadialTangential { k1, k2, .. } => r2 < regular_radius_squared(k1, k2),
            Self::Equidistant { k1, k2, k3, k4 } => {
                r2 < MAX_RADIUS_SQUARED && is_growing(libm::atan(r2.sqrt()), [k1, k2, k3, k4])
            }
        }
    }
}

/// Square of the radius within which the radial model is regular.
#[inline]
fn regular_radius_squared(k1: f64, k2: f64) -> f64 {
    fold_radius_squared(k1, k2).at_most(MAX_RADIUS_SQUARED)
}

/// Square of the smallest radius at which `d/dr (r + k1 r³ + k2 r⁵) = 1 + 3 k1 r² + 5 k2 r⁴` is zero;
/// infinite when it never is.
#[inline]
fn fold_radius_squared(k1: f64, k2: f64) -> f64 {
    let (a, b) = (5.0 * k2, 3.0 * k1);
    let discriminant = b * b - 4.0 * a;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // Of 1 + b u + a u² = 0 the smallest positive root, in the form that neither cancels nor needs a != 0:
    // its reciprocal v = 1/u is the largest root of v² + b v + a = 0.
    let v = 0.5 * (discriminant.sqrt() - b);
    if v > 0.0 { 1.0 / v } else { f64::INFINITY }
}

/// Whether the equidistant radius grows with the angle from the axis to `theta`.
#[inline]
fn is_growing(theta: f64, k: [f64; 4]) -> bool {
    (1..=FOLD_SAMPLES).all(|i| d_theta_d(theta * i as f64 / FOLD_SAMPLES as f64, k) > 0.0)
}

/// Distorted angle `theta_d` over `theta`.
#[inline]
fn theta_scale(theta: f64, k: [f64; 4]) -> f64 {
    let t2 = theta * theta;
    1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))
}

/// Derivative of the distorted angle by `theta`.
#[inline]
fn d_theta_d(theta: f64, k: [f64; 4]) -> f64 {
    let t2 = theta * theta;
    1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
}

#[inline]
fn distort_radtan(xy: &Vector2<f64>, k1: f64, k2: f64, p1: f64, p2: f64) -> (Vector2<f64>, Matrix2<f64>) {
    let (x, y) = (xy.x, xy.y);
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * k2);
    let d_radial = 2.0 * (k1 + 2.0 * k2 * r2);
    let distorted = Vector2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let cross = x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y;
    let jacobian = Matrix2::new(
        radial + x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        radial + y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    (distorted, jacobian)
}

#[inline]
fn distort_equidistant(xy: &Vector2<f64>, k: [f64; 4]) -> (Vector2<f64>, Matrix2<f64>) {
    let r = xy.norm();
    if r < 1e-8 {
        return (*xy, Matrix2::identity());
    }
    let theta = libm::atan(r);
    let scale = theta * theta_scale(theta, k) / r;
    let d_theta_d_by_r = d_theta_d(theta, k) / (1.0 + r * r);
    let d_scale_by_r = (d_theta_d_by_r - scale) / r;
    let unit = xy / r;
    (xy * scale, Matrix2::identity() * scale + xy * unit.transpose() * d_scale_by_r)
}

/// Newton's method from the distorted coordinates; a step is halved while it leaves the regular part or increases the
/// error, so that the solution is on the branch of the centre or there is none.
#[inline]
fn undistort_radtan(target: &Vector2<f64>, [k1, k2, p1, p2]: [f64; 4]) -> Option<Vector2<f64>> {
    if !target.iter().all(|x| x.is_finite()) {
        return None;
    }
    let reach = regular_radius_squared(k1, k2);
    let error_of = |xy: &Vector2<f64>| {
        let (distorted, jacobian) = distort_radtan(xy, k1, k2, p1, p2);
        let error = distorted - target;
        (error, error.norm(), jacobian)
    };
    let mut xy = if target.norm_squared() < reach { *target } else { Vector2::zeros() };
    let (mut error, mut size, mut jacobian) = error_of(&xy);
    for _ in 0..UNDISTORT_STEPS {
        if size < UNDISTORT_TOLERANCE {
            return (jacobian.determinant() > 0.0).then_some(xy);
        }
        let mut step = jacobian.try_inverse()? * error;
        let mut halvings = 0;
        (xy, error, size, jacobian) = loop {
            let candidate = xy - step;
            let (remaining, smaller, jacobian) = error_of(&candidate);
            if candidate.norm_squared() < reach && smaller < size {
                break (candidate, remaining, smaller, jacobian);
            }
            if halvings == UNDISTORT_HALVINGS {
                return None;
            }
            halvings += 1;
            step *= 0.5;
        };
    }
    None
}

/// The angle `theta` of a distorted one, by Newton's method in one dimension, and its direction.
#[inline]
fn undistort_equidistant(target: &Vector2<f64>, k: [f64; 4]) -> Option<Vector2<f64>> {
    let theta_d = target.norm();
    if theta_d < 1e-8 {
        return Some(*target);
    }
    let theta = newton_theta(theta_d, k)?;
    is_growing(theta, k).then(|| target * (libm::tan(theta) / theta_d))
}

/// Solves `theta * theta_scale(theta) = theta_d` within a bracket that Newton's method may not leave.
#[inline]
fn newton_theta(theta_d: f64, k: [f64; 4]) -> Option<f64> {
    let (mut low, mut high) = (0.0, MAX_THETA_RAD);
    let mut theta = theta_d.at_most(MAX_THETA_RAD);
    for _ in 0..UNDISTORT_STEPS {
        let error = theta * theta_scale(theta, k) - theta_d;
        if error.abs() < UNDISTORT_TOLERANCE {
            return Some(theta);
        }
        if error > 0.0 {
            high = theta
        } else {
            low = theta
        }
        let next = theta - error / d_theta_d(theta, k);
        theta = if (low..=high).contains(&next) { next } else { 0.5 * (low + high) };
    }
    None
}

/// A calibrated camera: image size, intrinsics and distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Image width in pixels.
    pub width_px: usize,
    /// Image height in pixels.
    pub height_px: usize,
    /// Focal lengths `(fx, fy)` in pixels.
    pub focal_px: Vector2<f64>,
    /// Principal point `(cx, cy)` in pixels.
    pub centre_px: Vector2<f64>,
    /// Lens distortion.
    pub distortion: Distortion,
}

impl CameraModel {
    /// Pixel of a point in the camera frame; `None` behind or on the camera's plane, and further from the
    /// optical axis than the lens model reaches (see [`Distortion::is_regular`]). The pixel may lie outside the image: see [`Self::contains`].
    #[must_use]
    #[inline]
    pub fn project(&self, p_c: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.project_with_jacobian(p_c).map(|(px, _)| px)
    }

    /// As [`Self::project`], with the derivative of the pixel by the point (px/m).
    #[must_use]
    #[inline]
    pub fn project_with_jacobian(&self, p_c: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if p_c.z.is_nan() || p_c.z < MIN_DEPTH_M {
            return None;
        }
        let inv_z = 1.0 / p_c.z;
        let xy = Vector2::new(p_c.x * inv_z, p_c.y * inv_z);
        if !self.distortion.is_regular(&xy) {
            return None;
        }
        let (px, px_by_xy) = self.project_normalized(&xy);
        let xy_by_p = Matrix2x3::new(inv_z, 0.0, -xy.x * inv_z, 0.0, inv_z, -xy.y * inv_z);
        Some((px, px_by_xy * xy_by_p))
    }

    /// Pixel of ideal normalized coordinates, with its derivative (px per unit); as the formula says, also
    /// beyond the reach of the lens model.
    #[must_use]
    #[inline]
    pub fn project_normalized(&self, xy: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (distorted, jacobian) = self.distortion.distort(xy);
        let px = distorted.component_mul(&self.focal_px) + self.centre_px;
        (px, Matrix2::from_diagonal(&self.focal_px) * jacobian)
    }

    /// Ideal normalized coordinates of a pixel; `None` where the model has no inverse on the branch that
    /// holds the image (see [`Distortion::is_regular`]), and of a pixel that is not a number.
    #[must_use]
    #[inline]
    pub fn unproject(&self, px: &Vector2<f64>) -> Option<Vector2<f64>> {
        let target = (px - self.centre_px).component_div(&self.focal_px);
        match self.distortion {
            Distortion::RadialTangential { k1, k2, p1, p2 } => undistort_radtan(&target, [k1, k2, p1, p2]),
            Distortion::Equidistant { k1, k2, k3, k4 } => undistort_equidistant(&target, [k1, k2, k3, k4]),
        }
    }

    /// Whether a pixel has a direction by the lens model, although one further than 89.4 degrees from the optical axis is not
    /// used. Where the model folds back, pixels have none.
    #[must_use]
    pub fn has_direction(&self, px: &Vector2<f64>) -> bool {
        if self.unproject(px).is_some() {
            return true;
        }
        let Distortion::Equidistant { k1, k2, k3, k4 } = self.distortion else { return false };
        let radius = (px - self.centre_px).component_div(&self.focal_px).norm();
        let reach = MAX_THETA_RAD * theta_scale(MAX_THETA_RAD, [k1, k2, k3, k4]);
        radius >= reach && self.distortion.fold_rad().is_none()
    }

    /// Whether a pixel lies inside the image, at least `border_px` from its edge.
    #[must_use]
    #[inline]
    pub fn contains(&self, px: &Vector2<f64>, border_px: f64) -> bool {
        px.x >= border_px
            && px.y >= border_px
            && px.x <= self.width_px as f64 - 1.0 - border_px
            && px.y <= self.height_px as f64 - 1.0 - border_px
    }
}
