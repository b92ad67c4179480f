//! Camera models: a lens maps ideal normalized coordinates to distorted ones, and intrinsics map those to pixels.
//!
//! Frames and spaces: a point `p_c` in the camera frame `C` (z forward, x right, y down, metres) has the
//! normalized coordinates `(x, y) = (p_c.x / p_c.z, p_c.y / p_c.z)`; distortion maps those to distorted
//! normalized coordinates; the intrinsics map these to pixels, with the centre of the first pixel at
//! `(0, 0)`.
//!
//! Each lens model has a file of its own with its notation, source and domain: `radial_tangential`, `equidistant`,
//! `rational`, `omni`, `eucm`, `double_sphere`.
//!
//! Normalized coordinates tell directions before the camera, so no ray at or beyond a right angle is used, whatever the lens
//! sees: points there have no pixel, and pixels further than 89.4 degrees from the axis have no direction.
//!
//! All is `#[inline]`: this crate is compiled for a short build, its callers for speed.

mod double_sphere;
mod equidistant;
mod eucm;
mod newton;
mod omni;
mod polynomial;
mod radial_tangential;
mod rational;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Closest depth that is still projected, in metres.
const MIN_DEPTH_M: f64 = 1e-6;
/// Square of the largest distance from the optical axis in normalized coordinates, 89.9 degrees: beyond, no
/// lens has an image and the powers of the radius overflow.
const MAX_RADIUS_SQUARED: f64 = 1e6;
/// Largest angle from the optical axis that a fisheye pixel is unprojected to, rad (89.4 degrees): beyond,
/// normalized coordinates lose their meaning.
pub const MAX_THETA_RAD: f64 = 1.56;
/// Cosine of [`MAX_THETA_RAD`].
const MIN_COS: f64 = 0.010_796_117_058_267_392;
/// Most coefficients that a lens model has.
pub const MAX_COEFFICIENTS: usize = 8;
/// Angles at which a fold is looked for: a tenth of a degree apart.
const FOLD_ANGLES: usize = 900;

