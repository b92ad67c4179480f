//! Enhanced unified camera model.
//!
//! With the normalized coordinates `(x, y)` and `d = sqrt(1 + beta (x² + y²))`:
//!
//! ```text
//! (x_d, y_d) = (x, y) / (alpha d + 1 - alpha)
//! ```
//!
//! Source: Khomutenko, Garcia and Martinet, "An enhanced unified camera model", RA-L 1 (2016), equations 1 to 4 and 14.
//! `alpha` is from 0 to 1 and `beta` is positive: then the model holds for all points before the camera.

use super::{MAX_RADIUS_SQUARED, MIN_COS};
use nalgebra::{Matrix2, Vector2};

/// Coefficients `alpha beta`.
pub(super) type Coefficients = [f64; 2];

/// True if ideal coordinates lie on the branch that holds the image.
#[inline]
pub(super) fn is_regular(r2: f64, [alpha, beta]: Coefficients) -> bool {
    let d2 = 1.0 + beta * r2;
    r2 < MAX_RADIUS_SQUARED && d2 > 0.0 && (0.0..=1.0).contains(&alpha)
}

/// Distorted coordinates, and their derivative by the ideal ones.
#[inline]
pub(super) fn distort(xy: &Vector2<f64>, [alpha, beta]: Coefficients) -> (Vector2<f64>, Matrix2<f64>) {
    let d = (1.0 + beta * xy.norm_squared()).sqrt();
    let scale = 1.0 / (alpha * d + (1.0 - alpha));
    let m = xy * scale;
    (m, Matrix2::identity() * scale - m * m.transpose() * (alpha * beta / d))
}

/// Derivatives of the distorted coordinates by the coefficients, in their order.
pub(super) fn by_coefficients(xy: &Vector2<f64>, [alpha, beta]: Coefficients) -> [Vector2<f64>; 2] {
    let r2 = xy.norm_squared();
    let d = (1.0 + beta * r2).sqrt();
    let scale = 1.0 / (alpha * d + (1.0 - alpha));
    let by_scale = xy * (-scale * scale);
    [by_scale * (d - 1.0), by_scale * (alpha * r2 / (2.0 * d))]
}

/// Ideal coordinates of distorted ones; `None` too where the ray is further than 89.4 degrees from the axis.
///
/// With `rho² = x_d² + y_d²` the ray is `(x_d, y_d, z)`,
/// `z = (1 - beta alpha² rho²) / (alpha sqrt(1 - (2 alpha - 1) beta rho²) + 1 - alpha)`.
#[inline]
pub(super) fn undistort(target: &Vector2<f64>, [alpha, beta]: Coefficients) -> Option<Vector2<f64>> {
    let rho2 = target.norm_squared();
    let radicand = 1.0 - (2.0 * alpha - 1.0) * beta * rho2;
    if radicand.is_nan() || radicand < 0.0 {
        return None;
    }
    let z = (1.0 - beta * alpha * alpha * rho2) / (alpha * radicand.sqrt() + (1.0 - alpha));
    (z > MIN_COS * (rho2 + z * z).sqrt() && rho2.is_finite()).then(|| target / z)
}
