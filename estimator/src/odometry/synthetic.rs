//! A world of points for tests: a smooth flight, exact or noisy IMU, and points as a perfect front-end
//! would track them.

use crate::geometry::{exp_so3, log_so3};
use crate::points::PointObservation;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::camera::Distortion;
use plumbline_config::options::{CameraConfig, ImuConfig};
use plumbline_config::{CameraModel, EstimatorSetup, ImuSample, Timestamp, ValidSetup};

/// Repeatable normal noise.
pub struct Normal(pub u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn next(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    pub fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next()) * sigma
    }
}

/// A rig like that of EuRoC, without distortion.
pub fn config(cameras: usize) -> ValidSetup {
    let camera = |y: f64| CameraConfig {
        width_px: 752,
        height_px: 480,
        rate_hz: 20.0,
        readout_s: 0.0,
        exposure_s: 0.0,
        mask: None,
        focal_px: [458.0, 457.0],
        centre_px: [367.0, 248.0],
        distortion: Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
        // Looks along the body's x axis: camera z is body x, camera x is body -y, camera y is body -z.
        pose_b_c: [[0.0, 0.0, 1.0, 0.05], [-1.0, 0.0, 0.0, y], [0.0, -1.0, 0.0, 0.01], [0.0, 0.0, 0.0, 1.0]],
    };
    let camera = [0.055, -0.055][..cameras].iter().map(|y| camera(*y)).collect();
    let noise = ((1.7e-4, 2e-5), (2e-3, 3e-3));
    let imu = ImuConfig {
        gyro_error_sigma_rad_s: 0.0,
        accel_error_sigma_m_s2: 0.0,
        error_time_s: 1.5,
        gyro_scale_sigma: 0.0,
        accel_scale_sigma: 0.0,
        gyro_range_rad_s: 17.0,
        accel_range_m_s2: 150.0,
        accel_bias_sigma_m_s2: 0.1,
        ..ImuConfig::with_noise(200.0, noise.0, noise.1)
    };
    EstimatorSetup::new(camera, imu).validate().expect("is good")
}

/// A flight through a box of points.
pub struct World {
    pub config: ValidSetup,
    pub points_o: Vec<Vector3<f64>>,
    pub bias_gyro: Vector3<f64>,
    pub bias_accel: Vector3<f64>,
    pub sigma_px: f64,
    /// Correlation of the errors of a point in frames on end.
    pub error_correlation: f64,
    /// Errors of each point in the last frame, px.
    errors_px: Vec<[Vector2<f64>; 2]>,
    pub is_at_rest: bool,
    /// Velocity of what is not quite at rest, m/s: reached at 5 s.
    pub drift_m_s: Vector3<f64>,
    /// Constant velocity of the whole flight, m/s, in place of the path that swings.
    pub cruise_m_s: Option<Vector3<f64>>,
    /// True time offset, `t_imu - t_camera`, s.
    pub time_offset_s: f64,
    /// True readout of the cameras, and that by which points are turned to the times of their frames, s.
    pub readout_s: f64,
    pub known_readout_s: f64,
    /// True poses of the cameras in the body.
    pub pose_b_c: Vec<Isometry3<f64>>,
    pub normal: Normal,
    /// Number of the next inertial sample.
    pub next_imu: u32,
    cameras: Vec<CameraModel>,
}

impl World {
    pub fn new(config: &ValidSetup, seed: u64, points: usize) -> Self {
        let mut normal = Normal(seed);
        let mut points_o = Vec::new();
        while points_o.len() < points {
            let p = Vector3::new(
                normal.uniform() * 16.0 - 8.0,
                normal.uniform() * 16.0 - 8.0,
                normal.uniform() * 8.0 - 4.0,
            );
            // A shell of points around the flight, nothing closer than the near side of a room.
            if p.x.abs() > 4.5 || p.y.abs() > 4.5 {
                points_o.push(p);
            }
        }
        Self {
            errors_px: Vec::new(),
            points_o,
            bias_gyro: normal.vector(0.03),
            bias_accel: normal.vector(0.05),
            sigma_px: 0.3,
            error_correlation: 0.0,
            is_at_rest: false,
            drift_m_s: Vector3::zeros(),
            cruise_m_s: None,
            time_offset_s: 0.0,
            readout_s: 0.0,
            known_readout_s: 0.0,
            pose_b_c: config.camera.iter().map(CameraConfig::pose_b_c).collect(),
            cameras: config.camera.iter().map(CameraConfig::model).collect(),
            config: config.clone(),
            normal,
            next_imu: 0,
        }
    }

    /// True pose of the body.
    pub fn pose_o_b(&self, t: f64) -> Isometry3<f64> {
        if let Some(v) = self.cruise_m_s {
            let way = v * t;
            return Isometry3::translation(way.x, way.y, way.z) * swung(0.0);
        }
        if self.is_at_rest {
            // Speeds up evenly from 2 s to 5 s.
            let (ramp_s, since_s) = ((t - 2.0).clamp(0.0, 3.0), (t - 5.0).max(0.0));
            let way = self.drift_m_s * (ramp_s * ramp_s / 6.0 + since_s);
            return Isometry3::translation(way.x, way.y, way.z) * swung(0.0);
        }
        swung(t)
    }

