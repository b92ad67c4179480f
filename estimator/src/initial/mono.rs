//! Motion, gravity, scale and the accelerometer's bias from one camera in motion, all at once.
//!
//! With rotations known from the gyroscope, the camera at frame `k` is a linear function of the first velocity `v`, of gravity `g`, both
//! in the first body frame, and of the bias `a` of the accelerometer:
//!
//! ```text
//! c_k = v t_k + g t_k²/2 + dp_k + (d dp_k / d a) a + R_k p_bc
//! ```
//!
//! A point that frames `i` and `j` see in the directions `f` spans a plane with the way between them: `n . (c_j - c_i) = 0` for its normal
//! `n = R_i f_i x R_j f_j`, whatever its depth. Divided by the length of the way this is an error in the image. That length depends on the
//! unknowns as well (Gauss-Newton): where it does not, noise of the normals makes all ways shorter. Nine equations are left for `v`, `g` and
//! `a`, where the length of `g` and a prior of `a` are known. Source: Cai et al., "A Pose-only Solution
//! to Visual Reconstruction and Navigation" (2021); Martinelli, "Closed-Form Solution of Visual-Inertial Structure from Motion" (2014).

use super::timing::{Bearing, weight};
use crate::geometry::attitude_from_gravity;
use crate::inertial::Preintegration;
use crate::window::state::NavState;
use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Vector3};
use plumbline_config::Portable;

/// Rounds of re-weighting by the lengths of the ways, and on the tangent of the sphere of gravity.
const ROUNDS: usize = 12;

/// Velocity, gravity, and step of the accelerometer's bias.
type Nine = SVector<f64, 9>;

/// Solves for velocity, gravity and accelerometer bias by pairs of frames that `motions` lead to from the first, at some biases; that of the
/// accelerometer is known by `sigma_m_s2`, a direction by `sigma_bearing`, rad. Returns the state of the first frame, at the origin with a
/// yaw of zero; `None` when the pairs do not determine it. `pose_b_c` are the extrinsics `T_BC` of both cameras.
pub fn align(
    bearings: &[Bearing],
    motions: &[Preintegration],
    pose_b_c: &[Isometry3<f64>; 2],
    (sigma_m_s2, gravity_m_s2): (f64, f64),
    sigma_bearing: f64,
) -> Option<NavState> {
    let mut solution: Option<Nine> = None;
    for _ in 0..ROUNDS {
        let at = solution.unwrap_or_default();
        let (mut h, mut g) = (SMatrix::<f64, 9, 9>::zeros(), Nine::zeros());
        let is_alike = |a: &Bearing, b: &Bearing| (a.frames, a.camera) == (b.frames, b.camera);
        for pair in bearings.chunk_by(is_alike) {
            let [from, to] = pair[0].frames.map(|k| &motions[k]);
            let (by_s, constant) = way(from, to, &pose_b_c[pair[0].camera].translation.vector);
            let way_b0 = by_s * at + constant;
            // At first as if the speed were known: the directions of the ways count afterwards, whatever their lengths.
            let u = way_b0.normalize();
            let (length, across) = match solution {
                None => (to.dt_s - from.dt_s, Matrix3::identity()),
                Some(_) => (way_b0.norm(), Matrix3::identity() - u * u.transpose()),
            };
            let (by_s, residual) = (across * by_s / length, way_b0 / length);
            let normals = pair.iter().map(|b| (from.delta_rot * b.f_b[0]).cross(&(to.delta_rot * b.f_b[1])));
            let planes = normals.fold(Matrix3::zeros(), |planes, n| {
                let n = n / sigma_bearing;
                planes + n * n.transpose() * solution.map_or(1.0, |_| weight(n.dot(&residual)))
            });
            h += by_s.tr_mul(&(planes * by_s));
            g += by_s.tr_mul(&(planes * residual));
        }
        for k in 6..9 {
            h[(k, k)] += 1.0 / sigma_m_s2.squared();
            g[k] += at[k] / sigma_m_s2.squared();
        }
        if solution.is_some() {
            // The length of gravity is known to 1 mm/s²: it changes by that over 300 m of height.
            let gravity = at.fixed_rows::<3>(3).into_owned();
            let mut along = Nine::zeros();
            along.fixed_rows_mut::<3>(3).copy_from(&(gravity.normalize() / 1e-3));
            h += along * along.transpose();
            g += along * ((gravity.norm() - gravity_m_s2) / 1e-3);
        }
        solution = Some(at - h.cholesky()?.solve(&g)).filter(|s| s.iter().all(|x| x.is_finite()));
    }
    let (solution, first) = (solution?, motions.first()?);
    let part = |k: usize| solution.fixed_rows::<3>(k).into_owned();
    let rot_o_b = attitude_from_gravity(&-part(3));
    Some(NavState {
        rot_o_b,
        v_o_b: rot_o_b * part(0),
        bias_gyro: first.bias_gyro,
        bias_accel: first.bias_accel + part(6),
        ..NavState::default()
    })
}

