//! The inertial factor between consecutive frames, and the zero-velocity factor.
//!
//! Residual, in the order of the error state (Forster et al. 2017, equation 45, and bias random walk):
//!
//! ```text
//! r_p  = R_i' (p_j - p_i - v_i dt - g dt²/2) - dp
//! r_R  = Log(dR' R_i' R_j)
//! r_v  = R_i' (v_j - v_i - g dt) - dv
//! r_bg = bg_j - bg_i      r_ba = ba_j - ba_i
//! ```

use super::state::{FRAME_DIM, NavState};
use crate::geometry::{log_so3, right_jacobian, right_jacobian_inverse, skew};
use crate::inertial::{ImuNoise, Preintegration};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// A 15x15 block.
pub type FrameMatrix = SMatrix<f64, FRAME_DIM, FRAME_DIM>;
/// A 15-vector.
pub type FrameVector = SVector<f64, FRAME_DIM>;

/// The residual of `motion` between the states `from` and `to`.
#[must_use]
pub fn residual(
    motion: &Preintegration,
    from: &NavState,
    to: &NavState,
    gravity_o: &Vector3<f64>,
) -> FrameVector {
    let dt = motion.dt_s;
    let delta = motion.corrected(&from.bias_gyro, &from.bias_accel);
    let inv = from.rot_o_b.inverse();
    let mut r = FrameVector::zeros();
    let travelled = to.p_o_b - from.p_o_b - from.v_o_b * dt - gravity_o * (0.5 * dt * dt);
    r.fixed_rows_mut::<3>(0).copy_from(&(inv * travelled - delta.p));
    r.fixed_rows_mut::<3>(3).copy_from(&log_so3(&(delta.rot.inverse() * inv * to.rot_o_b)));
    r.fixed_rows_mut::<3>(6).copy_from(&(inv * (to.v_o_b - from.v_o_b - gravity_o * dt) - delta.v));
    r.fixed_rows_mut::<3>(9).copy_from(&(to.bias_gyro - from.bias_gyro));
    r.fixed_rows_mut::<3>(12).copy_from(&(to.bias_accel - from.bias_accel));
    r
}

/// Derivatives of [`residual`] by `from` and by `to`.
#[must_use]
pub fn jacobians(
    motion: &Preintegration,
    from: &NavState,
    to: &NavState,
    gravity_o: &Vector3<f64>,
) -> (FrameMatrix, FrameMatrix) {
    let dt = motion.dt_s;
    let delta = motion.corrected(&from.bias_gyro, &from.bias_accel);
    let inv = from.rot_o_b.inverse();
    let inv_m = inv.to_rotation_matrix().into_inner();
    let rot_i_j = inv * to.rot_o_b;
    let r_rot = log_so3(&(delta.rot.inverse() * rot_i_j));
    let jr_inv = right_jacobian_inverse(&r_rot);
    let identity = Matrix3::identity();

    let mut by_from = FrameMatrix::zeros();
    let travelled = to.p_o_b - from.p_o_b - from.v_o_b * dt - gravity_o * (0.5 * dt * dt);
    by_from.fixed_view_mut::<3, 3>(0, 0).copy_from(&-inv_m);
    by_from.fixed_view_mut::<3, 3>(0, 3).copy_from(&skew(&(inv * travelled)));
    by_from.fixed_view_mut::<3, 3>(0, 6).copy_from(&(inv_m * -dt));
    by_from
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&-(jr_inv * rot_i_j.inverse().to_rotation_matrix().into_inner()));
    let gained = to.v_o_b - from.v_o_b - gravity_o * dt;
    by_from.fixed_view_mut::<3, 3>(6, 3).copy_from(&skew(&(inv * gained)));
    by_from.fixed_view_mut::<3, 3>(6, 6).copy_from(&-inv_m);
    by_from.fixed_view_mut::<3, 6>(0, 9).copy_from(&-motion.by_bias.fixed_rows::<3>(0));
    by_from.fixed_view_mut::<3, 6>(6, 9).copy_from(&-motion.by_bias.fixed_rows::<3>(6));
    // Log(Exp(-Jr d) Exp(r)): the gyroscope bias turns dR on its right, before R_i' R_j.
    let phi = motion.by_bias.fixed_view::<3, 3>(3, 0) * (from.bias_gyro - motion.bias_gyro);
    let turn = crate::geometry::exp_so3(&r_rot).inverse().to_rotation_matrix().into_inner();
    let by_gyro = jr_inv * turn * right_jacobian(&phi) * motion.by_bias.fixed_view::<3, 3>(3, 0);
    by_from.fixed_view_mut::<3, 3>(3, 9).copy_from(&-by_gyro);
    by_from.fixed_view_mut::<3, 3>(9, 9).copy_from(&-identity);
    by_from.fixed_view_mut::<3, 3>(12, 12).copy_from(&-identity);

    let mut by_to = FrameMatrix::zeros();
    by_to.fixed_view_mut::<3, 3>(0, 0).copy_from(&inv_m);
    by_to.fixed_view_mut::<3, 3>(3, 3).copy_from(&jr_inv);
    by_to.fixed_view_mut::<3, 3>(6, 6).copy_from(&inv_m);
    by_to.fixed_view_mut::<3, 3>(9, 9).copy_from(&identity);
    by_to.fixed_view_mut::<3, 3>(12, 12).copy_from(&identity);
    (by_from, by_to)
}

