//! A window over a small room, all kinds of factors at work, for the tests of the solver.

use super::line::LineMeasurement;
use super::prior::{AnchorSigmas, AnchorState};
use super::reprojection::PointMeasurement;
use super::seen_by_row::SeenByRow;
use super::state::{FRAME_DIM, FrameTime, NavState, RIG_DIM, Rig, unknown_of_frame};
use super::{LineTrack, PointTrack, TrackMeasurement, Window};
use crate::geometry::{exp_so3, log_so3};
use crate::inertial::Preintegration;
use nalgebra::{DMatrix, Isometry3, Matrix2, Matrix3, Rotation3, SVector, UnitQuaternion, Vector2, Vector3};
use plumbline_config::{Config, Timestamp};

/// Heading of the room's walls in `O`, rad.
const HEADING_RAD: f64 = 0.4;
/// Time between two frames, s.
const INTERVAL_S: f64 = 0.3;
/// Steps of integration between two frames.
const IMU_STEPS: usize = 60;
const POINTS: u32 = 24;
const EDGES: u32 = 22;
/// Biases that the IMU has, rad/s and m/s².
const BIAS_GYRO: Vector3<f64> = Vector3::new(0.01, -0.02, 0.015);
const BIAS_ACCEL: Vector3<f64> = Vector3::new(0.05, 0.02, -0.04);

/// Repeatable numbers in -1..1, of no pattern that a test could depend on.
pub fn scatter(k: u32) -> f64 {
    let mixed = k.wrapping_add(0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0xc2b2_ae35);
    f64::from(mixed ^ (mixed >> 16)) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// A step of `N` unknowns of size `scale`.
pub fn scatter_step<const N: usize>(seed: u32, scale: f64) -> SVector<f64, N> {
    SVector::from_fn(|k, _| scale * scatter(seed.wrapping_mul(1009).wrapping_add(k as u32)))
}

/// Contents of the test's window.
#[derive(Clone, Copy)]
pub struct Room {
    /// Frames, all of them keyframes.
    pub frames: usize,
    /// Visibility of a track in a frame, by camera.
    pub sees: fn(track_id: u32, frame: usize) -> [bool; 2],
    /// Errors of the states, and of the measurements with them, in standard deviations or so.
    pub disturbance: f64,
    /// True if the first pose is known.
    pub is_anchored: bool,
    /// Standard deviation of its tilt, rad.
    pub tilt_rad: f64,
    /// True if the intrinsics of the cameras are unknowns.
    pub refines_intrinsics: bool,
}

impl Default for Room {
    fn default() -> Self {
        Self {
            frames: 5,
            sees: by_and_by,
            disturbance: 1.0,
            is_anchored: true,
            tilt_rad: 0.1,
            refines_intrinsics: true,
        }
    }
}

/// Every fourth track is seen later than the first frame, every fifth by the right camera alone where it begins,
/// and some are missed now and then.
pub fn by_and_by(track_id: u32, frame: usize) -> [bool; 2] {
    let begins = if track_id % 4 == 3 { 1 + track_id as usize % 2 } else { 0 };
    let is_missed = frame > begins && (track_id as usize + 3 * frame).is_multiple_of(7);
    let is_seen = frame >= begins && !is_missed;
    [is_seen && !(track_id.is_multiple_of(5) && frame == begins), is_seen]
}

/// Every track is seen by both cameras in every frame.
pub fn always(_track_id: u32, _frame: usize) -> [bool; 2] {
    [true; 2]
}

/// True pose of the body, of a rig whose left camera looks along x of `O`.
fn pose_o_b(rig: &Rig, t: f64) -> Isometry3<f64> {
    let look = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0));
    let level = UnitQuaternion::from_rotation_matrix(&look) * rig.pose_b_c(0).rotation.inverse();
    let phi = Vector3::new(0.25 * (2.1 * t).sin(), 0.2 * (1.7 * t + 0.5).sin(), 0.3 * (1.3 * t).sin());
    let p = Vector3::new(0.3 * (2.3 * t).sin(), 0.5 * (1.9 * t + 0.3).sin(), 0.3 * (2.9 * t + 1.0).sin());
    Isometry3::from_parts(p.into(), level * exp_so3(&phi))
}

