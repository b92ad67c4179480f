//! Structure, motion, gravity and scale from one camera in motion, all at once.
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
use crate::window::reprojection::PointMeasurement;
use nalgebra::{Isometry3, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};
use plumbline_config::Portable;
use std::ops::Range;

/// Rounds of re-weighting by depth.
const ROUNDS: usize = 8;
/// Rounds on the tangent of the sphere of gravity.
const GRAVITY_ROUNDS: usize = 6;
/// Depth of a point in the first round and the bounds of it later, m.
const FIRST_DEPTH_M: f64 = 3.0;
const MIN_DEPTH_M: f64 = 0.2;
/// Weight of a view that has its point behind the camera: not zero, so that a wrong depth can come right.
const WEIGHT_BEHIND: f64 = 0.01;
/// Bound on the share of one residual in the mean, squared standard deviations: a few outliers are no
/// failure.
const MAX_SQUARED_RESIDUAL: f64 = 100.0;
/// Information of a point below which its place is not determined (product of the three eigenvalues, 1/m⁶).
const MIN_DETERMINANT: f64 = 1e-9;
/// Views of a point that make it worth while.
const MIN_VIEWS: usize = 4;
/// Residuals beyond this many standard deviations lose weight (Cauchy).
const ROBUST_SIGMAS: f64 = 3.0;

/// Velocity and gravity at the first frame, in its body frame.
#[derive(Clone, Copy, Debug)]
pub struct GravityAlignment {
    /// Velocity of the body, m/s.
    pub v_b0: Vector3<f64>,
    /// Gravity, m/s².
    pub gravity_b0: Vector3<f64>,
    /// Root mean square of the residuals, in standard deviations.
    pub rms_sigmas: f64,
}

/// The memory of an alignment, allocated once.
#[derive(Clone, Debug)]
pub struct AlignmentWorkspace {
    motions: Vec<Preintegration>,
    cameras: Vec<[CameraAt; 2]>,
    track_ids: Vec<u32>,
    points: Vec<Point>,
    views: Vec<View>,
}

impl AlignmentWorkspace {
    /// Room for `frames` of `points` each.
    #[must_use]
    pub fn new(frames: usize, points: usize) -> Self {
        let tracks = frames * points;
        let views = 2 * tracks;
        Self {
            motions: Vec::with_capacity(frames),
            cameras: Vec::with_capacity(frames),
            track_ids: Vec::with_capacity(tracks),
            points: Vec::with_capacity(views / MIN_VIEWS),
            // The views of a track are counted before it is known whether they are enough.
            views: Vec::with_capacity(views),
        }
    }

    /// The motions of the last alignment, from the first frame to each (identity for the first itself).
    #[must_use]
    pub fn motions(&self) -> &[Preintegration] {
        &self.motions
    }
}

type Six = SVector<f64, 6>;

/// One view of a point: camera position as a constant and as a linear function of (v, g).
#[derive(Clone, Debug)]
struct CameraAt {
    rot_c_b0: Matrix3<f64>,
    p_constant: Vector3<f64>,
    dt: f64,
}

/// Measurement of a point by one camera in one frame.
#[derive(Clone, Debug)]
struct View {
    frame: usize,
    camera: usize,
    measured: PointMeasurement,
    /// Depth as found in the last round, m.
    depth_m: f64,
    /// Robust weight, as found in the last round.
    weight: f64,
}

/// A point: its views within [`AlignmentWorkspace::views`], and its equations where they can be solved.
#[derive(Clone, Debug)]
struct Point {
    views: Range<usize>,
    block: Option<PointBlock>,
}

/// The equations of a point summed, `v` and `g` still open.
#[derive(Clone, Debug)]
struct PointBlock {
    h_xx: Matrix3<f64>,
    h_xs: SMatrix<f64, 3, 6>,
    g_x: Vector3<f64>,
}

