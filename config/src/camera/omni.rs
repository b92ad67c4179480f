//! Unified model with radial and tangential distortion: Kalibr's `omni-radtan`, camodocal's `MEI`, OpenCV's `omnidir`.
//!
//! The point is projected to the unit sphere, from there to a plane by a centre that is `xi` behind that of the sphere, and
//! distorted there. With the normalized coordinates `(x, y)` and `s = sqrt(1 + x² + y²)`, the length of `(x, y, 1)`:
//!
//! ```text
//! m          = (x, y) / (1 + xi s)
//! (x_d, y_d) = m, distorted by k1 k2 p1 p2 as in the radial-tangential model
//! ```
//!
//! Source: Mei and Rives, "Single view point omnidirectional camera calibration from planar grids", ICRA 2007, equations 1 to
//! 4 and 6. Domain: the denominator positive, and `m` before the fold of its radial distortion.
//!
//! Near the axis a pixel is `f m = f / (1 + xi) (x, y)`: focal lengths are larger than a pinhole's by `1 + xi`.

use super::newton::FINE_TOLERANCE;
use super::{MAX_RADIUS_SQUARED, MIN_COS, radial_tangential};
use nalgebra::{Matrix2, Vector2};

/// Coefficients `xi k1 k2 p1 p2`.
pub(super) type Coefficients = [f64; 5];

/// Point on the plane, and its derivative by the normalized coordinates.
#[inline]
fn to_plane(xy: &Vector2<f64>, xi: f64) -> (Vector2<f64>, Matrix2<f64>) {
    let s = (1.0 + xy.norm_squared()).sqrt();
    let scale = 1.0 / (1.0 + xi * s);
    let m = xy * scale;
    (m, Matrix2::identity() * scale - m * m.transpose() * (xi / s))
}

/// True if ideal coordinates lie on the branch that holds the image.
#[inline]
pub(super) fn is_regular(r2: f64, [xi, k1, k2, ..]: Coefficients) -> bool {
    if r2.is_nan() || r2 >= MAX_RADIUS_SQUARED {
        return false;
    }
    let denominator = 1.0 + xi * (1.0 + r2).sqrt();
    // |m| = r / denominator, compared without a quotient.
    denominator > 0.0 && r2 < radial_tangential::regular_radius_squared(k1, k2) * (denominator * denominator)
}

/// Distorted coordinates, and their derivative by the ideal ones.
#[inline]
pub(super) fn distort(xy: &Vector2<f64>, [xi, k1, k2, p1, p2]: Coefficients) -> (Vector2<f64>, Matrix2<f64>) {
    let (m, m_by_xy) = to_plane(xy, xi);
    let (distorted, by_m) = radial_tangential::distort(&m, [k1, k2, p1, p2]);
    (distorted, by_m * m_by_xy)
}

/// Derivatives of the distorted coordinates by the coefficients, in their order.
pub(super) fn by_coefficients(xy: &Vector2<f64>, [xi, k1, k2, p1, p2]: Coefficients) -> [Vector2<f64>; 5] {
    let s = (1.0 + xy.norm_squared()).sqrt();
    let (m, _) = to_plane(xy, xi);
    let (_, by_m) = radial_tangential::distort(&m, [k1, k2, p1, p2]);
    let m_by_xi = m * (-s / (1.0 + xi * s));
    let [by_k1, by_k2, by_p1, by_p2] = radial_tangential::by_coefficients(&m, [k1, k2, p1, p2]);
    [by_m * m_by_xi, by_k1, by_k2, by_p1, by_p2]
}

/// Ideal coordinates of distorted ones; `None` too where the ray is further than 89.4 degrees from the axis.
///
/// On the plane of `m` the ray is `(eta m, eta - xi)` with `eta = (xi + sqrt(1 + (1 - xi²) |m|²)) / (1 + |m|²)`, of length 1.
#[inline]
pub(super) fn undistort(target: &Vector2<f64>, [xi, k1, k2, p1, p2]: Coefficients) -> Option<Vector2<f64>> {
    let m = radial_tangential::undistort_to(target, [k1, k2, p1, p2], FINE_TOLERANCE)?;
    let m2 = m.norm_squared();
    let radicand = 1.0 + (1.0 - xi * xi) * m2;
    if radicand.is_nan() || radicand < 0.0 {
        return None;
    }
    let eta = (xi + radicand.sqrt()) / (1.0 + m2);
    let z = eta - xi;
    (eta > 0.0 && z > MIN_COS).then(|| m * (eta / z))
}