/// True state at `t`.
pub fn truth(rig: &Rig, t: f64) -> NavState {
    const H: f64 = 1e-5;
    let p = |t: f64| pose_o_b(rig, t).translation.vector;
    NavState {
        p_o_b: p(t),
        rot_o_b: pose_o_b(rig, t).rotation,
        v_o_b: (p(t + H) - p(t - H)) / (2.0 * H),
        bias_gyro: BIAS_GYRO,
        bias_accel: BIAS_ACCEL,
    }
}

/// The motion from `t` on as the IMU measures it, biased and integrated without biases.
fn motion(window: &Window, t: f64) -> Preintegration {
    const H: f64 = 1e-4;
    let zero = Vector3::zeros();
    let mut motion = Preintegration::new(&zero, &zero);
    let dt = INTERVAL_S / IMU_STEPS as f64;
    let force = |t: f64| {
        let at = |t: f64| pose_o_b(&window.rig, t);
        let [before, now, after] = [at(t - H), at(t), at(t + H)].map(|pose| pose.translation.vector);
        let acceleration = (after - now * 2.0 + before) / (H * H);
        at(t).rotation.inverse() * (acceleration - window.options.gravity_o) + BIAS_ACCEL
    };
    for k in 0..IMU_STEPS {
        let t = t + dt * k as f64;
        let turn = pose_o_b(&window.rig, t).rotation.inverse() * pose_o_b(&window.rig, t + dt).rotation;
        let gyro = log_so3(&turn) / dt + BIAS_GYRO;
        motion.integrate(dt, &gyro, &force(t), &force(t + dt), &window.imu_noise);
    }
    motion
}

/// A point of the room, m in `O`.
fn point(track_id: u32) -> Vector3<f64> {
    let s = |k: u32| scatter(31 * track_id + k);
    Vector3::new(4.0 + 1.5 * s(0), 2.0 * s(1), 1.3 * s(2))
}

/// Ends of an edge, m in `O`: verticals, edges along and across the heading, and some that lie anyhow.
fn edge(track_id: u32) -> [Vector3<f64>; 2] {
    let (sin, cos) = HEADING_RAD.sin_cos();
    let s = f64::from(track_id % 18) / 3.0;
    let z = if track_id.is_multiple_of(2) { 1.0 + 0.05 * s } else { -1.0 - 0.05 * s };
    let at = |z: f64| Vector3::new(3.0 + 0.3 * s, -1.0 + 0.4 * s, z);
    match track_id % 3 {
        _ if track_id >= 18 => {
            let from = at(0.3 * z);
            [from, from + Vector3::new(0.4, 0.5 - 0.3 * (s - 1.0), 0.7 * z)]
        }
        0 => [at(-0.5), at(0.5)],
        1 => [at(z), at(z) + Vector3::new(cos, sin, 0.0) * 0.8],
        _ => [at(z), at(z) + Vector3::new(-sin, cos, 0.0) * 0.6],
    }
}

/// Where a camera sees a point, in normalized coordinates.
fn project(pose_o_c: &Isometry3<f64>, p_o: &Vector3<f64>) -> Vector2<f64> {
    let q = pose_o_c.inverse_transform_point(&(*p_o).into());
    assert!(q.z > 0.2, "the room lies before the cameras");
    Vector2::new(q.x / q.z, q.y / q.z)
}