/// Declares the lens models, each once: its variant with the coefficients in the order in which the literature and calibration
/// files list them, its module, and its name in configurations.
macro_rules! lens_models {
    ($($(#[$about:meta])* $model:ident, $module:ident, $name:literal { $($(#[$meaning:meta])* $k:ident,)* })*) => {
        /// Lens model: maps ideal pinhole coordinates to distorted ones.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "model", deny_unknown_fields)]
        pub enum Distortion {
            $($(#[$about])* #[serde(rename = $name)] $model { $($(#[$meaning])* $k: f64,)* },)*
        }

        impl Distortion {
            /// Names of the models, as configurations have them.
            pub const MODELS: [&'static str; [$($name),*].len()] = [$($name),*];

            /// Distorted normalized coordinates of the ideal ones, and the derivative of the former by the latter.
            #[inline]
            pub fn distort(&self, xy: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
                match *self {
                    $(Self::$model { $($k),* } => $module::distort(xy, [$($k),*]),)*
                }
            }

            /// Ideal normalized coordinates of distorted ones; `None` where the model has no inverse on the branch that holds the
            /// image, or one further than 89.4 degrees from the optical axis.
            #[inline]
            pub fn undistort(&self, target: &Vector2<f64>) -> Option<Vector2<f64>> {
                match *self {
                    $(Self::$model { $($k),* } => $module::undistort(target, [$($k),*]),)*
                }
            }

            /// True if ideal coordinates lie where the distorted radius still grows with the ideal one, that is on
            /// the branch of the model that holds the image. A polynomial fitted to a lens folds back somewhere
            /// beyond the image; what lies there would be projected into the image falsely.
            #[inline]
            pub fn is_regular(&self, xy: &Vector2<f64>) -> bool {
                let r2 = xy.norm_squared();
                match *self {
                    $(Self::$model { $($k),* } => $module::is_regular(r2, [$($k),*]),)*
                }
            }

            /// Derivatives of the distorted coordinates by the coefficients, in the order of [`Self::coefficients`].
            pub fn by_coefficients(&self, xy: &Vector2<f64>) -> Vec<Vector2<f64>> {
                match *self {
                    $(Self::$model { $($k),* } => $module::by_coefficients(xy, [$($k),*]).to_vec(),)*
                }
            }

            /// Name of the model, as configurations have it.
            pub fn model(&self) -> &'static str {
                match self {
                    $(Self::$model { .. } => $name,)*
                }
            }

            /// Coefficients with their names, in the order in which the literature and calibration files list them.
            pub fn coefficients(&self) -> Vec<(&'static str, f64)> {
                match *self {
                    $(Self::$model { $($k),* } => vec![$((stringify!($k), $k)),*],)*
                }
            }

            /// Model of a name, with every coefficient by `of`; `None` for a name that is no model's.
            ///
            /// # Errors
            /// When `of` fails, with its error.
            pub fn read<E>(
                name: &str,
                mut of: impl FnMut(&'static str) -> Result<f64, E>,
            ) -> Result<Option<Self>, E> {
                Ok(Some(match name {
                    $($name => Self::$model { $($k: of(stringify!($k))?),* },)*
                    _ => return Ok(None),
                }))
            }

            /// Model of the same kind with `coefficients`, in the order of [`Self::coefficients`]. Default of missing ones: 0.
            pub fn with_coefficients(&self, coefficients: &[f64]) -> Self {
                let mut given = coefficients.iter().copied();
                match self {
                    $(Self::$model { .. } => Self::$model { $($k: given.next().unwrap_or_default()),* },)*
                }
            }
        }
    };
}

lens_models! {
    /// Brown's model: `r2 = x² + y²`, radial `1 + k1 r2 + k2 r2²`, tangential `p1`, `p2`.
    RadialTangential, radial_tangential, "radial-tangential" {
        /// First radial coefficient.
        k1,
        /// Second radial coefficient.
        k2,
        /// First tangential coefficient.
        p1,
        /// Second tangential coefficient.
        p2,
    }
    /// Fisheye: `theta_d = theta (1 + k1 theta² + k2 theta⁴ + k3 theta⁶ + k4 theta⁸)`.
    Equidistant, equidistant, "equidistant" {
        /// Coefficient of `theta³`.
        k1,
        /// Coefficient of `theta⁵`.
        k2,
        /// Coefficient of `theta⁷`.
        k3,
        /// Coefficient of `theta⁹`.
        k4,
    }
    /// OpenCV's rational model: radial `(1 + k1 r2 + k2 r2² + k3 r2³) / (1 + k4 r2 + k5 r2² + k6 r2³)`, tangential `p1`, `p2`.
    Rational, rational, "rational" {
        /// Coefficient of `r2` above.
        k1,
        /// Coefficient of `r2²` above.
        k2,
        /// First tangential coefficient.
        p1,
        /// Second tangential coefficient.
        p2,
        /// Coefficient of `r2³` above.
        k3,
        /// Coefficient of `r2` below.
        k4,
        /// Coefficient of `r2²` below.
        k5,
        /// Coefficient of `r2³` below.
        k6,
    }
    /// Unified model: `(x, y) / (1 + xi sqrt(1 + r2))`, then as [`Self::RadialTangential`].
    Omni, omni, "omni" {
        /// Distance of the centre of projection from that of the unit sphere.
        xi,
        /// First radial coefficient.
        k1,
        /// Second radial coefficient.
        k2,
        /// First tangential coefficient.
        p1,
        /// Second tangential coefficient.
        p2,
    }
    /// Enhanced unified model: `(x, y) / (alpha sqrt(1 + beta r2) + 1 - alpha)`.
    Eucm, eucm, "eucm" {
        /// Share of the ellipsoid, 0 (pinhole) to 1.
        alpha,
        /// Shape of the ellipsoid; 1 is a sphere.
        beta,
    }
    /// Double sphere: `(x, y) / (alpha d2 + (1 - alpha) (xi d1 + 1))`, `d1 = sqrt(r2 + 1)`, `d2 = sqrt(r2 + (xi d1 + 1)²)`.
    DoubleSphere, double_sphere, "double-sphere" {
        /// Distance of the second sphere from the first.
        xi,
        /// Share of the second sphere, 0 (pinhole) to 1.
        alpha,
    }
}

impl Distortion {
    /// Angle from the optical axis beyond which the model folds back or ends, rad; `None` where it grows as far as pixels are
    /// unprojected.
    pub fn fold_rad(&self) -> Option<f64> {
        let mut angles = (1..=FOLD_ANGLES).map(|i| MAX_THETA_RAD * i as f64 / FOLD_ANGLES as f64);
        angles.find(|theta| !self.is_regular(&Vector2::new(libm::tan(*theta), 0.0)))
    }
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
    #[inline]
    pub fn project(&self, p_c: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.project_with_jacobian(p_c).map(|(px, _)| px)
    }

    /// As [`Self::project`], with the derivative of the pixel by the point (px/m).
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
    #[inline]
    pub fn project_normalized(&self, xy: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (distorted, jacobian) = self.distortion.distort(xy);
        let px = distorted.component_mul(&self.focal_px) + self.centre_px;
        (px, Matrix2::from_diagonal(&self.focal_px) * jacobian)
    }

    /// Ideal normalized coordinates of a pixel; `None` where the model has no inverse on the branch that
    /// holds the image (see [`Distortion::is_regular`]), and of a pixel that is not a number.
    #[inline]
    pub fn unproject(&self, px: &Vector2<f64>) -> Option<Vector2<f64>> {
        self.distortion.undistort(&(px - self.centre_px).component_div(&self.focal_px))
    }

    /// True if a pixel has a direction by the lens model, although one further than 89.4 degrees from the optical axis is not
    /// used. Where the model folds back, pixels have none.
    pub fn has_direction(&self, px: &Vector2<f64>) -> bool {
        if self.unproject(px).is_some() {
            return true;
        }
        if matches!(self.distortion, Distortion::RadialTangential { .. } | Distortion::Rational { .. }) {
            return false;
        }
        let target = (px - self.centre_px).component_div(&self.focal_px);
        let radius = target.norm();
        let (edge, _) = self.distortion.distort(&(target * (libm::tan(MAX_THETA_RAD) / radius)));
        radius >= edge.norm() && self.distortion.fold_rad().is_none()
    }

    /// True if a pixel lies inside the image, at least `border_px` from its edge.
    #[inline]
    pub fn contains(&self, px: &Vector2<f64>, border_px: f64) -> bool {
        px.x >= border_px
            && px.y >= border_px
            && px.x <= self.width_px as f64 - 1.0 - border_px
            && px.y <= self.height_px as f64 - 1.0 - border_px
    }
}
