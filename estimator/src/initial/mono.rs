//! Manhattan, motion, gravity and scale from one camera in motion, all at once.
//!
//! With rotations known from the gyroscope, the position of the body at frame `k` is linear in the first
//! velocity and in gravity, both in the first body frame:
//!
//! ```text
//! p_k = v t_k + g t_k²/2 + dp_k
//! ```
//!
//! and a point `X` seen in direction `(x, y, 1)` by a camera at `p_k + R_k p_bc` gives two linear
//! equations, `(R_ck' (X - p_ck)).xy - (x, y) (R_ck' (X - p_ck)).z = 0`, divided by the depth of the last
//! round so that they are errors in the image. Points are eliminated one by one (Schur complement), which
//! leaves six equations for `v` and `g`; `|g|` is then held at its known value. This is the structure from
//! motion and the visual-inertial alignment of VINS-Mono (Qin et al. 2018, section V) in one step: no
//! scale drifts between them. Source: Martinelli, "Closed-Form Solution of Visual-Inertial Structure from
//! Motion" (2014).

use super::gyro_bias::joined_motion;
use super::{GatheredFrame, find_track};
use crate::inertial::Preintegration;
use nalgebra::{Isometry3, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Rounds of re-weighting by depth.
const ROUNDS: usize = 8;
/// Rounds on the tangent of the sphere of gravity.
const GRAVITY_ROUNDS: usize = 6;
/// Depth of a point in the first round and the bounds of it later, m.
const FIRST_DEPTH_M: f64 = 3.0;
const MIN_DEPTH_M: f64 = 0.2;
/// Views of a point that make it worth while.
const MIN_VIEWS: usize = 4;
/// Residuals beyond this many standard deviations lose weight (Cauchy).
const ROBUST_SIGMAS: f64 = 3.0;

/// Velocity and gravity at the first frame, in its body frame, and the motions to all frames.
#[derive(Clone, Debug)]
pub struct Alignment {
    /// Velocity of the body, m/s.
    pub v_b0: Vector3<f64>,
    /// Gravity, m/s².
    pub gravity_b0: Vector3<f64>,
    /// Motion from the first frame to each frame (identity for the first itself).
    pub motions: Vec<Preintegration>,
    /// Root mean square of the residuals, in standard deviations.
    pub rms_sigmas: f64,
    /// Observations used.
    pub observations: usize,
}

type Six = SVector<f64, 6>;

/// One view of a point: camera position as a constant and as a linear function of (v, g).
struct CameraAt {
    rot_c_b0: Matrix3<f64>,
    p_constant: Vector3<f64>,
    dt: f64,
}

/// The points with their equations summed, `v` and `g` still open.
struct PointBlock {
    h_xx: Matrix3<f64>,
    h_xs: SMatrix<f64, 3, 6>,
    g_x: Vector3<f64>,
}

/// Solves for velocity and gravity over `frames`, biases removed beforehand (`bias_gyro`); `None` when
/// the views do not determine them.
#[must_use]
pub fn align(
    frames: &[GatheredFrame],
    pose_b_c: &[Isometry3<f64>; 2],
    bias_gyro: &Vector3<f64>,
    gravity_m_s2: f64,
) -> Option<Alignment> {
    let motions = motions_from_first(frames, bias_gyro)?;
    let cameras = cameras(&motions, pose_b_c);
    let tracks = tracks(frames);
    let mut depths: Vec<Vec<f64>> = tracks.iter().map(|t| vec![FIRST_DEPTH_M; t.1.len()]).collect();
    let mut weights: Vec<Vec<f64>> = tracks.iter().map(|t| vec![1.0; t.1.len()]).collect();
    let mut solution = Six::zeros();
    let mut rms = 0.0;
    let mut count = 0;
    for _ in 0..ROUNDS {
        let (h, g, blocks) = normal_equations(&tracks, &cameras, &depths, &weights);
        solution = constrained(&h, &g, gravity_m_s2)?;
        (rms, count) = update(&tracks, &cameras, &blocks, &solution, &mut depths, &mut weights);
    }
    Some(Alignment {
        v_b0: solution.fixed_rows::<3>(0).into_owned(),
        gravity_b0: solution.fixed_rows::<3>(3).into_owned(),
        motions,
        rms_sigmas: rms,
        observations: count,
    })
}

/// Motions from the first frame at the gyroscope bias given.
fn motions_from_first(frames: &[GatheredFrame], bias_gyro: &Vector3<f64>) -> Option<Vec<Preintegration>> {
    let zero = Vector3::zeros();
    let mut motions = vec![Preintegration::new(bias_gyro, &zero)];
    for k in 1..frames.len() {
        let mut motion = joined_motion(frames, 0, k)?;
        let corrected = motion.corrected(bias_gyro, &zero);
        (motion.delta_p, motion.delta_rot, motion.delta_v) = (corrected.p, corrected.rot, corrected.v);
        motion.bias_gyro = *bias_gyro;
        motions.push(motion);
    }
    Some(motions)
}

fn cameras(motions: &[Preintegration], pose_b_c: &[Isometry3<f64>; 2]) -> Vec<[CameraAt; 2]> {
    motions
        .iter()
        .map(|m| {
            let rot_b0_b = m.delta_rot.to_rotation_matrix().into_inner();
            pose_b_c.map(|pose| CameraAt {
                rot_c_b0: (rot_b0_b * pose.rotation.to_rotation_matrix().into_inner()).transpose(),
                p_constant: m.delta_p + rot_b0_b * pose.translation.vector,
                dt: m.dt_s,
            })
        })
        .collect()
}

type View = (usize, usize, crate::window::reprojection::PointMeasurement);

/// Every track with enough views: its id and (frame, camera, measurement).
fn tracks(frames: &[GatheredFrame]) -> Vec<(u32, Vec<View>)> {
    let mut ids: Vec<u32> = frames.iter().flat_map(|f| f.tracks.iter().map(|t| t.track_id)).collect();
    ids.sort_unstable();
    ids.dedup();
    ids.into_iter()
        .map(|id| {
            let views = frames.iter().enumerate().filter_map(|(k, f)| Some((k, find_track(f, id)?)));
            let views = views.flat_map(|(k, t)| (0..2).filter_map(move |c| Some((k, c, t.measured[c]?))));
            (id, views.collect::<Vec<_>>())
        })
        .filter(|(_, views)| views.len() >= MIN_VIEWS)
        .collect()
}

/// The two equations of a view: derivatives by the point and by (v, g), and the constant.
fn equations(camera: &CameraAt, xy: &Vector2<f64>) -> (Matrix2x3<f64>, SMatrix<f64, 2, 6>, Vector2<f64>) {
    let across = Matrix2x3::new(1.0, 0.0, -xy.x, 0.0, 1.0, -xy.y) * camera.rot_c_b0;
    let mut by_s = SMatrix::<f64, 2, 6>::zeros();
    by_s.fixed_columns_mut::<3>(0).copy_from(&(across * -camera.dt));
    by_s.fixed_columns_mut::<3>(3).copy_from(&(across * (-0.5 * camera.dt * camera.dt)));
    (across, by_s, -(across * camera.p_constant))
}

fn normal_equations(
    tracks: &[(u32, Vec<View>)],
    cameras: &[[CameraAt; 2]],
    depths: &[Vec<f64>],
    weights: &[Vec<f64>],
) -> (SMatrix<f64, 6, 6>, Six, Vec<Option<PointBlock>>) {
    let mut h = SMatrix::<f64, 6, 6>::zeros();
    let mut g = Six::zeros();
    let mut blocks = Vec::with_capacity(tracks.len());
    for (t, (_, views)) in tracks.iter().enumerate() {
        let mut b = PointBlock { h_xx: Matrix3::zeros(), h_xs: SMatrix::zeros(), g_x: Vector3::zeros() };
        let mut h_ss = SMatrix::<f64, 6, 6>::zeros();
        let mut g_s = Six::zeros();
        for (v, (frame, camera, measured)) in views.iter().enumerate() {
            let (by_x, by_s, constant) = equations(&cameras[*frame][*camera], &measured.xy);
            let scale = measured.weight * (weights[t][v].sqrt() / depths[t][v]);
            let (by_x, by_s, constant) = (scale * by_x, scale * by_s, scale * constant);
            b.h_xx += by_x.tr_mul(&by_x);
            b.h_xs += by_x.tr_mul(&by_s);
            b.g_x += by_x.tr_mul(&constant);
            h_ss += by_s.tr_mul(&by_s);
            g_s += by_s.tr_mul(&constant);
        }
        match b.h_xx.try_inverse() {
            Some(inverse) if b.h_xx.determinant() > 1e-9 => {
                h += h_ss - b.h_xs.tr_mul(&(inverse * b.h_xs));
                g += g_s - b.h_xs.tr_mul(&(inverse * b.g_x));
                blocks.push(Some(b));
            }
            _ => blocks.push(None),
        }
    }
    (h, g, blocks)
}

/// `H s = -g` with the last three of `s` on the sphere of radius `gravity_m_s2`: first without, then on
/// the tangent plane.
fn constrained(h: &SMatrix<f64, 6, 6>, g: &Six, gravity_m_s2: f64) -> Option<Six> {
    let mut s = -(h.cholesky()?.solve(g));
    for _ in 0..GRAVITY_ROUNDS {
        let direction = s.fixed_rows::<3>(3).try_normalize(1e-6)?;
        let helper = if direction.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let a = direction.cross(&helper).normalize();
        let b = direction.cross(&a);
        let mut basis = SMatrix::<f64, 6, 5>::zeros();
        basis.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        basis.fixed_view_mut::<3, 1>(3, 3).copy_from(&a);
        basis.fixed_view_mut::<3, 1>(3, 4).copy_from(&b);
        let mut offset = Six::zeros();
        offset.fixed_rows_mut::<3>(3).copy_from(&(direction * gravity_m_s2));
        let reduced = basis.tr_mul(&(h * basis));
        let w = -(reduced.cholesky()?.solve(&basis.tr_mul(&(g + h * offset))));
        s = offset + basis * w;
    }
    let direction = s.fixed_rows::<3>(3).normalize() * gravity_m_s2;
    s.fixed_rows_mut::<3>(3).copy_from(&direction);
    s.iter().all(|x| x.is_finite()).then_some(s)
}

/// New depths and robust weights at the solution; root mean square residual and number of observations.
fn update(
    tracks: &[(u32, Vec<View>)],
    cameras: &[[CameraAt; 2]],
    blocks: &[Option<PointBlock>],
    s: &Six,
    depths: &mut [Vec<f64>],
    weights: &mut [Vec<f64>],
) -> (f64, usize) {
    let (mut sum, mut count) = (0.0, 0);
    for (t, ((_, views), block)) in tracks.iter().zip(blocks).enumerate() {
        let Some(point) = block.as_ref().and_then(|b| Some(-(b.h_xx.try_inverse()? * (b.g_x + b.h_xs * s))))
        else {
            weights[t].fill(0.0);
            continue;
        };
        for (v, (frame, camera, measured)) in views.iter().enumerate() {
            let at = &cameras[*frame][*camera];
            let (v0, g0) = (s.fixed_rows::<3>(0), s.fixed_rows::<3>(3));
            let p_camera = at.p_constant + v0 * at.dt + g0 * (0.5 * at.dt * at.dt);
            let depth = (at.rot_c_b0 * (point - p_camera)).z;
            depths[t][v] = depth.abs().max(MIN_DEPTH_M);
            let (by_x, by_s, constant) = equations(at, &measured.xy);
            let r = measured.weight * (by_x * point + by_s * s + constant) / depths[t][v];
            let squared = r.norm_squared();
            weights[t][v] =
                if depth > 0.0 { 1.0 / (1.0 + squared / (ROBUST_SIGMAS * ROBUST_SIGMAS)) } else { 0.01 };
            sum += squared.min(100.0);
            count += 1;
        }
    }
    ((sum / (2 * count).max(1) as f64).sqrt(), count)
}