/// Solves for velocity and gravity over `frames`, `biases` removed beforehand (gyroscope rad/s, accelerometer
/// m/s²); `None` when
/// the views do not determine them. `pose_b_c` are the extrinsics `T_BC` of both cameras.
#[must_use]
pub fn align(
    frames: &[GatheredFrame],
    pose_b_c: &[Isometry3<f64>; 2],
    biases: &(Vector3<f64>, Vector3<f64>),
    gravity_m_s2: f64,
    workspace: &mut AlignmentWorkspace,
) -> Option<GravityAlignment> {
    workspace.find_motions(frames, biases)?;
    workspace.place_cameras(pose_b_c);
    workspace.find_points(frames);
    let mut solution = Six::zeros();
    let mut rms_sigmas = 0.0;
    for _ in 0..ROUNDS {
        let (h, g) = workspace.normal_equations();
        solution = constrained(&h, &g, gravity_m_s2)?;
        rms_sigmas = workspace.update(&solution);
    }
    Some(GravityAlignment {
        v_b0: solution.fixed_rows::<3>(0).into_owned(),
        gravity_b0: solution.fixed_rows::<3>(3).into_owned(),
        rms_sigmas,
    })
}

impl AlignmentWorkspace {
    /// Motions from the first frame at the biases given; `None` where one is not known.
    fn find_motions(
        &mut self,
        frames: &[GatheredFrame],
        (bias_gyro, bias_accel): &(Vector3<f64>, Vector3<f64>),
    ) -> Option<()> {
        self.motions.clear();
        self.motions.push(Preintegration::new(bias_gyro, bias_accel));
        for k in 1..frames.len() {
            let mut motion = joined_motion(frames, 0, k)?;
            let corrected = motion.corrected(bias_gyro, bias_accel);
            (motion.delta_p, motion.delta_rot, motion.delta_v) = (corrected.p, corrected.rot, corrected.v);
            (motion.bias_gyro, motion.bias_accel) = (*bias_gyro, *bias_accel);
            self.motions.push(motion);
        }
        Some(())
    }

    fn place_cameras(&mut self, pose_b_c: &[Isometry3<f64>; 2]) {
        self.cameras.clear();
        self.cameras.extend(self.motions.iter().map(|m| {
            let rot_b0_b = m.delta_rot.to_rotation_matrix().into_inner();
            pose_b_c.map(|pose| CameraAt {
                rot_c_b0: (rot_b0_b * pose.rotation.to_rotation_matrix().into_inner()).transpose(),
                p_constant: m.delta_p + rot_b0_b * pose.translation.vector,
                dt: m.dt_s,
            })
        }));
    }

    /// Every track with enough views, in order of id.
    fn find_points(&mut self, frames: &[GatheredFrame]) {
        let Self { track_ids, points, views, .. } = self;
        track_ids.clear();
        track_ids.extend(frames.iter().flat_map(|f| f.tracks.iter().map(|t| t.track_id)));
        track_ids.sort_unstable();
        track_ids.dedup();
        points.clear();
        views.clear();
        for &id in &*track_ids {
            let begin = views.len();
            for (frame, track) in frames.iter().enumerate().filter_map(|(k, f)| Some((k, find_track(f, id)?)))
            {
                let view = |camera: usize| {
                    let measured = track.measured[camera]?;
                    Some(View { frame, camera, measured, depth_m: FIRST_DEPTH_M, weight: 1.0 })
                };
                views.extend((0..2).filter_map(view));
            }
            if views.len() - begin < MIN_VIEWS {
                views.truncate(begin);
            } else {
                points.push(Point { views: begin..views.len(), block: None });
            }
        }
    }
}

