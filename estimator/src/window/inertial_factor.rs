//! The inertial factor between consecutive frames.
//!
//! Residual, in the order of the error state (Forster et al. 2017, equation 45, and bias random walk):
//!
//! ```text
//! r_p  = R_i' (p_j - p_i - v_i dt - g dt²/2) - dp
//! r_R  = Log(dR' R_i' R_j)
//! r_v  = R_i' (v_j - v_i - g dt) - dv
//! r_bg = bg_j - bg_i      r_ba = ba_j - ba_i
//! ```
//!
//! in m, rad, m/s, rad/s and m/s²; `dp`, `dR`, `dv` are the preintegrated motion at the biases of frame `i`. The
//! residual is weighed by its information matrix, which depends on the measurements alone and is computed once. What biases
//! that walk do to a long motion is in it too (`super::bias_walk`).

use super::bias_walk::{BiasWalk, FLOOR};
use super::factor::Linearization;
use super::state::{FrameMatrix, FrameVector, NavState};
use crate::geometry::{exp_so3, log_so3, right_jacobian, right_jacobian_inverse, skew};
use crate::inertial::{ImuNoise, Preintegration};
use nalgebra::{Matrix3, SMatrix, Vector3};
use plumbline_config::Portable;

/// Largest rate and force of a vehicle, whatever its sensor says.
const MOST_RATE_RAD_S: f64 = 10.0;
const MOST_FORCE_M_S2: f64 = 50.0;
/// Biases are taken for steady within a motion that is not longer than this, s. Frames that see something become keyframes
/// sooner; what is longer is a blind flight, over which their walk outweighs the white noise.
const STEADY_BIASES_S: f64 = 2.5;

/// The preintegrated motion between two frames, with the weight of its residual.
#[derive(Clone, Debug)]
pub struct InertialFactor {
    /// The motion from the earlier frame to the later.
    pub motion: Preintegration,
    walk: BiasWalk,
    information: Option<FrameMatrix>,
    /// Standard deviation of the forces beyond their noise, m/s²; in the covariance of the motion already.
    doubted_m_s2: f64,
}

impl InertialFactor {
    /// The factor of a motion measured with the sensor noise given.
    pub fn new(motion: Preintegration, noise: &ImuNoise) -> Self {
        Self::with_walk(motion, BiasWalk::default(), noise)
    }

    fn with_walk(motion: Preintegration, walk: BiasWalk, noise: &ImuNoise) -> Self {
        let is_long = motion.dt_s > STEADY_BIASES_S;
        let of_walk = is_long.then(|| walk.information(&motion, noise)).flatten();
        let information = of_walk.or_else(|| information(&motion, noise));
        Self { motion, walk, information, doubted_m_s2: 0.0 }
    }

    /// The factor over this interval and `next`.
    pub fn followed_by(&self, next: &Self, noise: &ImuNoise) -> Self {
        let walk = self.walk.followed_by(&self.motion, (&next.walk, &next.motion), noise);
        let doubted_m_s2 = self.doubted_m_s2.at_least(next.doubted_m_s2);
        Self { doubted_m_s2, ..Self::with_walk(self.motion.followed_by(&next.motion), walk, noise) }
    }

    /// The factor of the same motion, of which next to nothing is known but how long it took: a vehicle may have turned and
    /// sped up in it as far as one can.
    pub fn loosened(&self, noise: &ImuNoise) -> Self {
        let dt = self.motion.dt_s;
        let mut motion = self.motion.clone();
        let sigmas = [
            (NavState::P, 0.5 * MOST_FORCE_M_S2 * dt * dt),
            (NavState::ROT, MOST_RATE_RAD_S * dt),
            (NavState::V, MOST_FORCE_M_S2 * dt),
        ];
        for (part, sigma) in sigmas {
            for k in part..part + 3 {
                motion.covariance[(k, k)] += sigma * sigma;
            }
        }
        Self::new(motion, noise)
    }

