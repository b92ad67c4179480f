//! Inverse of a distortion in two dimensions by Newton's method.

use nalgebra::{Matrix2, Vector2};

/// Newton steps of the inverse distortion; five reach machine precision within a EuRoC image.
pub(super) const UNDISTORT_STEPS: usize = 20;
/// Distorted-coordinate residual at which the inverse distortion counts as found (about 1e-8 px).
pub(super) const UNDISTORT_TOLERANCE: f64 = 1e-11;
/// Residual that is aimed at where no recorded bit depends on it (about 1e-10 px); rounding may leave more.
pub(super) const FINE_TOLERANCE: f64 = 1e-14;
/// Halvings of a Newton step that would leave the regular part of the lens or increase the error.
const UNDISTORT_HALVINGS: usize = 8;

/// The coordinates that `distort` takes to `target`, by Newton's method; a step is halved while it leaves the regular part
/// (`is_inside`) or increases the error, so that the solution is on the branch of the centre or there is none.
#[inline]
pub(super) fn invert(
    target: &Vector2<f64>,
    tolerance: f64,
    mut is_inside: impl FnMut(&Vector2<f64>) -> bool,
    distort: impl Fn(&Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>),
) -> Option<Vector2<f64>> {
    if !target.iter().all(|x| x.is_finite()) {
        return None;
    }
    let error_of = |xy: &Vector2<f64>| {
        let (distorted, jacobian) = distort(xy);
        let error = distorted - target;
        (error, error.norm(), jacobian)
    };
    let mut xy = if is_inside(target) { *target } else { Vector2::zeros() };
    let (mut error, mut size, mut jacobian) = error_of(&xy);
    for _ in 0..UNDISTORT_STEPS {
        if size < tolerance {
            return (jacobian.determinant() > 0.0).then_some(xy);
        }
        let mut step = jacobian.try_inverse()? * error;
        let mut halvings = 0;
        (xy, error, size, jacobian) = loop {
            let candidate = xy - step;
            let (remaining, smaller, jacobian) = error_of(&candidate);
            if is_inside(&candidate) && smaller < size {
                break (candidate, remaining, smaller, jacobian);
            }
            if halvings == UNDISTORT_HALVINGS {
                // Rounding alone is left, or the solution lies beyond.
                return (size < UNDISTORT_TOLERANCE && jacobian.determinant() > 0.0).then_some(xy);
            }
            halvings += 1;
            step *= 0.5;
        };
    }
    (size < UNDISTORT_TOLERANCE && jacobian.determinant() > 0.0).then_some(xy)
}
