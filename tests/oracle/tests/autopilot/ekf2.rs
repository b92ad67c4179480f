//! PX4's EKF2 as an autopilot runs it with our parameters (`docs/rigs/autopilots.md`), fed by a capture.

use super::capture::Captured;
use ekf2::params::{ExternalVisionControl, HeightReference};
use ekf2::types::{ExtVisionSample, ImuSample};
use ekf2::{Ekf, EkfConfig};
use mavlink::dialects::common::ODOMETRY_DATA;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use std::f64::consts::PI;

/// Parameters of `docs/rigs/autopilots.md`.
const NOISE_M: f32 = 0.05;
const NOISE_M_S: f32 = 0.05;
/// Smallest that PX4 allows; EKF2 of 2025 takes it for a variance.
const NOISE_YAW: f32 = 0.05;
const MIN_QUALITY: i32 = 1;
/// Time for which the vehicle stands before the flight, s: an autopilot finds its tilt so.
const REST_S: f64 = 20.0;
/// Added to all stamps, so that those before the flight are positive too, us.
const LATER_US: i64 = 100_000_000;

/// EKF2 at one inertial sample, against the truth.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    pub stamp: Timestamp,
    /// True while messages that track come, by the newest one sent.
    pub is_tracked: bool,
    /// Error of the velocity in the axes of the body, m/s.
    pub velocity_m_s: f64,
    /// Yaw against the truth in LOCAL_FRD, degrees.
    pub yaw_deg: f64,
    /// Position in LOCAL_FRD against the truth, brought there by the first message, m.
    pub position_m: f64,
}

/// FilterRun of EKF2 through a flight.
pub struct FilterRun {
    pub judged: Vec<Judged>,
    /// Measurements of position, height, velocity and yaw that it took, and that it rejected.
    pub fused: usize,
    pub rejected: usize,
}

/// Messages with the true velocity in place of the estimated: what EKF2 makes of a flight by itself.
pub fn with_true_velocity(captured: &Captured) -> Vec<(Timestamp, ODOMETRY_DATA)> {
    let rot_f_b = rot_f_b(captured);
    let exact = |(sent, m): &(Timestamp, ODOMETRY_DATA)| {
        let truth = captured.simulator.ground_truth(Timestamp::from_nanos(m.time_usec as i64 * 1000));
        let v_f = rot_f_b * (truth.pose_w_b.rotation.inverse() * truth.v_w_b);
        let [vx, vy, vz] = v_f.map(|x| x as f32).into();
        (*sent, if m.quality > 0 { ODOMETRY_DATA { vx, vy, vz, ..m.clone() } } else { m.clone() })
    };
    captured.messages.iter().map(exact).collect()
}

/// Runs EKF2 over a flight; it believes that vision is late by `delay_ms`.
pub fn run(captured: &Captured, messages: &[(Timestamp, ODOMETRY_DATA)], delay_ms: f64) -> FilterRun {
    let mut filter = filter();
    rest(&mut filter, captured);
    let mut course = FilterRun { judged: Vec::new(), fused: 0, rejected: 0 };
    let rot_f_b = rot_f_b(captured);
    let bias_gyro = captured.simulator.ground_truth(captured.samples[0].stamp).bias_gyro;
    let mut waiting = messages.iter().peekable();
    let (mut origin, mut is_tracked, mut seen) = (None, false, [0u64; 4]);
    for pair in captured.samples.windows(2) {
        let stamp = pair[1].stamp;
        while let Some((_, message)) = waiting.next_if(|(sent, _)| *sent <= stamp) {
            is_tracked = message.quality > 0;
            if is_tracked && origin.is_none() {
                origin = Some(Origin::of(captured, message));
            }
            filter.set_ev_data(&sample(message, delay_ms));
        }
        filter.set_imu_data(&imu(pair, &bias_gyro, &rot_f_b));
        if !filter.update() {
            continue;
        }
        count(&filter, &mut seen, &mut course);
        if let Some(origin) = &origin {
            course.judged.push(origin.judge(captured, &filter, stamp, is_tracked));
        }
    }
    course
}