/// Information matrix of the residual; `None` when the covariance of the motion cannot be inverted.
#[must_use]
pub fn information(motion: &Preintegration, noise: &ImuNoise) -> Option<FrameMatrix> {
    // Integration is exact to about a micrometre per step: keeps the covariance of one step regular.
    const FLOOR: f64 = 1e-14;
    let covariance = motion.covariance + SMatrix::<f64, 9, 9>::identity() * FLOOR;
    let inverse = covariance.cholesky()?.inverse();
    let mut information = FrameMatrix::zeros();
    information.fixed_view_mut::<9, 9>(0, 0).copy_from(&inverse);
    let walk = |density: f64| 1.0 / (density * density * motion.dt_s).max(1e-16);
    for k in 0..3 {
        information[(9 + k, 9 + k)] = walk(noise.gyro_walk);
        information[(12 + k, 12 + k)] = walk(noise.accel_walk);
    }
    Some(information)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;
    use proptest::prelude::*;

    fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(move |v| Vector3::from(v) * scale)
    }

    prop_compose! {
        fn state()(p in vector(5.0), phi in vector(1.5), v in vector(3.0), bg in vector(0.1), ba in vector(0.3)) -> NavState {
            NavState { p_o_b: p, rot_o_b: exp_so3(&phi), v_o_b: v, bias_gyro: bg, bias_accel: ba }
        }
    }

    fn motion() -> Preintegration {
        let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, gyro_walk: 1e-5, accel_walk: 1e-4 };
        let mut pre = Preintegration::new(&Vector3::new(0.01, 0.0, -0.02), &Vector3::new(0.1, 0.0, 0.0));
        for k in 0..40 {
            let t = k as f64 * 0.005;
            let gyro = Vector3::new((9.0 * t).sin(), 0.5, -0.8);
            let accel = Vector3::new(1.0, t, 9.0);
            pre.integrate(0.005, &gyro, &accel, &accel, &noise);
        }
        pre
    }

    proptest! {
        #[test]
        fn jacobians_agree_with_numeric_differentiation(from in state(), step in vector(0.4)) {
            let g = Vector3::new(0.0, 0.0, -9.81);
            let motion = motion();
            let mut to = from.after(&motion, &g);
            to.rot_o_b *= exp_so3(&step);
            to.p_o_b += step;
            let (by_from, by_to) = jacobians(&motion, &from, &to, &g);
            let h = 1e-6;
            for k in 0..FRAME_DIM {
                let mut d = FrameVector::zeros();
                d[k] = h;
                let f = (residual(&motion, &from.plus(&d), &to, &g) - residual(&motion, &from.plus(&-d), &to, &g)) / (2.0 * h);
                let t = (residual(&motion, &from, &to.plus(&d), &g) - residual(&motion, &from, &to.plus(&-d), &g)) / (2.0 * h);
                prop_assert!((f - by_from.column(k)).norm() < 1e-5, "from {k}: {}", (f - by_from.column(k)).norm());
                prop_assert!((t - by_to.column(k)).norm() < 1e-5, "to {k}");
            }
        }
    }

    #[test]
    fn the_predicted_state_has_no_residual() {
        let g = Vector3::new(0.0, 0.0, -9.81);
        let from = NavState { bias_gyro: Vector3::new(0.02, 0.01, 0.0), ..NavState::default() };
        let motion = motion();
        assert!(residual(&motion, &from, &from.after(&motion, &g), &g).norm() < 1e-12);
    }
}
