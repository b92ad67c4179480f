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

use super::timing::{ALIKE, Bearing, cost, weight};
use super::{TILT_SIGMA_RAD, VELOCITY_SIGMA_M_S};
use crate::geometry::attitude_from_gravity;
use crate::inertial::Preintegration;
use crate::window::state::NavState;
use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};
use plumbline_config::Portable;

/// Gauss-Newton steps; outliers lose weight in the second half of them.
const ROUNDS: usize = 12;
/// Mean speeds that it begins with, m/s, from a hand's to a drone's: of a wrong one accelerations turn the ways too little, or too much.
const SPEEDS_M_S: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

/// Velocity, gravity, and step of the accelerometer's bias.
type Nine = SVector<f64, 9>;

/// Pairs of frames, and the motions that lead to them from the first at some biases.
#[derive(Clone, Copy, Debug)]
pub struct Alignment<'a> {
    /// Common points of the pairs, those of a pair together.
    pub bearings: &'a [Bearing],
    /// Motions from the first frame to each.
    pub motions: &'a [Preintegration],
    /// Extrinsics `T_BC` of both cameras.
    pub pose_b_c: &'a [Isometry3<f64>; 2],
    /// Standard deviation of a direction, rad.
    pub sigma_bearing: f64,
    /// Standard deviation of the accelerometer's bias, m/s².
    pub sigma_m_s2: f64,
    /// Length of gravity, m/s².
    pub gravity_m_s2: f64,
}

/// Sums over all pairs at some values of the unknowns.
#[derive(Clone, Debug, Default)]
struct Sums {
    h: SMatrix<f64, 9, 9>,
    g: Nine,
    /// Robust cost, in squared standard deviations.
    cost: f64,
    /// Positive where points are in front of the camera.
    in_front: f64,
    /// Squares of the normals.
    normals: Matrix3<f64>,
}

impl Alignment<'_> {
    /// Solves for velocity, gravity and accelerometer bias. Returns the state of the first frame, at the origin with a yaw of zero; `None` when
    /// the pairs do not determine it.
    pub fn solve(&self) -> Option<NavState> {
        let (first, last) = (self.motions.first()?, self.motions.last()?);
        let mut at = Nine::zeros();
        let gravity_b0 = last.delta_v.normalize() * -self.gravity_m_s2;
        at.fixed_rows_mut::<3>(3).copy_from(&gravity_b0);
        let eigen = SymmetricEigen::try_new(self.sums(&at, false).normals, f64::EPSILON, 64)?;
        let along = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let by_acceleration = last.delta_p / last.dt_s + gravity_b0 * (0.5 * last.dt_s);
        let begin = |mean_m_s: Vector3<f64>| {
            let mut at = at;
            at.fixed_rows_mut::<3>(0).copy_from(&(mean_m_s - by_acceleration));
            at
        };
        let found = SPEEDS_M_S.into_iter().filter_map(|speed_m_s| {
            let both = [speed_m_s, -speed_m_s].map(|speed_m_s| begin(along * speed_m_s));
            let is_forward = self.sums(&both[0], false).in_front >= self.sums(&both[1], false).in_front;
            self.descend(if is_forward { both[0] } else { both[1] })
        });
        let (solution, _) = found.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
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

    /// Gauss-Newton; the solution and its cost.
    fn descend(&self, mut at: Nine) -> Option<(Nine, f64)> {
        for round in 0..ROUNDS {
            let sums = self.sums(&at, round >= ROUNDS / 2);
            at -= sums.h.cholesky()?.solve(&sums.g);
        }
        let sums = self.sums(&at, true);
        (sums.cost.is_finite() && sums.in_front > 0.0).then_some((at, sums.cost))
    }

    fn sums(&self, at: &Nine, is_robust: bool) -> Sums {
        let mut sums = Sums::default();
        let is_alike = |a: &Bearing, b: &Bearing| (a.frames, a.camera) == (b.frames, b.camera);
        for pair in self.bearings.chunk_by(is_alike) {
            let [from, to] = pair[0].frames.map(|k| &self.motions[k]);
            let (by_s, constant) = way(from, to, &self.pose_b_c[pair[0].camera].translation.vector);
            let way_b0 = by_s * at + constant;
            let (u, length) = (way_b0.normalize(), way_b0.norm());
            let by_s = (Matrix3::identity() - u * u.transpose()) * by_s / length;
            let mut planes = Matrix3::zeros();
            for b in pair {
                let f_b0 = [from.delta_rot * b.f_b[0], to.delta_rot * b.f_b[1]];
                let n = f_b0[0].cross(&f_b0[1]) / self.sigma_bearing;
                let e = n.dot(&u);
                planes += n * n.transpose() * (if is_robust { weight(e) } else { 1.0 } / ALIKE);
                sums.normals += n * n.transpose();
                sums.in_front += n.dot(&u.cross(&f_b0[1]));
                sums.cost += cost(e) / ALIKE;
            }
            sums.h += by_s.tr_mul(&(planes * by_s));
            sums.g += by_s.tr_mul(&(planes * u));
        }
        self.add_known(at, &mut sums);
        sums
    }

    /// Adds what is known beforehand: gravity by the mean specific force and by its length, and the bias.
    fn add_known(&self, at: &Nine, sums: &mut Sums) {
        let Some(last) = self.motions.last() else { return };
        let mut known = Nine::zeros();
        known.fixed_rows_mut::<3>(3).copy_from(&(last.delta_v / -last.dt_s));
        let tilt_m_s2 = TILT_SIGMA_RAD * self.gravity_m_s2;
        for k in 0..9 {
            let sigma = [VELOCITY_SIGMA_M_S, tilt_m_s2, self.sigma_m_s2][k / 3];
            let off = (at[k] - known[k]) / sigma;
            sums.h[(k, k)] += 1.0 / sigma.squared();
            sums.g[k] += off / sigma;
            sums.cost += off.squared();
        }
        // The length of gravity is known to 1 mm/s²: it changes by that over 300 m of height.
        let gravity = at.fixed_rows::<3>(3).into_owned();
        let mut along = Nine::zeros();
        along.fixed_rows_mut::<3>(3).copy_from(&(gravity.normalize() / 1e-3));
        sums.h += along * along.transpose();
        sums.g += along * ((gravity.norm() - self.gravity_m_s2) / 1e-3);
    }
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
