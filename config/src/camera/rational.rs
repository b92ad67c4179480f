//! OpenCV's rational model: radial distortion as a quotient of two polynomials, and tangential distortion, of a pinhole.
//!
//! With the ideal normalized coordinates `(x, y)`, `u = r² = x² + y²`, and the coefficients in OpenCV's order:
//!
//! ```text
//! q   = (1 + k1 u + k2 u² + k3 u³) / (1 + k4 u + k5 u² + k6 u³)
//! x_d = x q + 2 p1 x y + p2 (r² + 2 x²)
//! y_d = y q + p1 (r² + 2 y²) + 2 p2 x y
//! ```
//!
//! Source: OpenCV, `projectPoints` with eight coefficients `k1 k2 p1 p2 k3 k4 k5 k6`; Claus and Fitzgibbon, "A rational
//! function lens distortion model for general cameras", CVPR 2005. OAK, Azure Kinect and the ZED are calibrated by it.
//!
//! Domain: up to the smallest radius at which the denominator `D` or the slope of `r q` vanishes. With numerator `N` the
//! slope has the sign of `N D + 2 u (N' D - N D')`, a polynomial of degree six in `u`.

use super::MAX_RADIUS_SQUARED;
use super::newton::{FINE_TOLERANCE, invert};
use super::polynomial::is_positive;
use super::radial_tangential::bent;
use nalgebra::{Matrix2, Vector2};

/// Coefficients in OpenCV's order: `k1 k2 p1 p2 k3 k4 k5 k6`.
pub(super) type Coefficients = [f64; 8];

/// Numerator and denominator, as coefficients of rising powers of `u`.
#[inline]
fn polynomials([k1, k2, _, _, k3, k4, k5, k6]: Coefficients) -> ([f64; 4], [f64; 4]) {
    ([1.0, k1, k2, k3], [1.0, k4, k5, k6])
}

/// A cubic polynomial and its derivative.
#[inline]
fn cubic(c: &[f64; 4], u: f64) -> (f64, f64) {
    (c[0] + u * (c[1] + u * (c[2] + u * c[3])), c[1] + u * (2.0 * c[2] + u * 3.0 * c[3]))
}

/// True if the distorted radius grows from the axis to the square `r2` of an ideal one.
#[inline]
pub(super) fn is_regular(r2: f64, k: Coefficients) -> bool {
    if r2.is_nan() || r2 >= MAX_RADIUS_SQUARED {
        return false;
    }
    let (n, d) = polynomials(k);
    let mut slope = [0.0; 7];
    for (i, n) in n.iter().enumerate() {
        for (j, d) in d.iter().enumerate() {
            slope[i + j] += n * d * (1.0 + 2.0 * (i as f64 - j as f64));
        }
    }
    is_positive(&d, r2) && is_positive(&slope, r2)
}

/// Distorted coordinates, and their derivative by the ideal ones.
#[inline]
pub(super) fn distort(xy: &Vector2<f64>, k: Coefficients) -> (Vector2<f64>, Matrix2<f64>) {
    let r2 = xy.x * xy.x + xy.y * xy.y;
    let (numerator, denominator) = polynomials(k);
    let ((n, d_n), (d, d_d)) = (cubic(&numerator, r2), cubic(&denominator, r2));
    let radial = n / d;
    bent(xy, r2, (radial, 2.0 * (d_n - radial * d_d) / d), [k[2], k[3]])
}

/// Derivatives of the distorted coordinates by the coefficients, in their order.
pub(super) fn by_coefficients(xy: &Vector2<f64>, k: Coefficients) -> [Vector2<f64>; 8] {
    let (x, y, u) = (xy.x, xy.y, xy.norm_squared());
    let (numerator, denominator) = polynomials(k);
    let ((n, _), (d, _)) = (cubic(&numerator, u), cubic(&denominator, u));
    let (above, below) = (xy / d, xy * (-n / (d * d)));
    let (u2, u3) = (u * u, u * u * u);
    [
        above * u,
        above * u2,
        Vector2::new(2.0 * x * y, u + 2.0 * y * y),
        Vector2::new(u + 2.0 * x * x, 2.0 * x * y),
        above * u3,
        below * u,
        below * u2,
        below * u3,
    ]
}

/// Ideal coordinates of distorted ones.
#[inline]
pub(super) fn undistort(target: &Vector2<f64>, k: Coefficients) -> Option<Vector2<f64>> {
    // Radii below one that is regular are regular too.
    let mut known_r2 = -1.0;
    let is_inside = |xy: &Vector2<f64>| {
        let r2 = xy.norm_squared();
        let is_inside = r2 <= known_r2 || is_regular(r2, k);
        if is_inside && r2 > known_r2 {
            known_r2 = r2;
        }
        is_inside
    };
    invert(target, FINE_TOLERANCE, is_inside, |xy| distort(xy, k))
}