/// EKF2 with the parameters of the document, without data.
pub fn filter() -> Ekf<'static> {
    let mut filter = Ekf::with_config(EkfConfig::default()).unwrap();
    let mut params = filter.params_mut();
    params.set_ev_ctrl(ExternalVisionControl::all());
    params.set_hgt_ref(HeightReference::ExternalVision);
    params.set_ev_delay_ms(0.0);
    params.set_ev_pos_noise(NOISE_M);
    params.set_ev_vel_noise(NOISE_M_S);
    params.set_ev_att_noise(NOISE_YAW);
    params.set_ev_quality_min(MIN_QUALITY);
    filter
}

/// The vehicle stands level in its first heading before the flight, and is then in the air.
fn rest(filter: &mut Ekf<'_>, captured: &Captured) {
    let first = captured.samples[0].stamp;
    let truth = captured.simulator.ground_truth(first);
    let rot_f_b = rot_f_b(captured);
    let dt_s = 1.0 / captured.config.imu.rate_hz;
    let up_f = -Vector3::z() * captured.config.imu.gravity_m_s2;
    let turn = [0.0; 3];
    let push: [f32; 3] = ((up_f + rot_f_b * truth.bias_accel) * dt_s).map(|x| x as f32).into();
    filter.set_in_air_status(false);
    filter.set_vehicle_at_rest(true);
    for k in (0..(REST_S / dt_s) as i64).rev() {
        let time_us = stamp_us(first.plus_seconds(-dt_s * k as f64));
        filter.set_imu_data(&ImuSample::new(time_us, turn, push, dt_s as f32, dt_s as f32));
        filter.update();
    }
    filter.set_vehicle_at_rest(false);
    filter.set_in_air_status(true);
}

/// A stamp on the clock of the filter, us.
pub fn stamp_us(stamp: Timestamp) -> u64 {
    (stamp.as_nanos() / 1000 + LATER_US) as u64
}

/// Sample that PX4 makes of a message before EKF2: variances are at least the noise of the parameters.
pub fn sample(m: &ODOMETRY_DATA, delay_ms: f64) -> ExtVisionSample {
    let at_least =
        |covariance: &[f32], places: [usize; 3], floor: f32| places.map(|k| covariance[k].max(floor));
    let time_us = (m.time_usec as i64 + LATER_US - (1e3 * delay_ms) as i64) as u64;
    let mut sample = ExtVisionSample::new(
        time_us,
        [m.x, m.y, m.z],
        m.q,
        [m.vx, m.vy, m.vz],
        at_least(&m.pose_covariance, [0, 6, 11], NOISE_M * NOISE_M),
        at_least(&m.pose_covariance, [15, 18, 20], NOISE_YAW * NOISE_YAW),
        at_least(&m.velocity_covariance, [0, 6, 11], NOISE_M_S * NOISE_M_S),
    );
    sample.reset_counter = m.reset_counter;
    sample.quality = m.quality;
    sample
}

/// Turns what the IMU measured between two samples into the vehicle's axes. PX4 calibrates the gyroscope whenever the vehicle
/// stands (`gyro_calibration`): `bias` is what that found.
fn imu(
    pair: &[plumbline_config::ImuSample],
    bias: &Vector3<f64>,
    rot_f_b: &UnitQuaternion<f64>,
) -> ImuSample {
    let dt_s = pair[1].stamp.seconds_since(pair[0].stamp);
    let mean = |a: &Vector3<f64>, b: &Vector3<f64>| -> [f32; 3] {
        (rot_f_b * ((a + b) * (0.5 * dt_s))).map(|x| x as f32).into()
    };
    let turn = mean(&(pair[0].gyro - bias), &(pair[1].gyro - bias));
    let push = mean(&pair[0].accel, &pair[1].accel);
    ImuSample::new(stamp_us(pair[1].stamp), turn, push, dt_s as f32, dt_s as f32)
}