    /// The inertial sample at `t`, with biases and noise.
    pub fn imu(&mut self, t: f64, with_noise: bool) -> ImuSample {
        let h = 1e-4;
        let (before, now, after) = (self.pose_o_b(t - h), self.pose_o_b(t), self.pose_o_b(t + h));
        let acceleration =
            (after.translation.vector - now.translation.vector * 2.0 + before.translation.vector) / (h * h);
        let rate = log_so3(&(before.rotation.inverse() * after.rotation)) / (2.0 * h);
        let imu = &self.config.imu;
        let root_rate = imu.rate_hz.sqrt() * if with_noise { 1.0 } else { 0.0 };
        let (gyro_sigma, accel_sigma) =
            (imu.gyro_noise_density * root_rate, imu.accel_noise_density * root_rate);
        ImuSample {
            stamp: stamp(t),
            gyro: rate + self.bias_gyro + self.normal.vector(gyro_sigma),
            accel: now.rotation.inverse() * (acceleration + Vector3::z() * 9.81)
                + self.bias_accel
                + self.normal.vector(accel_sigma),
        }
    }

    /// True velocity of the body in its axes, m/s.
    pub fn v_b(&self, t: f64) -> Vector3<f64> {
        let way = self.pose_o_b(t + 1e-3).translation.vector - self.pose_o_b(t - 1e-3).translation.vector;
        self.pose_o_b(t).rotation.inverse() * (way / 2e-3)
    }

    /// The inertial samples since the last call that a frame at `t` has to have: up to the first one after it.
    pub fn samples_to(&mut self, t: f64) -> Vec<ImuSample> {
        let mut samples = Vec::new();
        while f64::from(self.next_imu) * 0.005 <= t + 0.0051 {
            samples.push(self.imu(f64::from(self.next_imu) * 0.005, true));
            self.next_imu += 1;
        }
        samples
    }

    /// The points seen by the cameras in the frame stamped `t` by the camera's clock.
    pub fn observe(&mut self, t: f64, cameras_alive: [bool; 2]) -> Vec<PointObservation> {
        let pose_o_b = self.pose_o_b(t + self.time_offset_s);
        let limit = self.config.estimator.points.max_points;
        let mut seen = Vec::new();
        self.errors_px.resize(self.points_o.len(), Default::default());
        for id in 0..self.points_o.len() {
            let mut o = PointObservation {
                track_id: id as u32,
                age: 1,
                px: [None; 2],
                xy: [None; 2],
                covariance_px2: Default::default(),
            };
            for (c, alive) in cameras_alive.into_iter().enumerate().take(self.cameras.len()) {
                let seen_from = |pose_o_b: &Isometry3<f64>| {
                    let p_c =
                        (pose_o_b * self.pose_b_c[c]).inverse() * nalgebra::Point3::from(self.points_o[id]);
                    self.cameras[c].project(&p_c.coords)
                };
                let Some(mut px) = seen_from(&pose_o_b) else { continue };
                if self.readout_s > 0.0 {
                    let late_s = self.readout_s * (px.y / (self.cameras[c].height_px as f64 - 1.0) - 0.5);
                    let Some(by_row) = seen_from(&self.pose_o_b(t + self.time_offset_s + late_s)) else {
                        continue;
                    };
                    px = by_row;
                }
                let noise = Vector2::new(self.normal.next(), self.normal.next()) * self.sigma_px;
                let (error, rho) = (&mut self.errors_px[id][c], self.error_correlation);
                *error = *error * rho + noise * (1.0 - rho * rho).sqrt();
                let px = px + *error;
                if self.cameras[c].contains(&px, 5.0) && alive {
                    let late_s =
                        self.known_readout_s * (px.y / (self.cameras[c].height_px as f64 - 1.0) - 0.5);
                    let by_row = self.pose_o_b(t + self.time_offset_s + late_s) * self.pose_b_c[c];
                    let turn = (pose_o_b * self.pose_b_c[c]).rotation.inverse() * by_row.rotation;
                    let turned = |xy: Vector2<f64>| turn * nalgebra::Vector3::new(xy.x, xy.y, 1.0);
                    o.px[c] = Some(px);
                    o.xy[c] = self.cameras[c].unproject(&px).map(|xy| turned(xy).xy() / turned(xy).z);
                }
            }
            if o.px.iter().any(Option::is_some) && seen.len() < limit {
                seen.push(o);
            }
        }
        seen
    }
}

/// The pose on a path that swings and turns.
fn swung(t: f64) -> Isometry3<f64> {
    let p = Vector3::new(1.5 * (0.9 * t).sin(), 1.5 * (0.7 * t).cos() - 1.5, 0.5 * (1.3 * t).sin());
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.8 * (0.4 * t).sin() + 0.2 * t);
    let tilt = exp_so3(&Vector3::new(0.15 * (1.1 * t).sin(), 0.12 * (1.7 * t).cos(), 0.0));
    Isometry3::from_parts(Translation3::from(p), yaw * tilt)
}

/// A stamp `t` seconds after an arbitrary origin.
pub fn stamp(t: f64) -> Timestamp {
    Timestamp::from_nanos(1_000_000_000_000).plus_seconds(t)
}