/// Way of a camera at `p_b_c` in the body between two motions: derivative by velocity, gravity and bias, and what does not depend on them.
fn way(
    from: &Preintegration,
    to: &Preintegration,
    p_b_c: &Vector3<f64>,
) -> (SMatrix<f64, 3, 9>, Vector3<f64>) {
    let mut by_s = SMatrix::<f64, 3, 9>::zeros();
    by_s.fixed_columns_mut::<3>(0).fill_diagonal(to.dt_s - from.dt_s);
    by_s.fixed_columns_mut::<3>(3).fill_diagonal(0.5 * (to.dt_s.squared() - from.dt_s.squared()));
    let by_bias = (to.by_bias - from.by_bias).fixed_view::<3, 3>(0, 3).into_owned();
    by_s.fixed_columns_mut::<3>(6).copy_from(&by_bias);
    let at = |motion: &Preintegration| motion.delta_p + motion.delta_rot * p_b_c;
    (by_s, at(to) - at(from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;
    use crate::inertial::ImuNoise;
    use nalgebra::Point3;
    use plumbline_config::{Random, Timestamp};

    const GRAVITY_O: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
    const SIGMA: f64 = 1e-3;

    /// Flies 1.5 s before 60 points from `first`, whose biases are true ones: pairs of frames 0.25 s apart, and motions at biases of zero.
    fn fly(first: &NavState, seed: u64) -> (Vec<Bearing>, Vec<Preintegration>, [Isometry3<f64>; 2]) {
        let mut random = Random::new(seed);
        let mut draw = |size: f64| Vector3::from_fn(|_, _| random.range(-1.0, 1.0) * size);
        let points_o: Vec<_> =
            (0..60).map(|_| Point3::from(Vector3::new(5.0, 0.0, 0.0) + draw(2.0))).collect();
        let pose_b_c = Isometry3::translation(0.06, -0.02, 0.03);
        let [mut told, mut real] = [[Vector3::zeros(); 2], [first.bias_gyro, first.bias_accel]]
            .map(|[g, a]| Preintegration::new(&g, &a));
        let (mut motions, mut seen) = (Vec::new(), Vec::new());
        for k in 0..=300 {
            if k % 10 == 0 {
                motions.push(Preintegration::clone(&told));
                let pose_c_o = (first.after(&real, &GRAVITY_O).pose_o_b() * pose_b_c).inverse();
                let mut see = |p: &Point3<f64>| (pose_c_o * p).coords.normalize() + draw(SIGMA);
                seen.push(points_o.iter().map(&mut see).collect::<Vec<_>>());
            }
            let t = f64::from(k) * 0.005;
            let gyro = Vector3::new(0.3 * libm::sin(4.0 * t), 0.2, 0.4 * libm::cos(3.0 * t));
            let accel =
                Vector3::new(2.0 * libm::sin(5.0 * t), 1.5 * libm::cos(4.0 * t), 9.8 + libm::sin(6.0 * t));
            for motion in [&mut told, &mut real] {
                motion.integrate(0.005, &gyro, &accel, &accel, &ImuNoise::NONE);
            }
        }
        let stamps = [Timestamp::default(); 2];
        let pair = |k: usize| {
            let of_point = move |(a, b): (&Vector3<f64>, &Vector3<f64>)| Bearing {
                frames: [k, k + 5],
                camera: 0,
                f_b: [*a, *b],
                stamps,
                row: [0.0; 2],
            };
            seen[k].iter().zip(&seen[k + 5]).map(of_point).collect::<Vec<_>>()
        };
        let bearings = (0..seen.len() - 5).flat_map(pair).collect();
        (bearings, motions, [pose_b_c; 2])
    }

    #[test]
    fn finds_velocity_gravity_and_scale_despite_noise() {
        for seed in 0..8 {
            let first = NavState {
                rot_o_b: exp_so3(&Vector3::new(0.2, -0.3, 0.0)),
                v_o_b: Vector3::new(0.3, 0.8, -0.2),
                bias_accel: Vector3::new(0.1, -0.05, 0.08),
                ..NavState::default()
            };
            let (bearings, motions, poses) = fly(&first, seed);
            let found = align(&bearings, &motions, &poses, (0.2, 9.81), SIGMA).expect("is determined");
            let [up_b, v_b] = [
                |nav: &NavState| nav.rot_o_b.inverse() * Vector3::z(),
                |nav: &NavState| nav.rot_o_b.inverse() * nav.v_o_b,
            ]
            .map(|of| of(&found) - of(&first));
            let scale = found.v_o_b.norm() / first.v_o_b.norm();
            assert!(
                up_b.norm() < 0.04 && v_b.norm() < 0.06 && (scale - 1.0).abs() < 0.06,
                "seed {seed}: {up_b:?} {v_b:?} {scale}"
            );
        }
    }
}