impl Room {
    /// The window: frames, landmarks with a depth, image rates predicted.
    pub fn window(&self) -> Window {
        let config = Config::preset("sim").expect("is good").with("test", |config| {
            let sigmas = if self.refines_intrinsics { (3e-3, 1.0) } else { (0.0, 0.0) };
            (config.rig.camera_focal_sigma, config.rig.camera_centre_sigma_px) = sigmas;
        });
        let mut window = Window::new(config.expect("is good").setup());
        window.clear();
        for k in 0..self.frames {
            let t = INTERVAL_S * k as f64;
            let inertial = (k > 0).then(|| motion(&window, t - INTERVAL_S));
            let stamp = Timestamp::from_nanos(1_000_000_000).plus_seconds(t);
            let nav = truth(&window.rig, t);
            window.push_frame(FrameTime { stamp, time_offset_s: 0.0 }, nav.clone(), inertial, false);
            let [before, after] = [-1e-4, 1e-4].map(|dt| truth(&window.rig, t + dt).rot_o_b);
            window.set_gyro_of_newest(log_so3(&(before.inverse() * after)) / 2e-4 + nav.bias_gyro);
            let (points, lines) = self.tracks(&window.rig, &nav, k);
            window.observe(&points, &lines);
            window.make_keyframe(&points, &lines);
            if k == 0 && self.is_anchored {
                let sigmas = AnchorSigmas {
                    position_m: 1e-3,
                    yaw_rad: 1e-3,
                    tilt_rad: self.tilt_rad,
                    velocity_m_s: 1.0,
                    bias_gyro_rad_s: 0.02,
                    bias_accel_m_s2: 0.1,
                };
                window.anchor_newest(&AnchorState::default(), &sigmas);
            }
        }
        window.triangulate(false);
        self.disturb(&mut window);
        window.predict_rates_from(0);
        window
    }

    /// Observations in frame `k`, with noise.
    pub fn tracks(&self, rig: &Rig, nav: &NavState, k: usize) -> (Vec<PointTrack>, Vec<LineTrack>) {
        let poses = [0, 1].map(|camera| nav.pose_o_b() * rig.pose_b_c(camera));
        let noise =
            |seed: u32| Vector2::new(scatter(seed), scatter(seed + 77_777)) * (self.disturbance / 1000.0);
        let seed = |track: u32, camera: usize| 2 * (500 * k as u32 + track) + camera as u32;
        let point_seen = |id: u32, camera: usize| PointMeasurement {
            xy: project(&poses[camera], &point(id)) + noise(seed(id, camera)),
            xy_rate: Vector2::zeros(),
            weight: Matrix2::new(500.0, 10.0, -20.0, 480.0),
            row: SeenByRow::default(),
        };
        let line_seen = |id: u32, camera: usize| LineMeasurement {
            ends_xy: edge(id).map(|p| project(&poses[camera], &p) + noise(seed(100 + id, camera))),
            rates: [0.0; 2],
            weights: [600.0, 550.0],
            rows: [SeenByRow::default(); 2],
        };
        let seen_by = |id: u32| (self.sees)(id, k);
        let points = (0..POINTS).map(|track_id| TrackMeasurement {
            track_id,
            measured: [0, 1].map(|c| seen_by(track_id)[c].then(|| point_seen(track_id, c))),
        });
        let lines = (0..EDGES).map(|track_id| TrackMeasurement {
            track_id,
            measured: [0, 1].map(|c| seen_by(track_id)[c].then(|| line_seen(track_id, c))),
        });
        (points.collect(), lines.collect())
    }

    fn disturb(&self, window: &mut Window) {
        let scale = 1e-3 * self.disturbance;
        for (k, frame) in (1..).zip(&mut window.frames) {
            frame.nav = frame.nav.plus(&scatter_step(k, scale));
        }
        let rig_step = scatter_step::<RIG_DIM>(90, scale).component_mul(&window.options.rig_mask);
        window.rig = window.rig.plus(&rig_step);
    }
}

/// The four directions which no measurement can see, as columns: position, and yaw of everything about gravity, at
/// the states of the Jacobians.
pub fn gauge(window: &Window) -> DMatrix<f64> {
    let mut directions = DMatrix::zeros(unknown_of_frame(window.frames.len()), 4);
    for (k, frame) in window.frames.iter().enumerate() {
        let nav = frame.jacobian_state(window.options.first_estimates);
        let at = unknown_of_frame(k);
        directions.view_mut((at + NavState::P, 0), (3, 3)).copy_from(&Matrix3::identity());
        let mut yaw = directions.column_mut(3);
        let up = Vector3::z();
        yaw.rows_mut(at + NavState::P, 3).copy_from(&up.cross(&nav.p_o_b));
        yaw.rows_mut(at + NavState::ROT, 3).copy_from(&(nav.rot_o_b.inverse() * up));
        yaw.rows_mut(at + NavState::V, 3).copy_from(&up.cross(&nav.v_o_b));
    }
    assert_eq!(directions.nrows(), RIG_DIM + FRAME_DIM * window.frames.len());
    directions
}
