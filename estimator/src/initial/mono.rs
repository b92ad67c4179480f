//! Structure, motion, gravity, scale and the accelerometer's bias from one camera in motion, all at once.
//!
//! With rotations known from the gyroscope, the position of the body at frame `k` is linear in the first
//! velocity, in gravity, both in the first body frame, and in the bias `a`, which has a prior:
//!
//! ```text
//! p_k = v t_k + g t_k²/2 + dp_k + (d dp_k / d a) a
//! ```
//!
//! and a point `X` seen in direction `(x, y, 1)` by a camera at `p_k + R_k p_bc` gives two linear
//! equations, `(R_ck' (X - p_ck)).xy - (x, y) (R_ck' (X - p_ck)).z = 0`, divided by the depth of the last
//! round so that they are errors in the image. Points are eliminated one by one (Schur complement), which
//! leaves nine equations for `v`, `g` and `a`; `|g|` is then held at its known value. This is the structure from
//! motion and the visual-inertial alignment of VINS-Mono (Qin et al. 2018, section V) in one step: no
//! scale drifts between them. Source: Martinelli, "Closed-Form Solution of Visual-Inertial Structure from
//! Motion" (2014).

use super::GatheredFrame;
use super::stereo::attitude_from_gravity;
use crate::inertial::Preintegration;
use crate::window::reprojection::PointMeasurement;
use crate::window::state::NavState;
use nalgebra::{Isometry3, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Rounds of re-weighting by depth.
const ROUNDS: usize = 8;
/// Rounds on the tangent of the sphere of gravity.
const GRAVITY_ROUNDS: usize = 6;
/// Depth of a point in the first round and the bounds of it later, m.
const FIRST_DEPTH_M: f64 = 3.0;
const MIN_DEPTH_M: f64 = 0.2;
/// Weight of a view that has its point behind the camera: not zero, so that a wrong depth can come right.
const WEIGHT_BEHIND: f64 = 0.01;
/// Information of a point below which its place is not determined (product of the three eigenvalues, 1/m⁶).
const MIN_DETERMINANT: f64 = 1e-9;
/// Views of a point that make it worth while.
const MIN_VIEWS: usize = 4;
/// Residuals beyond this many standard deviations lose weight (Cauchy).
const ROBUST_SIGMAS: f64 = 3.0;

/// The memory of an alignment, allocated once.
#[derive(Clone, Debug)]
pub struct AlignmentWorkspace {
    motions: Vec<Preintegration>,
    cameras: Vec<[CameraAt; 2]>,
    views: Vec<View>,
}

impl AlignmentWorkspace {
    /// Room for `frames` of `points` each.
    #[must_use]
    pub fn new(frames: usize, points: usize) -> Self {
        Self {
            motions: Vec::with_capacity(frames),
            cameras: Vec::with_capacity(frames),
            views: Vec::with_capacity(2 * frames * points),
        }
    }

    /// The motions of the last alignment, from the first frame to each (identity for the first itself).
    #[must_use]
    pub fn motions(&self) -> &[Preintegration] {
        &self.motions
    }
}

/// Velocity, gravity, and step of the accelerometer's bias.
type Nine = SVector<f64, 9>;

/// One view of a point: camera position as a constant and as a linear function of (v, g, a).
#[derive(Clone, Debug)]
struct CameraAt {
    rot_c_b0: Matrix3<f64>,
    p_constant: Vector3<f64>,
    by_bias: Matrix3<f64>,
    dt: f64,
}

/// Measurement of a point by one camera in one frame.
#[derive(Clone, Debug)]
struct View {
    track_id: u32,
    frame: usize,
    camera: usize,
    measured: PointMeasurement,
    /// Depth as found in the last round, m.
    depth_m: f64,
    /// Robust weight, as found in the last round.
    weight: f64,
}

/// Solves for velocity, gravity and accelerometer bias over `frames`, between which the body moved by `motion` at some biases, that of the
/// accelerometer known by `sigma_m_s2`. Returns the state of the first frame, at the origin with a yaw of zero; `None` when the views do not
/// determine it. `pose_b_c` are the extrinsics `T_BC` of both cameras.
#[must_use]
pub fn align(
    frames: &[GatheredFrame],
    pose_b_c: &[Isometry3<f64>; 2],
    motion: impl Fn([Timestamp; 2]) -> Preintegration,
    sigma_m_s2: f64,
    gravity_m_s2: f64,
    workspace: &mut AlignmentWorkspace,
) -> Option<NavState> {
    workspace.find_motions(frames, motion);
    workspace.place_cameras(pose_b_c);
    workspace.find_views(frames);
    let mut solution = None;
    for _ in 0..ROUNDS {
        let (mut h, g) = workspace.normal_equations(solution.as_ref());
        for k in 6..9 {
            h[(k, k)] += 1.0 / sigma_m_s2.squared();
        }
        solution = Some(constrained(&h, &g, gravity_m_s2)?);
    }
    let solution = solution?;
    let part = |k: usize| solution.fixed_rows::<3>(k).into_owned();
    let (rot_o_b, first) = (attitude_from_gravity(&-part(3)), workspace.motions.first()?);
    Some(NavState {
        rot_o_b,
        v_o_b: rot_o_b * part(0),
        bias_gyro: first.bias_gyro,
        bias_accel: first.bias_accel + part(6),
        ..NavState::default()
    })
}

impl AlignmentWorkspace {
    fn find_motions(&mut self, frames: &[GatheredFrame], motion: impl Fn([Timestamp; 2]) -> Preintegration) {
        self.motions.clear();
        let Some(first) = frames.first() else { return };
        self.motions.push(motion([first.time.stamp; 2]));
        for (k, pair) in frames.windows(2).enumerate() {
            let next = motion([pair[0].time.stamp, pair[1].time.stamp]);
            self.motions.push(self.motions[k].followed_by(&next));
        }
    }

    fn place_cameras(&mut self, pose_b_c: &[Isometry3<f64>; 2]) {
        self.cameras.clear();
        self.cameras.extend(self.motions.iter().map(|m| {
            let rot_b0_b = m.delta_rot.to_rotation_matrix().into_inner();
            pose_b_c.map(|pose| CameraAt {
                rot_c_b0: (rot_b0_b * pose.rotation.to_rotation_matrix().into_inner()).transpose(),
                p_constant: m.delta_p + rot_b0_b * pose.translation.vector,
                by_bias: m.by_bias.fixed_view::<3, 3>(0, 3).into_owned(),
                dt: m.dt_s,
            })
        }));
    }

    /// All views, those of a point together.
    fn find_views(&mut self, frames: &[GatheredFrame]) {
        self.views.clear();
        for (frame, track) in
            frames.iter().enumerate().flat_map(|(k, f)| f.tracks.iter().map(move |t| (k, t)))
        {
            self.views.extend((0..2).filter_map(|camera| {
                let (track_id, measured) = (track.track_id, track.measured[camera]?);
                Some(View { track_id, frame, camera, measured, depth_m: FIRST_DEPTH_M, weight: 1.0 })
            }));
        }
        self.views.sort_unstable_by_key(|view| (view.track_id, view.frame, view.camera));
    }

    /// Normal equations of (v, g, a) with every point eliminated, `H s = -g`, by weights and depths at the last `solution`.
    fn normal_equations(&mut self, solution: Option<&Nine>) -> (SMatrix<f64, 9, 9>, Nine) {
        let (mut h, mut g) = (SMatrix::<f64, 9, 9>::zeros(), Nine::zeros());
        for views in self.views.chunk_by_mut(|a, b| a.track_id == b.track_id).filter(|v| v.len() >= MIN_VIEWS)
        {
            if let Some(solution) = solution {
                weigh(views, &self.cameras, solution);
            }
            let sums = PointSums::of(views, &self.cameras);
            if let Some(inverse) = sums.inverse() {
                h += sums.h_ss - sums.h_xs.tr_mul(&(inverse * sums.h_xs));
                g += sums.g_s - sums.h_xs.tr_mul(&(inverse * sums.g_x));
            }
        }
        (h, g)
    }
}

/// Normal equations of a point `x` and of `s` = (v, g, a).
#[derive(Clone, Debug, Default)]
struct PointSums {
    h_xx: Matrix3<f64>,
    h_xs: SMatrix<f64, 3, 9>,
    h_ss: SMatrix<f64, 9, 9>,
    g_x: Vector3<f64>,
    g_s: Nine,
}

impl PointSums {
    fn of(views: &[View], cameras: &[[CameraAt; 2]]) -> Self {
        let mut sums = Self::default();
        for view in views {
            let (by_x, by_s, constant) = equations(&cameras[view.frame][view.camera], &view.measured.xy);
            let scale = view.measured.weight * (view.weight.sqrt() / view.depth_m);
            let (by_x, by_s, constant) = (scale * by_x, scale * by_s, scale * constant);
            sums.h_xx += by_x.tr_mul(&by_x);
            sums.h_xs += by_x.tr_mul(&by_s);
            sums.g_x += by_x.tr_mul(&constant);
            sums.h_ss += by_s.tr_mul(&by_s);
            sums.g_s += by_s.tr_mul(&constant);
        }
        sums
    }

    /// Inverse of the information of the point; `None` where its place is not determined.
    fn inverse(&self) -> Option<Matrix3<f64>> {
        self.h_xx.try_inverse().filter(|_| self.h_xx.determinant() > MIN_DETERMINANT)
    }
}

/// Depths and robust weights of the views of a point at the solution `s`.
fn weigh(views: &mut [View], cameras: &[[CameraAt; 2]], s: &Nine) {
    let sums = PointSums::of(views, cameras);
    let p_b0 = sums.inverse().map(|inverse| -(inverse * (sums.g_x + sums.h_xs * s)));
    for view in views {
        let Some(p_b0) = p_b0 else {
            view.weight = 0.0;
            continue;
        };
        let at = &cameras[view.frame][view.camera];
        let part = |k: usize| s.fixed_rows::<3>(k);
        let p_camera =
            at.p_constant + part(0) * at.dt + part(3) * (0.5 * at.dt * at.dt) + at.by_bias * part(6);
        let depth_m = (at.rot_c_b0 * (p_b0 - p_camera)).z;
        view.depth_m = depth_m.abs().at_least(MIN_DEPTH_M);
        let (by_x, by_s, constant) = equations(at, &view.measured.xy);
        let r = view.measured.weight * (by_x * p_b0 + by_s * s + constant) / view.depth_m;
        let robust = 1.0 / (1.0 + r.norm_squared() / ROBUST_SIGMAS.squared());
        view.weight = if depth_m > 0.0 { robust } else { WEIGHT_BEHIND };
    }
}

/// The two equations of a view: derivatives by the point and by (v, g, a), and the constant.
fn equations(camera: &CameraAt, xy: &Vector2<f64>) -> (Matrix2x3<f64>, SMatrix<f64, 2, 9>, Vector2<f64>) {
    let across = Matrix2x3::new(1.0, 0.0, -xy.x, 0.0, 1.0, -xy.y) * camera.rot_c_b0;
    let mut by_s = SMatrix::<f64, 2, 9>::zeros();
    by_s.fixed_columns_mut::<3>(0).copy_from(&(across * -camera.dt));
    by_s.fixed_columns_mut::<3>(3).copy_from(&(across * (-0.5 * camera.dt * camera.dt)));
    by_s.fixed_columns_mut::<3>(6).copy_from(&(across * -camera.by_bias));
    (across, by_s, -(across * camera.p_constant))
}

/// `H s = -g` with gravity, in the middle of `s`, on the sphere of radius `gravity_m_s2`: first without, then on
/// the tangent plane.
fn constrained(h: &SMatrix<f64, 9, 9>, g: &Nine, gravity_m_s2: f64) -> Option<Nine> {
    let mut s = -(h.cholesky()?.solve(g));
    for _ in 0..GRAVITY_ROUNDS {
        let direction = s.fixed_rows::<3>(3).try_normalize(1e-6)?;
        let helper = if direction.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let a = direction.cross(&helper).normalize();
        let b = direction.cross(&a);
        let mut basis = SMatrix::<f64, 9, 8>::zeros();
        basis.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        basis.fixed_view_mut::<3, 1>(3, 3).copy_from(&a);
        basis.fixed_view_mut::<3, 1>(3, 4).copy_from(&b);
        basis.fixed_view_mut::<3, 3>(6, 5).fill_with_identity();
        let mut offset = Nine::zeros();
        offset.fixed_rows_mut::<3>(3).copy_from(&(direction * gravity_m_s2));
        let reduced = basis.tr_mul(&(h * basis));
        let w = -(reduced.cholesky()?.solve(&basis.tr_mul(&(g + h * offset))));
        s = offset + basis * w;
    }
    let direction = s.fixed_rows::<3>(3).normalize() * gravity_m_s2;
    s.fixed_rows_mut::<3>(3).copy_from(&direction);
    s.iter().all(|x| x.is_finite()).then_some(s)
}