/// The two equations of a view: derivatives by the point and by (v, g), and the constant.
fn equations(camera: &CameraAt, xy: &Vector2<f64>) -> (Matrix2x3<f64>, SMatrix<f64, 2, 6>, Vector2<f64>) {
    let across = Matrix2x3::new(1.0, 0.0, -xy.x, 0.0, 1.0, -xy.y) * camera.rot_c_b0;
    let mut by_s = SMatrix::<f64, 2, 6>::zeros();
    by_s.fixed_columns_mut::<3>(0).copy_from(&(across * -camera.dt));
    by_s.fixed_columns_mut::<3>(3).copy_from(&(across * (-0.5 * camera.dt * camera.dt)));
    (across, by_s, -(across * camera.p_constant))
}

impl AlignmentWorkspace {
    /// Normal equations of (v, g) with every point eliminated, `H s = -g`; the blocks of the points are kept.
    fn normal_equations(&mut self) -> (SMatrix<f64, 6, 6>, Six) {
        let Self { points, views, cameras, .. } = self;
        let mut h = SMatrix::<f64, 6, 6>::zeros();
        let mut g = Six::zeros();
        for point in points {
            let mut b = PointBlock { h_xx: Matrix3::zeros(), h_xs: SMatrix::zeros(), g_x: Vector3::zeros() };
            let mut h_ss = SMatrix::<f64, 6, 6>::zeros();
            let mut g_s = Six::zeros();
            for view in &views[point.views.clone()] {
                let (by_x, by_s, constant) = equations(&cameras[view.frame][view.camera], &view.measured.xy);
                let scale = view.measured.weight * (view.weight.sqrt() / view.depth_m);
                let (by_x, by_s, constant) = (scale * by_x, scale * by_s, scale * constant);
                b.h_xx += by_x.tr_mul(&by_x);
                b.h_xs += by_x.tr_mul(&by_s);
                b.g_x += by_x.tr_mul(&constant);
                h_ss += by_s.tr_mul(&by_s);
                g_s += by_s.tr_mul(&constant);
            }
            point.block = match b.h_xx.try_inverse() {
                Some(inverse) if b.h_xx.determinant() > MIN_DETERMINANT => {
                    h += h_ss - b.h_xs.tr_mul(&(inverse * b.h_xs));
                    g += g_s - b.h_xs.tr_mul(&(inverse * b.g_x));
                    Some(b)
                }
                _ => None,
            };
        }
        (h, g)
    }
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

impl AlignmentWorkspace {
    /// New depths and robust weights at the solution; root mean square residual.
    fn update(&mut self, s: &Six) -> f64 {
        let Self { points, views, cameras, .. } = self;
        let (mut sum, mut count) = (0.0, 0);
        for point in points {
            let views = &mut views[point.views.clone()];
            let place = |b: &PointBlock| Some(-(b.h_xx.try_inverse()? * (b.g_x + b.h_xs * s)));
            let Some(p_b0) = point.block.as_ref().and_then(place) else {
                views.iter_mut().for_each(|view| view.weight = 0.0);
                continue;
            };
            for view in views {
                let at = &cameras[view.frame][view.camera];
                let (v0, g0) = (s.fixed_rows::<3>(0), s.fixed_rows::<3>(3));
                let p_camera = at.p_constant + v0 * at.dt + g0 * (0.5 * at.dt * at.dt);
                let depth_m = (at.rot_c_b0 * (p_b0 - p_camera)).z;
                view.depth_m = depth_m.abs().at_least(MIN_DEPTH_M);
                let (by_x, by_s, constant) = equations(at, &view.measured.xy);
                let r = view.measured.weight * (by_x * p_b0 + by_s * s + constant) / view.depth_m;
                let squared = r.norm_squared();
                view.weight = if depth_m > 0.0 {
                    1.0 / (1.0 + squared / (ROBUST_SIGMAS * ROBUST_SIGMAS))
                } else {
                    WEIGHT_BEHIND
                };
                sum += squared.at_most(MAX_SQUARED_RESIDUAL);
                count += 1;
            }
        }
        (sum / (2 * count).max(1) as f64).sqrt()
    }
}
