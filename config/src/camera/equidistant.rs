//! Fisheye by a polynomial of the angle: Kannala and Brandt's model with four coefficients.
//!
//! With the angle `theta = atan(r)` from the optical axis, `r² = x² + y²`:
//!
//! ```text
//! theta_d = theta (1 + k1 theta² + k2 theta⁴ + k3 theta⁶ + k4 theta⁸)
//! (x_d, y_d) = (x, y) theta_d / r
//! ```
//!
//! Source: Kannala and Brandt, "A generic camera model and calibration method", PAMI 28 (2006), in the form of OpenCV's
//! `fisheye`. Domain: up to the fold of the polynomial, and to 89.4 degrees where a pixel is given.

use super::newton::{UNDISTORT_STEPS, UNDISTORT_TOLERANCE};
use super::{MAX_RADIUS_SQUARED, MAX_THETA_RAD};
use crate::Portable;
use nalgebra::{Matrix2, Vector2};

/// Points between the axis and an angle at which the equidistant polynomial is watched for a fold.
const FOLD_SAMPLES: usize = 8;

/// True if ideal coordinates lie before the fold.
#[inline]
pub(super) fn is_regular(r2: f64, k: [f64; 4]) -> bool {
    r2 < MAX_RADIUS_SQUARED && is_growing(libm::atan(r2.sqrt()), k)
}

/// True if the equidistant radius grows with the angle from the axis to `theta`.
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

/// Distorted coordinates, and their derivative by the ideal ones.
#[inline]
pub(super) fn distort(xy: &Vector2<f64>, k: [f64; 4]) -> (Vector2<f64>, Matrix2<f64>) {
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

/// Derivatives of the distorted coordinates by `k1` to `k4`.
pub(super) fn by_coefficients(xy: &Vector2<f64>, _: [f64; 4]) -> [Vector2<f64>; 4] {
    let r = xy.norm();
    let theta = libm::atan(r);
    // Near the axis theta³ / r vanishes.
    let unit = if r < 1e-8 { Vector2::zeros() } else { xy / r };
    let (t2, t3) = (theta * theta, theta * theta * theta);
    [t3, t3 * t2, t3 * t2 * t2, t3 * t2 * t2 * t2].map(|power| unit * power)
}

/// The angle `theta` of a distorted one, by Newton's method in one dimension, and its direction.
#[inline]
pub(super) fn undistort(target: &Vector2<f64>, k: [f64; 4]) -> Option<Vector2<f64>> {
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