fn rot_f_b(captured: &Captured) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI) * captured.config.vehicle.rot_v_b().unwrap()
}

/// Counts measurements as they are new.
fn count(filter: &Ekf<'_>, seen: &mut [u64; 4], course: &mut FilterRun) {
    let (position, height) = (filter.aid_src_ev_pos(), filter.aid_src_ev_hgt());
    let (velocity, yaw) = (filter.aid_src_ev_vel(), filter.aid_src_ev_yaw());
    let all = [
        (position.timestamp_sample, position.fused, position.innovation_rejected),
        (height.timestamp_sample, height.fused, height.innovation_rejected),
        (velocity.timestamp_sample, velocity.fused, velocity.innovation_rejected),
        (yaw.timestamp_sample, yaw.fused, yaw.innovation_rejected),
    ];
    for ((stamp, fused, rejected), seen) in all.into_iter().zip(seen) {
        if stamp != std::mem::replace(seen, stamp) {
            course.fused += usize::from(fused != 0);
            course.rejected += usize::from(rejected != 0);
        }
    }
}

/// From the simulated world to LOCAL_FRD: the truth lies on the first pose that was sent.
struct Origin {
    pose_l_w: nalgebra::Isometry3<f64>,
    rot_f_b: UnitQuaternion<f64>,
}

impl Origin {
    fn of(captured: &Captured, m: &ODOMETRY_DATA) -> Self {
        let rot_f_b = rot_f_b(captured);
        let stamp = Timestamp::from_nanos(m.time_usec as i64 * 1000);
        let truth_w_b = captured.simulator.ground_truth(stamp).pose_w_b;
        let truth_w_f = truth_w_b * rot_f_b.inverse();
        let position = Vector3::new(m.x, m.y, m.z).map(f64::from);
        // Level already: yaw alone differs, and which way is down.
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let told = rotation(m.q);
        let turn = yaw_of(&told) - yaw_of(&(down * truth_w_f.rotation));
        let rot_l_w = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn) * down;
        let shift = position - rot_l_w * truth_w_b.translation.vector;
        Self { pose_l_w: nalgebra::Isometry3::from_parts(shift.into(), rot_l_w), rot_f_b }
    }

    fn judge(&self, captured: &Captured, filter: &Ekf<'_>, stamp: Timestamp, is_tracked: bool) -> Judged {
        let truth = captured.simulator.ground_truth(stamp);
        let (rot_l_f, v_l) = (rotation(filter.quaternion()), vector(filter.velocity_ned()));
        let v_f = self.rot_f_b * (truth.pose_w_b.rotation.inverse() * truth.v_w_b);
        let truth_l_f = self.pose_l_w.rotation * truth.pose_w_b.rotation * self.rot_f_b.inverse();
        let p_l = self.pose_l_w * nalgebra::Point3::from(truth.pose_w_b.translation.vector);
        Judged {
            stamp,
            is_tracked,
            velocity_m_s: (rot_l_f.inverse() * v_l - v_f).norm(),
            yaw_deg: wrapped(yaw_of(&rot_l_f) - yaw_of(&truth_l_f)).to_degrees(),
            position_m: (vector(filter.position_ned()) - p_l.coords).norm(),
        }
    }
}

fn rotation([w, x, y, z]: [f32; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z).cast())
}

fn vector(v: [f32; 3]) -> Vector3<f64> {
    Vector3::from(v).cast()
}

/// Yaw of a vehicle whose x is its nose, rad.
fn yaw_of(rotation: &UnitQuaternion<f64>) -> f64 {
    rotation.euler_angles().2
}

fn wrapped(angle: f64) -> f64 {
    let turns = ((angle + PI) / (2.0 * PI)).floor();
    angle - 2.0 * PI * turns
}
