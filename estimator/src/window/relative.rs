//! Uncertainty of one of the window's frames relative to another: the information that a pose graph gets of the odometry.
//!
//! Way and turn from frame `a` to frame `b`, in the axes of `O`, and how they follow the error states of both:
//!
//! `w = p_b - p_a`, `dw = dp_b - dp_a - (e_z x w) dpsi_a`, `dpsi = dpsi_b - dpsi_a` with `dpsi_k = e_z^T R_k dtheta_k`.
//!
//! The term with `dpsi_a` turns the way along with frame `a`, as an edge of [`crate::places::graph`] does. With `A` for
//! these rows and `H` for the normal equations of the last solution the covariance is `A H^-1 A^T`.

use super::Window;
use super::state::{NavState, unknown_of_frame};
use nalgebra::{Matrix4, Vector3, Vector4};

/// A row of `A` by a frame: by its position and by its attitude.
type Row = [Vector3<f64>; 2];

impl Window {
    /// Covariance of position (0..3, m²) and yaw (3, rad²) of a frame in `O`, by the last factorization. `None` as of
    /// [`Self::relative_covariance`].
    pub fn covariance_in_o(&mut self, frame: usize) -> Option<Matrix4<f64>> {
        let rows = pose_rows(&self.frames.get(frame)?.nav);
        let covariance = self.covariance_of(rows.map(|row| [(frame, row)]))?;
        covariance.iter().all(|x| x.is_finite()).then_some(covariance)
    }

    /// Covariance of way (0..3, m²) and turn about the vertical (3, rad²) from frame `from` to frame `to`, by the last
    /// factorization. `None` before the first, for frames that are not there, and where it is none.
    pub fn relative_covariance(&mut self, from: usize, to: usize) -> Option<Matrix4<f64>> {
        let rows = step_rows(&self.frames.get(from)?.nav, &self.frames.get(to)?.nav);
        let rows = rows.map(|[by_from, by_to]| [(from, by_from), (to, by_to)]);
        let covariance = self.covariance_of(rows).filter(|_| from != to)?;
        (0..4).all(|k| covariance[(k, k)] > 0.0 && covariance[(k, k)].is_finite()).then_some(covariance)
    }

    /// Uncertainty of the scale, as a share of it: of the longest way to the newest frame, along that; and that way, m. One camera has the scale
    /// from changes of the velocity alone: at constant velocity any fits, with a bias to match, and the covariance shows that. `None` at rest and as of
    /// [`Self::relative_covariance`].
    pub fn scale_sigma(&mut self) -> Option<(f64, f64)> {
        let newest = self.frames.last().filter(|frame| !frame.is_still)?.nav.p_o_b;
        let ways_o = self.frames.iter().map(|frame| newest - frame.nav.p_o_b).enumerate();
        let (from, way_o) = ways_o.max_by(|(_, a), (_, b)| a.norm().total_cmp(&b.norm()))?;
        let covariance = self.relative_covariance(from, self.frames.len() - 1)?;
        let along = way_o.dot(&(covariance.fixed_view::<3, 3>(0, 0) * way_o)).abs().sqrt();
        Some((along / way_o.norm_squared(), way_o.norm()))
    }

    /// `A H^-1 A^T`, with the rows of `A` by the frames given.
    fn covariance_of<const N: usize>(&mut self, rows: [[(usize, Row); N]; 4]) -> Option<Matrix4<f64>> {
        let dim = unknown_of_frame(self.frames.len());
        if self.factor.dim != dim {
            return None;
        }
        let places = |row: &[(usize, Row); N]| {
            row.map(|(frame, [by_p, by_theta])| {
                let at = unknown_of_frame(frame);
                [(at + NavState::P, by_p), (at + NavState::ROT, by_theta)]
            })
        };
        let mut covariance = Matrix4::zeros();
        for (column, row) in rows.iter().enumerate() {
            let solution = &mut self.solution[..dim];
            solution.fill(0.0);
            for (at, by) in places(row).into_iter().flatten() {
                solution[at..at + 3].copy_from_slice(by.as_slice());
            }
            self.factor.solve(solution);
            let of_row = |other: &[(usize, Row); N]| -> f64 {
                let terms = places(other).into_iter().flatten();
                terms.map(|(at, by)| by.iter().zip(&solution[at..]).map(|(b, x)| b * x).sum::<f64>()).sum()
            };
            covariance.set_column(column, &Vector4::from_fn(|i, _| of_row(&rows[i])));
        }
        Some((covariance + covariance.transpose()) * 0.5)
    }
}

