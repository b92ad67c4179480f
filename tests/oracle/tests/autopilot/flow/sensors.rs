//! Measurements of the flight, and the bridge's messages of it.

use super::motion::Truth;
use crate::autopilot::ekf2::stamp_us;
use ekf2::types::ImuSample as PxImuSample;
use mavlink::dialects::common::{DISTANCE_SENSOR_DATA, MavFrame, ODOMETRY_DATA, OPTICAL_FLOW_RAD_DATA};
use nalgebra::{Matrix2, Point3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::options::{FlowMessages, VehicleConfig};
use plumbline_config::{Config, ImuSample, Timestamp, ValidConfig};
use plumbline_estimator::points::PointObservation;
use plumbline_flight::autopilot::flow::FlowMeter;
use plumbline_flight::autopilot::message;
use plumbline_flight::autopilot::status::FlowSwitch;
use plumbline_flight::schedule::ticker::Monotonic;
use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, PI};

const GRAVITY_M_S2: f64 = 9.80665;
const BIAS_GYRO: [f64; 3] = [0.002, -0.003, 0.001];
const BIAS_ACCEL: [f64; 3] = [0.05, -0.04, 0.03];
/// Change of the accelerometer's bias as the odometry is lost: 0.07 m/s².
const BIAS_CHANGE: [f64; 3] = [0.05, 0.05, 0.0];
/// A message arrives this long after its frame, and up to a tick of 40 Hz later, s.
const LATE_S: f64 = 0.0075;
const TICK_S: f64 = 0.025;

/// Numbers of zero mean and standard deviation one, the same on every run.
pub struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number between 0 and 1.
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * self.next())
    }
}

/// Angular rate without bias, which PX4 calibrates while the vehicle stands, and specific force, in the axes of the vehicle.
pub struct Measured {
    rate_f: Vector3<f64>,
    force_f: Vector3<f64>,
}

pub fn measured(truth: &Truth, is_lost: bool, noise: &mut Noise) -> Measured {
    let force_f = truth.rot_l_f.inverse() * (truth.a - Vector3::z() * GRAVITY_M_S2);
    let change = if is_lost { Vector3::from(BIAS_CHANGE) } else { Vector3::zeros() };
    Measured {
        rate_f: truth.rate_f + noise.vector(0.002),
        force_f: force_f + Vector3::from(BIAS_ACCEL) + change + noise.vector(0.05),
    }
}

pub fn imu_sample(at: Timestamp, measured: &Measured, dt_s: f64) -> PxImuSample {
    let [turn, push] =
        [measured.rate_f, measured.force_f].map(|x| <[f32; 3]>::from((x * dt_s).map(|x| x as f32)));
    PxImuSample::new(stamp_us(at), turn, push, dt_s as f32, dt_s as f32)
}

/// The `sim` rig in a vehicle whose down is where its left camera looks.
pub fn down_facing() -> ValidConfig {
    let config = Config::preset("sim").unwrap();
    let rot_v_c = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_2)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let (roll, pitch, yaw) = (rot_v_c * config.camera[0].pose_b_c().rotation.inverse()).euler_angles();
    let mounting = VehicleConfig::mounted([roll, pitch, yaw].map(f64::to_degrees));
    config.with("test", |c| c.vehicle = mounting).unwrap()
}

/// Odometry of the bridge: 1 cm and 2 cm/s of noise, or lost.
pub fn odometry(truth: &Truth, at: Timestamp, is_lost: bool, noise: &mut Noise) -> ODOMETRY_DATA {
    let (p, v) = (truth.p + noise.vector(0.01), truth.rot_l_f.inverse() * truth.v + noise.vector(0.02));
    let q = truth.rot_l_f;
    let (variance, quality) = if is_lost { (1e6, -1) } else { (1e-4, 90) };
    let mut covariance = [0.0; 21];
    for k in [0, 6, 11, 15, 18, 20] {
        covariance[k] = variance;
    }
    let [x, y, z] = p.map(|x| x as f32).into();
    let [vx, vy, vz] = if is_lost { [0.0; 3] } else { v.map(|x| x as f32).into() };
    ODOMETRY_DATA {
        time_usec: (at.as_nanos() / 1000) as u64,
        frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        x,
        y,
        z,
        q: [q.w, q.i, q.j, q.k].map(|x| x as f32),
        vx,
        vy,
        vz,
        pose_covariance: covariance,
        velocity_covariance: covariance,
        quality,
        ..ODOMETRY_DATA::default()
    }
}

