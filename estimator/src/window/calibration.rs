//! Uncertainty of the rig: the covariance of its error state.

use super::Window;
use super::state::{GLOBAL_DIM, RIG_DIM, Rig};
use nalgebra::SMatrix;

/// Covariance of the rig's error state, in the order and units of [`Rig::P_B_C0`] and following.
pub type RigCovariance = SMatrix<f64, RIG_DIM, RIG_DIM>;

/// The rig's calibration as refined so far.
#[derive(Clone, Debug, PartialEq)]
pub struct RigEstimate {
    /// The calibration.
    pub rig: Rig,
    /// Covariance of its error state (right perturbation, m, rad and s); zero for what is held fixed.
    pub covariance: RigCovariance,
}

impl Window {
    /// The rig and its covariance by the last factorization. `None` before the first, and where it is no covariance.
    pub fn rig_estimate(&mut self) -> Option<RigEstimate> {
        let dim = self.factor.dim();
        if dim < GLOBAL_DIM {
            return None;
        }
        let mut covariance = RigCovariance::zeros();
        for column in (0..RIG_DIM).filter(|k| self.options.rig_mask[*k] != 0.0) {
            self.solution[..dim].fill(0.0);
            self.solution[column] = 1.0;
            self.factor.solve(&mut self.solution[..dim]);
            for row in (0..RIG_DIM).filter(|k| self.options.rig_mask[*k] != 0.0) {
                covariance[(row, column)] = self.solution[row];
            }
        }
        let covariance = (covariance + covariance.transpose()) * 0.5;
        let is_one = (0..RIG_DIM).all(|k| {
            let variance: f64 = covariance[(k, k)];
            variance.is_finite() && (variance > 0.0) == (self.options.rig_mask[k] != 0.0)
        });
        is_one.then(|| RigEstimate { rig: self.rig.clone(), covariance })
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_room::Room;
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn it_is_that_part_of_the_inverse_of_the_normal_equations() {
        let mut window = Room::default().window();
        window.options.rig_mask.fill(1.0);
        window.optimize(3);
        assert!(window.factor.compute(&window.linearizer.equations, 0.0));
        let found = window.rig_estimate().unwrap();
        let equations = &window.linearizer.equations;
        let dim = window.factor.dim();
        let dense = DMatrix::from_fn(dim, dim, |i, j| {
            let (i, j) = (i.min(j), i.max(j));
            equations.row(i)[j - i]
        });
        let inverse = dense.try_inverse().unwrap();
        for i in 0..RIG_DIM {
            for j in 0..RIG_DIM {
                let scale = (inverse[(i, i)] * inverse[(j, j)]).sqrt();
                let error = (found.covariance[(i, j)] - inverse[(i, j)]) / scale;
                assert!(error.abs() < 1e-4, "{i} {j}: {error}");
            }
        }
    }

    #[test]
    fn before_the_first_solution_there_is_none() {
        let mut window = Room::default().window();
        assert_eq!(window.rig_estimate(), None);
    }
}