/// Position and yaw by a frame.
fn pose_rows(nav: &NavState) -> [Row; 4] {
    let by_p = |axis: usize| [Vector3::ith(axis, 1.0), Vector3::zeros()];
    [by_p(0), by_p(1), by_p(2), [Vector3::zeros(), nav.rot_o_b.inverse() * Vector3::z()]]
}

/// Way and turn by both frames.
fn step_rows(from: &NavState, to: &NavState) -> [[Row; 2]; 4] {
    let (of_from, of_to) = (pose_rows(from), pose_rows(to));
    let lever = Vector3::z().cross(&(to.p_o_b - from.p_o_b));
    let [_, yaw_by_theta] = of_from[3];
    std::array::from_fn(|k| match k {
        3 => [of_from[3].map(|by| -by), of_to[3]],
        axis => [[-of_from[axis][0], -yaw_by_theta * lever[axis]], of_to[axis]],
    })
}

#[cfg(test)]
mod tests {
    use super::super::test_room::Room;
    use super::*;
    use crate::geometry::{exp_so3, log_so3};
    use nalgebra::UnitQuaternion;

    #[test]
    fn the_rows_are_the_derivatives_of_way_and_turn() {
        let nav = |k: f64| NavState {
            p_o_b: Vector3::new(0.3 * k, 1.0 - k, 0.2 * k),
            rot_o_b: exp_so3(&Vector3::new(0.2 * k, -0.1, 0.7 + 0.4 * k)),
            ..NavState::default()
        };
        let states = [nav(0.4), nav(1.3)];
        // How far a frame has been turned about the vertical since.
        let turned = |k: usize, now: &NavState| log_so3(&(now.rot_o_b * states[k].rot_o_b.inverse())).z;
        let measured = |now: &[NavState; 2]| {
            let back = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -turned(0, &now[0]));
            (back * (now[1].p_o_b - now[0].p_o_b)).push(turned(1, &now[1]) - turned(0, &now[0]))
        };
        let analytic = step_rows(&states[0], &states[1]);
        for (which, kind, axis) in (0..12).map(|n| (n / 6, n / 3 % 2, n % 3)) {
            let moved = |step: f64| {
                let mut now = states.clone();
                let step = Vector3::from_fn(|k, _| if k == axis { step } else { 0.0 });
                match kind {
                    0 => now[which].p_o_b += step,
                    _ => now[which].rot_o_b *= exp_so3(&step),
                }
                measured(&now)
            };
            let numeric = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            for k in 0..4 {
                let analytic = analytic[k][which][kind][axis];
                assert!((numeric[k] - analytic).abs() < 1e-7, "row {k}, state {which} {kind} {axis}");
            }
        }
    }

    #[test]
    fn the_covariance_of_the_newest_frame_is_the_published_one() {
        let mut window = Room::default().window();
        let _ = window.optimize(5);
        let last = window.frames.len() - 1;
        let covariance = window.covariance_in_o(last).unwrap();
        let (whole, _) = window.newest_covariance().unwrap();
        let up_b = window.frames[last].nav.rot_o_b.inverse() * Vector3::z();
        let yaw = (up_b.transpose() * whole.fixed_view::<3, 3>(3, 3) * up_b)[0];
        assert!((covariance[(3, 3)] / yaw - 1.0).abs() < 1e-6);
        for k in 0..3 {
            assert!((covariance[(k, k)] / whole[(k, k)] - 1.0).abs() < 1e-6, "{k}");
        }
        assert!(window.covariance_in_o(last + 1).is_none());
    }

    #[test]
    fn a_step_is_known_better_than_where_it_ends() {
        let mut window = Room::default().window();
        let _ = window.optimize(5);
        let last = window.frames.len() - 1;
        let step = window.relative_covariance(last - 1, last).unwrap();
        assert!(step.cholesky().is_some());
        let whole = window.relative_covariance(0, last).unwrap();
        for k in 0..4 {
            assert!(step[(k, k)] < whole[(k, k)], "{k}: {} {}", step[(k, k)], whole[(k, k)]);
        }
        assert!(window.relative_covariance(last, last).is_none());
        assert!(window.relative_covariance(0, last + 1).is_none());
    }
}