    /// The factor of the same motion, whose forces may be off by `sigma_m_s2` throughout. A smaller doubt is part of one that counts already.
    pub fn with_doubted_forces(mut self, sigma_m_s2: f64, noise: &ImuNoise) -> Self {
        if sigma_m_s2 <= self.doubted_m_s2 {
            return self;
        }
        let more_m_s2 = (sigma_m_s2.squared() - self.doubted_m_s2.squared()).sqrt();
        let dt = self.motion.dt_s;
        let (way, gain) = (0.5 * more_m_s2 * dt * dt, more_m_s2 * dt);
        for k in 0..3 {
            let (p, v) = (NavState::P + k, NavState::V + k);
            let covariance = &mut self.motion.covariance;
            covariance[(p, p)] += way * way;
            covariance[(v, v)] += gain * gain;
            covariance[(p, v)] += way * gain;
            covariance[(v, p)] += way * gain;
        }
        Self { doubted_m_s2: sigma_m_s2, ..Self::with_walk(self.motion, self.walk, noise) }
    }

    /// The factor of another integration of the same interval: its forces are as doubtful.
    pub fn integrated_anew(&self, motion: Preintegration, noise: &ImuNoise) -> Self {
        Self::new(motion, noise).with_doubted_forces(self.doubted_m_s2, noise)
    }

    /// Information matrix of the residual; `None` when the covariance of the motion cannot be inverted.
    pub fn information(&self) -> Option<&FrameMatrix> {
        self.information.as_ref()
    }

    /// The residual between the earlier and the later state, not weighed, and on request its Jacobians by either,
    /// 15x15.
    pub fn residual(
        &self,
        [from, to]: [&NavState; 2],
        gravity_o: &Vector3<f64>,
        linearization: Option<Linearization<'_, [&NavState; 2], [FrameMatrix; 2]>>,
    ) -> FrameVector {
        let motion = &self.motion;
        if let Some(Linearization { at, jacobians }) = linearization {
            linearize(motion, at, gravity_o, jacobians);
        }
        let dt = motion.dt_s;
        let delta = motion.corrected(&from.bias_gyro, &from.bias_accel);
        let inv = from.rot_o_b.inverse();
        let travelled = to.p_o_b - from.p_o_b - from.v_o_b * dt - gravity_o * (0.5 * dt * dt);
        let gained = to.v_o_b - from.v_o_b - gravity_o * dt;
        let mut r = FrameVector::zeros();
        let mut set = |row: usize, part: Vector3<f64>| r.fixed_rows_mut::<3>(row).copy_from(&part);
        set(NavState::P, inv * travelled - delta.p);
        set(NavState::ROT, log_so3(&(delta.rot.inverse() * inv * to.rot_o_b)));
        set(NavState::V, inv * gained - delta.v);
        set(NavState::BIAS_GYRO, to.bias_gyro - from.bias_gyro);
        set(NavState::BIAS_ACCEL, to.bias_accel - from.bias_accel);
        r
    }
}

