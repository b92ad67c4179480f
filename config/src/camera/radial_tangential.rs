//! Brown's model: radial and tangential distortion of a pinhole.
//!
//! With the ideal normalized coordinates `(x, y)` and `r² = x² + y²`:
//!
//! ```text
//! x_d = x (1 + k1 r² + k2 r⁴) + 2 p1 x y + p2 (r² + 2 x²)
//! y_d = y (1 + k1 r² + k2 r⁴) + p1 (r² + 2 y²) + 2 p2 x y
//! ```
//!
//! Source: Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32 (1966), in the form of OpenCV's
//! `projectPoints`. Domain: up to the smallest radius at which the radial part folds back.

use super::MAX_RADIUS_SQUARED;
use super::newton::{UNDISTORT_TOLERANCE, invert};
use crate::Portable;
use nalgebra::{Matrix2, Vector2};

/// Coefficients `k1 k2 p1 p2`.
pub(super) type Coefficients = [f64; 4];

/// True if ideal coordinates lie before the fold.
#[inline]
pub(super) fn is_regular(r2: f64, [k1, k2, ..]: Coefficients) -> bool {
    r2 < regular_radius_squared(k1, k2)
}

/// Square of the radius within which the radial model is regular.
#[inline]
pub(super) fn regular_radius_squared(k1: f64, k2: f64) -> f64 {
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

/// Distorted coordinates, and their derivative by the ideal ones.
#[inline]
pub(super) fn distort(xy: &Vector2<f64>, [k1, k2, p1, p2]: Coefficients) -> (Vector2<f64>, Matrix2<f64>) {
    let r2 = xy.x * xy.x + xy.y * xy.y;
    bent(xy, r2, (1.0 + r2 * (k1 + r2 * k2), 2.0 * (k1 + 2.0 * k2 * r2)), [p1, p2])
}

/// Coordinates distorted by a radial factor, given with twice its derivative by `r²`, and by tangential coefficients; and their
/// derivative by the ideal ones.
#[inline]
pub(super) fn bent(
    xy: &Vector2<f64>,
    r2: f64,
    (radial, d_radial): (f64, f64),
    [p1, p2]: [f64; 2],
) -> (Vector2<f64>, Matrix2<f64>) {
    let (x, y) = (xy.x, xy.y);
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

/// Derivatives of the distorted coordinates by `k1`, `k2`, `p1`, `p2`.
pub(super) fn by_coefficients(xy: &Vector2<f64>, _: Coefficients) -> [Vector2<f64>; 4] {
    let (x, y, r2) = (xy.x, xy.y, xy.norm_squared());
    [
        xy * r2,
        xy * (r2 * r2),
        Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
        Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
    ]
}

/// Ideal coordinates of distorted ones.
#[inline]
pub(super) fn undistort(target: &Vector2<f64>, k: Coefficients) -> Option<Vector2<f64>> {
    undistort_to(target, k, UNDISTORT_TOLERANCE)
}

/// As [`undistort`], to a tolerance of its own.
#[inline]
pub(super) fn undistort_to(target: &Vector2<f64>, k: Coefficients, tolerance: f64) -> Option<Vector2<f64>> {
    let reach = regular_radius_squared(k[0], k[1]);
    invert(target, tolerance, |xy| xy.norm_squared() < reach, |xy| distort(xy, k))
}
