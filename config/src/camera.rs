//! Camera models: a pinhole with radial-tangential or equidistant distortion.
//!
//! Frames and spaces: a point `p_c` in the camera frame `C` (z forward, x right, y down, metres) has the
//! normalized coordinates `(x, y) = (p_c.x / p_c.z, p_c.y / p_c.z)`; distortion maps those to distorted
//! normalized coordinates; the intrinsics map these to pixels, with the centre of the first pixel at
//! `(0, 0)`.
//!
//! Sources: Brown (1966) as in OpenCV's `projectPoints` for radial-tangential; Kannala and Brandt (2006)
//! as in OpenCV's `fisheye` for equidistant.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Closest depth that is still projected, in metres.
const MIN_DEPTH_M: f64 = 1e-6;
/// Newton steps of the inverse distortion; five reach machine precision within a EuRoC image.
const UNDISTORT_STEPS: usize = 20;
/// Distorted-coordinate residual at which the inverse distortion counts as found (about 1e-8 px).
const UNDISTORT_TOLERANCE: f64 = 1e-11;

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
    pub fn distort(&self, xy: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match *self {
            Self::RadialTangential { k1, k2, p1, p2 } => distort_radtan(xy, k1, k2, p1, p2),
            Self::Equidistant { k1, k2, k3, k4 } => distort_equidistant(xy, [k1, k2, k3, k4]),
        }
    }
}

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

fn distort_equidistant(xy: &Vector2<f64>, k: [f64; 4]) -> (Vector2<f64>, Matrix2<f64>) {
    let r = xy.norm();
    if r < 1e-8 {
        return (*xy, Matrix2::identity());
    }
    let theta = r.atan();
    let t2 = theta * theta;
    let poly = 1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])));
    let d_poly = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])));
    let scale = theta * poly / r;
    let d_theta_d_by_r = d_poly / (1.0 + r * r);
    let d_scale_by_r = (d_theta_d_by_r - scale) / r;
    let unit = xy / r;
    (xy * scale, Matrix2::identity() * scale + xy * unit.transpose() * d_scale_by_r)
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
    /// Pixel of a point in the camera frame; `None` behind or on the camera's plane.
    /// The pixel may lie outside the image: see [`Self::contains`].
    #[must_use]
    pub fn project(&self, p_c: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.project_with_jacobian(p_c).map(|(px, _)| px)
    }

    /// As [`Self::project`], with the derivative of the pixel by the point (px/m).
    #[must_use]
    pub fn project_with_jacobian(&self, p_c: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if p_c.z < MIN_DEPTH_M {
            return None;
        }
        let inv_z = 1.0 / p_c.z;
        let xy = Vector2::new(p_c.x * inv_z, p_c.y * inv_z);
        let (px, px_by_xy) = self.project_normalized(&xy);
        let xy_by_p = Matrix2x3::new(inv_z, 0.0, -xy.x * inv_z, 0.0, inv_z, -xy.y * inv_z);
        Some((px, px_by_xy * xy_by_p))
    }

    /// Pixel of ideal normalized coordinates, with its derivative (px per unit).
    #[must_use]
    pub fn project_normalized(&self, xy: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (distorted, jacobian) = self.distortion.distort(xy);
        let px = distorted.component_mul(&self.focal_px) + self.centre_px;
        (px, Matrix2::from_diagonal(&self.focal_px) * jacobian)
    }

    /// Ideal normalized coordinates of a pixel, by Newton's method; `None` where the model has no inverse.
    #[must_use]
    pub fn unproject(&self, px: &Vector2<f64>) -> Option<Vector2<f64>> {
        let target = (px - self.centre_px).component_div(&self.focal_px);
        let mut xy = match self.distortion {
            Distortion::RadialTangential { .. } => target,
            Distortion::Equidistant { .. } => {
                // Undo the undistorted fisheye first: r_d = theta, r = tan(theta).
                let r = target.norm();
                if r < 1e-8 { target } else { target * (r.min(1.5).tan() / r) }
            }
        };
        for _ in 0..UNDISTORT_STEPS {
            let (distorted, jacobian) = self.distortion.distort(&xy);
            let error = distorted - target;
            if error.norm() < UNDISTORT_TOLERANCE {
                return Some(xy);
            }
            xy -= jacobian.try_inverse()? * error;
        }
        let (distorted, _) = self.distortion.distort(&xy);
        ((distorted - target).norm() < 1e-9).then_some(xy)
    }

    /// Whether a pixel lies inside the image, at least `border_px` from its edge.
    #[must_use]
    pub fn contains(&self, px: &Vector2<f64>, border_px: f64) -> bool {
        px.x >= border_px
            && px.y >= border_px
            && px.x <= self.width_px as f64 - 1.0 - border_px
            && px.y <= self.height_px as f64 - 1.0 - border_px
    }
}