/// Jacobians of the residual by the earlier and the later state.
fn linearize(
    motion: &Preintegration,
    [from, to]: [&NavState; 2],
    gravity_o: &Vector3<f64>,
    [by_from, by_to]: &mut [FrameMatrix; 2],
) {
    const P: usize = NavState::P;
    const ROT: usize = NavState::ROT;
    const V: usize = NavState::V;
    const BIAS_GYRO: usize = NavState::BIAS_GYRO;
    const BIAS_ACCEL: usize = NavState::BIAS_ACCEL;
    let dt = motion.dt_s;
    let delta = motion.corrected(&from.bias_gyro, &from.bias_accel);
    let inv = from.rot_o_b.inverse();
    let inv_m = inv.to_rotation_matrix().into_inner();
    let rot_i_j = inv * to.rot_o_b;
    let r_rot = log_so3(&(delta.rot.inverse() * rot_i_j));
    let jr_inv = right_jacobian_inverse(&r_rot);
    let identity = Matrix3::identity();

    by_from.fill(0.0);
    let mut set = |row: usize, column: usize, block: Matrix3<f64>| {
        by_from.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
    };
    let travelled = to.p_o_b - from.p_o_b - from.v_o_b * dt - gravity_o * (0.5 * dt * dt);
    set(P, P, -inv_m);
    set(P, ROT, skew(&(inv * travelled)));
    set(P, V, inv_m * -dt);
    set(ROT, ROT, -(jr_inv * rot_i_j.inverse().to_rotation_matrix().into_inner()));
    let gained = to.v_o_b - from.v_o_b - gravity_o * dt;
    set(V, ROT, skew(&(inv * gained)));
    set(V, V, -inv_m);
    // Log(Exp(-Jr d) Exp(r)): the gyroscope bias turns dR on its right, before R_i' R_j.
    let rot_by_gyro = motion.by_bias.fixed_view::<3, 3>(ROT, 0);
    let phi = rot_by_gyro * (from.bias_gyro - motion.bias_gyro);
    let turn = exp_so3(&r_rot).inverse().to_rotation_matrix().into_inner();
    set(ROT, BIAS_GYRO, -(jr_inv * turn * right_jacobian(&phi) * rot_by_gyro));
    set(BIAS_GYRO, BIAS_GYRO, -identity);
    set(BIAS_ACCEL, BIAS_ACCEL, -identity);
    by_from.fixed_view_mut::<3, 6>(P, BIAS_GYRO).copy_from(&-motion.by_bias.fixed_rows::<3>(P));
    by_from.fixed_view_mut::<3, 6>(V, BIAS_GYRO).copy_from(&-motion.by_bias.fixed_rows::<3>(V));

    by_to.fill(0.0);
    let mut set = |at: usize, block: &Matrix3<f64>| {
        by_to.fixed_view_mut::<3, 3>(at, at).copy_from(block);
    };
    set(P, &inv_m);
    set(ROT, &jr_inv);
    set(V, &inv_m);
    set(BIAS_GYRO, &identity);
    set(BIAS_ACCEL, &identity);
}

/// Information matrix of the residual; `None` when the covariance of the motion cannot be inverted.
fn information(motion: &Preintegration, noise: &ImuNoise) -> Option<FrameMatrix> {
    let covariance = motion.covariance + SMatrix::<f64, 9, 9>::identity() * FLOOR;
    let inverse = covariance.cholesky()?.inverse();
    let mut information = FrameMatrix::zeros();
    information.fixed_view_mut::<9, 9>(0, 0).copy_from(&inverse);
    let walk = |density: f64| 1.0 / (density * density * motion.dt_s).at_least(1e-16);
    for k in 0..3 {
        let (gyro, accel) = (NavState::BIAS_GYRO + k, NavState::BIAS_ACCEL + k);
        information[(gyro, gyro)] = walk(noise.gyro_walk);
        information[(accel, accel)] = walk(noise.accel_walk);
    }
    Some(information)
}

#[cfg(test)]
mod tests {
    use super::super::state::FRAME_DIM;
    use super::*;
    use proptest::prelude::*;

    fn vector(scale: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(move |v| Vector3::from(v) * scale)
    }

    prop_compose! {
        fn state()(p in vector(5.0), phi in vector(1.5), v in vector(3.0), bg in vector(0.1), ba in vector(0.3)) -> NavState {
            NavState { p_o_b: p, rot_o_b: exp_so3(&phi), v_o_b: v, bias_gyro: bg, bias_accel: ba }
        }
    }

    const NOISE: ImuNoise = ImuNoise {
        gyro_density: 1e-3,
        accel_density: 1e-2,
        gyro_walk: 1e-5,
        accel_walk: 1e-4,
        ..ImuNoise::NONE
    };
    const GRAVITY_O: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

