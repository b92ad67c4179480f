//! Does the estimator know how wrong it is? Normalized estimation error squared (NEES), `e' P^-1 e`: chi-squared with as many
//! degrees of freedom as `e` has components, if `P` is the covariance of `e` (Bar-Shalom, Li and Kirubarajan 2001, section
//! 5.4.2). Figures are means over a flight, divided by their expectation: 1 is honest, above is overconfident, below is
//! timid.
//!
//! [`errors`] defines the five errors that are judged apart: position, tilt, yaw, velocity, steps. [`flown`] goes over a
//! flight.

pub mod errors;
pub mod flown;

pub use flown::{FlightConsistency, Nees};

use nalgebra::{Isometry3, SMatrix, SVector, Vector6};
use serde::Serialize;

/// Error of a pose: position (m) in the outer frame, then attitude (rad) as right perturbation,
/// `true = (p + e_p, R Exp(e_r))`: the order of the estimator's covariances.
pub fn pose_error(estimate: &Isometry3<f64>, truth: &Isometry3<f64>) -> Vector6<f64> {
    let position = truth.translation.vector - estimate.translation.vector;
    let rotation = (estimate.rotation.inverse() * truth.rotation).scaled_axis();
    Vector6::new(position.x, position.y, position.z, rotation.x, rotation.y, rotation.z)
}

/// `eᵀ P⁻¹ e`; `None` where the covariance is not positive definite.
pub fn nees<const N: usize>(error: &SVector<f64, N>, covariance: &SMatrix<f64, N, N>) -> Option<f64> {
    let half = covariance.cholesky()?.l().solve_lower_triangular(error)?;
    Some(half.norm_squared()).filter(|value| value.is_finite())
}

/// Fit of a run's errors to its covariances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Consistency {
    /// Mean NEES over its expectation: 1 is honest, above is overconfident, below is timid.
    pub mean_ratio: f64,
    /// Number of errors.
    pub count: usize,
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod summary_tests {
    use super::*;
    use crate::evaluate::test_noise::Noise;
    use nalgebra::{Matrix6, Vector3};

    #[test]
    fn errors_drawn_from_the_covariance_are_consistent() {
        let mut noise = Noise::new(7);
        let l = Matrix6::from_fn(|i, j| {
            if i == j {
                1.0 + i as f64
            } else if i > j {
                0.3 * noise.normal()
            } else {
                0.0
            }
        });
        let covariance = l * l.transpose();
        let draw =
            |noise: &mut Noise| nees(&(l * Vector6::from_fn(|_, _| noise.normal())), &covariance).unwrap();
        let values: Vec<f64> = (0..2000).map(|_| draw(&mut noise)).collect();
        let mean_ratio = values.iter().sum::<f64>() / (6 * values.len()) as f64;
        // Within 1.96 standard deviations of chi-squared with 12,000 degrees of freedom.
        assert!((mean_ratio - 1.0).abs() < 0.0254, "{mean_ratio}");
        assert_eq!(nees(&Vector6::zeros(), &-covariance), None);
    }

    #[test]
    fn the_error_brings_the_estimate_to_the_truth() {
        let estimate = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.2, 0.9));
        let truth = Isometry3::new(Vector3::new(1.1, 2.0, 2.8), Vector3::new(0.31, -0.25, 0.8));
        let e = pose_error(&estimate, &truth);
        let rotation =
            estimate.rotation * nalgebra::UnitQuaternion::from_scaled_axis(e.fixed_rows::<3>(3).into_owned());
        assert!(rotation.angle_to(&truth.rotation) < 1e-12);
        assert!(
            (estimate.translation.vector + e.fixed_rows::<3>(0) - truth.translation.vector).norm() < 1e-12
        );
    }
}
