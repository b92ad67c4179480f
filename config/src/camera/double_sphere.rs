//! Double-sphere model.
//!
//! The point is projected to a unit sphere, then to a second one shifted by `xi`, then to the plane of a pinhole shifted by
//! `alpha / (1 - alpha)`. With the normalized coordinates `(x, y)`, `r² = x² + y²`:
//!
//! ```text
//! d1 = sqrt(r² + 1)
//! z1 = xi d1 + 1
//! d2 = sqrt(r² + z1²)
//! (x_d, y_d) = (x, y) / (alpha d2 + (1 - alpha) z1)
//! ```
//!
//! Source: Usenko, Demmel and Cremers, "The double sphere camera model", 3DV 2018, equations 40 to 51; `xi` from -1 to 1,
//! `alpha` from 0 to 1. Domain: `z1 > -w1 d2` with `w1 = alpha / (1 - alpha)` for `alpha <= 0.5`, else `(1 - alpha) / alpha`:
//! there the denominator is positive and the distorted radius grows. On the unit sphere that is `z > -w` with
//! `w = xi (1 - w1²) + w1 sqrt(1 - xi² (1 - w1²))`. (The paper's `w2`, equation 43, is near to it for small `xi`, but lets in
//! points beyond the fold for `xi` near -1.)

use super::{MAX_RADIUS_SQUARED, MIN_COS};
use nalgebra::{Matrix2, Vector2};

/// Coefficients `xi alpha`.
pub(super) type Coefficients = [f64; 2];

/// Negative cosine of the angle from the axis within which the model is injective.
#[inline]
fn reach([xi, alpha]: Coefficients) -> f64 {
    let w1 = if alpha <= 0.5 { alpha / (1.0 - alpha) } else { (1.0 - alpha) / alpha };
    let rest = 1.0 - w1 * w1;
    xi * rest + w1 * (1.0 - xi * xi * rest).sqrt()
}

/// True if ideal coordinates lie on the branch that holds the image.
#[inline]
pub(super) fn is_regular(r2: f64, k: Coefficients) -> bool {
    r2 < MAX_RADIUS_SQUARED && 1.0 > -reach(k) * (1.0 + r2).sqrt()
}

/// Distorted coordinates, and their derivative by the ideal ones.
#[inline]
pub(super) fn distort(xy: &Vector2<f64>, [xi, alpha]: Coefficients) -> (Vector2<f64>, Matrix2<f64>) {
    let r2 = xy.norm_squared();
    let d1 = (r2 + 1.0).sqrt();
    let z1 = xi * d1 + 1.0;
    let d2 = (r2 + z1 * z1).sqrt();
    let scale = 1.0 / (alpha * d2 + (1.0 - alpha) * z1);
    let m = xy * scale;
    // The derivative of the denominator by the coordinates is this times the coordinates.
    let slope = alpha * (1.0 + z1 * xi / d1) / d2 + (1.0 - alpha) * xi / d1;
    (m, Matrix2::identity() * scale - m * m.transpose() * slope)
}

/// Derivatives of the distorted coordinates by the coefficients, in their order.
pub(super) fn by_coefficients(xy: &Vector2<f64>, [xi, alpha]: Coefficients) -> [Vector2<f64>; 2] {
    let r2 = xy.norm_squared();
    let d1 = (r2 + 1.0).sqrt();
    let z1 = xi * d1 + 1.0;
    let d2 = (r2 + z1 * z1).sqrt();
    let scale = 1.0 / (alpha * d2 + (1.0 - alpha) * z1);
    let by_scale = xy * (-scale * scale);
    [by_scale * (d1 * (alpha * z1 / d2 + 1.0 - alpha)), by_scale * (d2 - z1)]
}

/// Ideal coordinates of distorted ones; `None` too where the ray is further than 89.4 degrees from the axis.
///
/// With `rho² = x_d² + y_d²` and
/// `mz = (1 - alpha² rho²) / (alpha sqrt(1 - (2 alpha - 1) rho²) + 1 - alpha)` the ray is
/// `(mz xi + sqrt(mz² + (1 - xi²) rho²)) / (mz² + rho²) (x_d, y_d, mz) - (0, 0, xi)`, of length 1.
#[inline]
pub(super) fn undistort(target: &Vector2<f64>, k: Coefficients) -> Option<Vector2<f64>> {
    let [xi, alpha] = k;
    let rho2 = target.norm_squared();
    let radicand = 1.0 - (2.0 * alpha - 1.0) * rho2;
    if !rho2.is_finite() || radicand.is_nan() || radicand < 0.0 {
        return None;
    }
    let mz = (1.0 - alpha * alpha * rho2) / (alpha * radicand.sqrt() + (1.0 - alpha));
    let root = mz * mz + (1.0 - xi * xi) * rho2;
    if root.is_nan() || root < 0.0 {
        return None;
    }
    let factor = (mz * xi + root.sqrt()) / (mz * mz + rho2);
    let z = factor * mz - xi;
    (z > MIN_COS && z > -reach(k)).then(|| target * (factor / z))
}