    fn factor() -> InertialFactor {
        let mut pre = Preintegration::new(&Vector3::new(0.01, 0.0, -0.02), &Vector3::new(0.1, 0.0, 0.0));
        for k in 0..40 {
            let t = k as f64 * 0.005;
            let gyro = Vector3::new((9.0 * t).sin(), 0.5, -0.8);
            let accel = Vector3::new(1.0, t, 9.0);
            pre.integrate(0.005, &gyro, &accel, &accel, &NOISE);
        }
        InertialFactor::new(pre, &NOISE)
    }

    fn residual(from: &NavState, to: &NavState) -> FrameVector {
        factor().residual([from, to], &GRAVITY_O, None)
    }

    proptest! {
        #[test]
        fn jacobians_agree_with_numeric_differentiation(from in state(), step in vector(0.4)) {
            let mut to = from.after(&factor().motion, &GRAVITY_O);
            to.rot_o_b *= exp_so3(&step);
            to.p_o_b += step;
            let mut jacobians = [FrameMatrix::zeros(); 2];
            let request = Linearization { at: [&from, &to], jacobians: &mut jacobians };
            let r = factor().residual([&from, &to], &GRAVITY_O, Some(request));
            prop_assert_eq!(r, residual(&from, &to), "the same with and without Jacobians");
            let [by_from, by_to] = jacobians;
            let h = 1e-6;
            for k in 0..FRAME_DIM {
                let mut d = FrameVector::zeros();
                d[k] = h;
                let f = (residual(&from.plus(&d), &to) - residual(&from.plus(&-d), &to)) / (2.0 * h);
                let t = (residual(&from, &to.plus(&d)) - residual(&from, &to.plus(&-d))) / (2.0 * h);
                prop_assert!((f - by_from.column(k)).norm() < 1e-5, "from {k}: {}", (f - by_from.column(k)).norm());
                prop_assert!((t - by_to.column(k)).norm() < 1e-5, "to {k}");
            }
        }
    }

    #[test]
    fn the_predicted_state_has_no_residual() {
        let from = NavState { bias_gyro: Vector3::new(0.02, 0.01, 0.0), ..NavState::default() };
        assert!(residual(&from, &from.after(&factor().motion, &GRAVITY_O)).norm() < 1e-12);
    }

    #[test]
    fn the_information_is_the_inverse_of_the_covariance_and_of_the_walks() {
        let factor = factor();
        let information = factor.information().expect("is regular");
        let motion = information.fixed_view::<9, 9>(0, 0) * factor.motion.covariance;
        assert!((motion - SMatrix::<f64, 9, 9>::identity()).norm() < 1e-6);
        let walk = NOISE.gyro_walk.powi(2) * factor.motion.dt_s;
        assert!((information[(NavState::BIAS_GYRO, NavState::BIAS_GYRO)] * walk - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_loosened_motion_says_what_it_said_and_hardly_counts() {
        let (factor, loose) = (factor(), factor().loosened(&NOISE));
        assert_eq!(
            (factor.motion.delta_p, factor.motion.delta_rot),
            (loose.motion.delta_p, loose.motion.delta_rot)
        );
        let information = |f: &InertialFactor, k: usize| f.information().expect("is regular")[(k, k)];
        for k in 0..9 {
            assert!(information(&loose, k) < 1.0 / 0.2_f64.powi(2), "{k}: {}", information(&loose, k));
        }
        let bias = NavState::BIAS_GYRO;
        assert_eq!(information(&loose, bias).to_bits(), information(&factor, bias).to_bits());
    }

    #[test]
    fn a_motion_of_no_covariance_that_makes_sense_has_no_information() {
        let mut motion = factor().motion;
        motion.covariance[(4, 4)] = f64::NAN;
        assert!(InertialFactor::new(motion, &NOISE).information().is_none());
    }
}