/// Height by the barometer: 0.2 m of noise, and a pressure that drifts by 1 cm/s.
pub fn barometer_m(t: f64, truth: &Truth, noise: &mut Noise) -> f64 {
    0.01 * t - truth.p.z + 0.2 * noise.next()
}

type Arriving = (Timestamp, Option<OPTICAL_FLOW_RAD_DATA>, Option<DISTANCE_SENSOR_DATA>);

/// The bridge's flow of a camera over a floor, and the way of its messages.
pub struct Bridge {
    config: ValidConfig,
    rot_f_b: UnitQuaternion<f64>,
    meter: FlowMeter,
    flow: FlowMessages,
    switch: FlowSwitch,
    on_the_way: VecDeque<Arriving>,
}

impl Bridge {
    pub fn new(config: &ValidConfig, flow: FlowMessages) -> Self {
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        Self {
            config: config.clone(),
            rot_f_b: half_turn * config.vehicle.rot_v_b().unwrap(),
            meter: FlowMeter::new(config.setup(), &config.vehicle).unwrap(),
            flow,
            switch: FlowSwitch::new(flow),
            on_the_way: VecDeque::new(),
        }
    }

    /// Sample of the rig's own IMU, whose gyroscope has a bias.
    pub fn in_body(&self, stamp: Timestamp, measured: &Measured) -> ImuSample {
        let gyro = self.rot_f_b.inverse() * (measured.rate_f + Vector3::from(BIAS_GYRO));
        ImuSample { stamp, gyro, accel: self.rot_f_b.inverse() * measured.force_f }
    }

    /// Measures a frame at `at`, and sends its distance, and its flow as the switch wants.
    pub fn frame(
        &mut self,
        at: Timestamp,
        truth: &Truth,
        samples: &[ImuSample],
        is_usable: bool,
        noise: &mut Noise,
    ) {
        let points = self.seen(truth, noise);
        let bias_b = self.rot_f_b.inverse() * Vector3::from(BIAS_GYRO);
        let measured = self.meter.measure(at, &points, samples, &bias_b);
        self.switch.update(is_usable, Monotonic(at.as_nanos()));
        let Some(measured) = measured else { return };
        let usec = (at.as_nanos() / 1000) as u64;
        let flow = self.switch.is_on().then(|| message::flow_rad(&measured, usec));
        let has_distance = self.flow != FlowMessages::Off;
        let distance =
            measured.distance.filter(|_| has_distance).map(|distance| message::distance(&distance, usec));
        let arrival = at.plus_seconds(LATE_S + TICK_S * noise.uniform());
        self.on_the_way.push_back((arrival, flow, distance));
    }

    /// Messages that have arrived by `now`.
    pub fn arrived(&mut self, now: Timestamp) -> Option<Arriving> {
        let has_arrived = self.on_the_way.front().is_some_and(|(arrival, ..)| *arrival <= now);
        if has_arrived { self.on_the_way.pop_front() } else { None }
    }

    /// Points of the floor that both cameras see, with half a pixel of noise.
    fn seen(&self, truth: &Truth, noise: &mut Noise) -> Vec<PointObservation> {
        let cameras = &self.config.camera;
        let rot_l_c = truth.rot_l_f * self.rot_f_b * cameras[0].pose_b_c().rotation;
        let pose_c0_c1 = cameras[0].pose_b_c().inverse() * cameras[1].pose_b_c();
        let centre = (truth.p.x / 0.25).round() as i64;
        let mut points = Vec::new();
        for (k, j) in (centre - 8..=centre + 8).flat_map(|k| (-8..=8_i64).map(move |j| (k, j))) {
            let p_l = Vector3::new(0.25 * k as f64, 0.25 * j as f64, 0.0);
            let p_c0 = Point3::from(rot_l_c.inverse() * (p_l - truth.p));
            let p_c1 = pose_c0_c1.inverse() * p_c0;
            let is_seen = p_c0.z > 0.1 && (p_c0.x / p_c0.z).abs() < 0.7 && (p_c0.y / p_c0.z).abs() < 0.5;
            if is_seen && points.len() < 150 {
                let mut xy = |p: Point3<f64>| {
                    Some(Vector2::new(p.x / p.z + 0.001 * noise.next(), p.y / p.z + 0.001 * noise.next()))
                };
                points.push(PointObservation {
                    track_id: (20 * (k + 100) + j + 8) as u32,
                    age: 2,
                    px: [None; 2],
                    xy: [xy(p_c0), xy(p_c1)],
                    covariance_px2: [Matrix2::zeros(); 2],
                });
            }
        }
        points
    }
}
