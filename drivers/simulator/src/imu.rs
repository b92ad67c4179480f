//! The simulated inertial sensor: point samples at their stamps, never means over an interval.
//!
//! `gyro = omega_b + bias_g + n_g`, `accel = R_wb' (a_w - g_w) + bias_a + n_a` with
//! `g_w = (0, 0, -g)`; the discrete noise is `density * sqrt(rate)`, the biases walk by
//! `walk * sqrt(dt)` per sample. Readings beyond the sensor's range are clamped to it. Sample `k` is a
//! pure function of the seed and of `k`.
//!
//! Further errors of real sensors, each off by default ([`ImuEffects`]): `omega_b` becomes `M_g omega_b + S
//! f`, and the specific force `f` becomes `M_a f + c`, where `M_g` and `M_a` hold scale and misalignment, `S`
//! the sensitivity of the gyroscope to forces, and `c` is a Gauss-Markov process.

use super::samples::{Biases, Samples};
use super::trajectory::{MotionState, Trajectory};
use crate::random::{Draws, Purpose};
use nalgebra::{Matrix3, Vector3};
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};
use std::f64::consts::TAU;

/// One g of a data sheet, m/s².
const STANDARD_GRAVITY_M_S2: f64 = 9.80665;
/// Slow changes of the rotors' speed: periods, s.
const WANDER_PERIODS_S: [f64; 3] = [1.3, 2.9, 7.1];

/// Errors that the inertial sensor adds to the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuEffects {
    /// White noise, as a multiple of the configured densities; 0 for none.
    pub noise_scale: f64,
    /// Bias random walk, as a multiple of the configured densities; 0 for constant biases.
    pub bias_walk_scale: f64,
    /// Standard deviation of each component of the gyroscope bias at the start, rad/s.
    pub initial_bias_gyro_sigma_rad_s: f64,
    /// Standard deviation of each component of the accelerometer bias at the start, m/s².
    pub initial_bias_accel_sigma_m_s2: f64,
    /// Amplitude of the vibration felt by the accelerometer, m/s²; 0 for none.
    pub vibration_accel_m_s2: f64,
    /// Amplitude of the vibration felt by the gyroscope, rad/s; 0 for none.
    pub vibration_gyro_rad_s: f64,
    /// Frequency of the rotors, Hz; its first harmonic is present at half the amplitude.
    pub vibration_hz: f64,
    /// Standard deviation of that frequency over some seconds, relative.
    pub vibration_wander: f64,
    /// Standard deviation of the coloured error of each axis of the accelerometer, m/s²; 0 for none.
    pub force_sigma_m_s2: f64,
    /// Time in which the correlation of that error falls to 1/e, s.
    pub force_time_s: f64,
    /// Scale error of every axis of both sensors, relative; the signs are drawn.
    pub scale_error: f64,
    /// Angle by which every axis of both sensors is tilted, rad; the directions are drawn.
    pub misalignment_rad: f64,
    /// Sensitivity of every gyroscope axis to a force along a drawn direction, rad/s per g.
    pub g_sensitivity_rad_s_per_g: f64,
}

impl Default for ImuEffects {
    fn default() -> Self {
        Self {
            noise_scale: 1.0,
            bias_walk_scale: 1.0,
            initial_bias_gyro_sigma_rad_s: 0.02,
            initial_bias_accel_sigma_m_s2: 0.05,
            vibration_accel_m_s2: 0.0,
            vibration_gyro_rad_s: 0.0,
            vibration_hz: 87.0,
            vibration_wander: 0.0,
            force_sigma_m_s2: 0.0,
            force_time_s: 1.0,
            scale_error: 0.0,
            misalignment_rad: 0.0,
            g_sensitivity_rad_s_per_g: 0.0,
        }
    }
}

impl ImuEffects {
    /// A perfect sensor: no noise, no bias.
    pub fn none() -> Self {
        Self {
            noise_scale: 0.0,
            bias_walk_scale: 0.0,
            initial_bias_gyro_sigma_rad_s: 0.0,
            initial_bias_accel_sigma_m_s2: 0.0,
            ..Self::default()
        }
    }
}

/// The sensor along one flight.
#[derive(Debug)]
pub(super) struct ImuModel {
    config: ImuConfig,
    effects: ImuEffects,
    seed: u64,
    begin: Timestamp,
    biases: Vec<Biases>,
    /// Phases of the vibration: gyroscope and accelerometer, three axes, two harmonics.
    phases: [[[f64; 2]; 3]; 2],
    /// Phases of the slow changes of its frequency.
    wander: [f64; 3],
    axes: Option<Axes>,
    /// Coloured error of the accelerometer at every sample, m/s²; empty for none.
    coloured: Vec<Vector3<f64>>,
}

impl ImuModel {
    /// A sensor whose first sample is at `begin` and whose last is not after `end`.
    pub(super) fn new(
        config: &ImuConfig,
        effects: ImuEffects,
        seed: u64,
        [begin, end]: [Timestamp; 2],
    ) -> Self {
        let count = (end.seconds_since(begin) * config.rate_hz + 1e-6) as usize + 1;
        let mut draws = Draws::new(seed, Purpose::Vibration, 0);
        let phases = [(); 2].map(|()| [(); 3].map(|()| [(); 2].map(|()| draws.range(0.0, TAU))));
        let biases = walk(config, &effects, seed, count);
        let mut draws = Draws::new(seed, Purpose::Wander, 0);
        let wander = [(); 3].map(|()| draws.range(0.0, TAU));
        let axes = Axes::of(&effects, seed);
        let coloured = coloured(config, &effects, seed, count);
        let config = config.clone();
        Self { config, effects, seed, begin, biases, phases, wander, axes, coloured }
    }

    /// All samples along `flight`.
    pub(super) fn samples(self, flight: &Trajectory) -> Samples {
        let samples = (0..self.biases.len()).map(|k| self.sample(k as u64, flight)).collect();
        Samples { samples, biases: self.biases, begin: self.begin, rate_hz: self.config.rate_hz }
    }

    fn sample(&self, k: u64, flight: &Trajectory) -> ImuSample {
        let stamp = self.begin.plus_seconds(k as f64 / self.config.rate_hz);
        let motion = flight.motion(stamp);
        let biases = self.biases[k as usize];
        let (omega, force) = self.felt(k, &motion);
        let mut draws = Draws::new(self.seed, Purpose::ImuNoise, k);
        let root_rate = self.config.rate_hz.sqrt() * self.effects.noise_scale;
        let t = stamp.seconds_since(self.begin);
        let shake = [self.effects.vibration_gyro_rad_s, self.effects.vibration_accel_m_s2];
        let [shake_gyro, shake_accel] = [0, 1].map(|i| self.vibration(t, i) * shake[i]);
        let gyro_noise = normal3(&mut draws) * (self.config.gyro_noise_density * root_rate);
        let accel_noise = normal3(&mut draws) * (self.config.accel_noise_density * root_rate);
        let clamp = |v: Vector3<f64>, range: f64| v.map(|x| x.clamp(-range, range));
        ImuSample {
            stamp,
            gyro: clamp(omega + biases.gyro + gyro_noise + shake_gyro, self.config.gyro_range_rad_s),
            accel: clamp(force + biases.accel + accel_noise + shake_accel, self.config.accel_range_m_s2),
        }
    }

    /// The specific force at rest or in `motion`, m/s².
    fn force(&self, motion: &MotionState) -> Vector3<f64> {
        let up = Vector3::new(0.0, 0.0, self.config.gravity_m_s2);
        motion.pose_w_b.rotation.inverse_transform_vector(&(motion.a_w_b + up))
    }

    /// Angular rate and specific force at sample `k` as the sensor has them before biases, noise and vibration.
    fn felt(&self, k: u64, motion: &MotionState) -> (Vector3<f64>, Vector3<f64>) {
        let (mut omega, mut force) = (motion.omega_b, self.force(motion));
        if let Some(axes) = &self.axes {
            (omega, force) = (axes.gyro * omega + axes.gyro_by_force * force, axes.accel * force);
        }
        if let Some(error) = self.coloured.get(k as usize) {
            force += error;
        }
        (omega, force)
    }

    /// Phase that the rotors are ahead, at `t_s`, of rotors of constant speed.
    fn ahead(&self, t_s: f64) -> f64 {
        if self.effects.vibration_wander == 0.0 {
            return 0.0;
        }
        let rms = (2.0_f64 / 3.0).sqrt();
        let waves = WANDER_PERIODS_S.iter().zip(&self.wander);
        let integral: f64 =
            waves.map(|(period_s, phase)| -libm::cos(TAU * t_s / period_s + phase) * period_s / TAU).sum();
        TAU * self.effects.vibration_hz * self.effects.vibration_wander * rms * integral
    }

    /// Vibration of unit amplitude, sensor 0 gyroscope, 1 accelerometer.
    fn vibration(&self, t_s: f64, sensor: usize) -> Vector3<f64> {
        let ahead = self.ahead(t_s);
        Vector3::from_fn(|axis, _| {
            let angle = TAU * self.effects.vibration_hz * t_s + ahead;
            let phases = self.phases[sensor][axis];
            libm::sin(angle + phases[0]) + 0.5 * libm::sin(2.0 * angle + phases[1])
        })
    }
}

/// Scale, misalignment and sensitivity to forces.
#[derive(Debug)]
struct Axes {
    gyro: Matrix3<f64>,
    accel: Matrix3<f64>,
    /// rad/s per m/s².
    gyro_by_force: Matrix3<f64>,
}

impl Axes {
    /// `None` for a sensor without such errors.
    fn of(effects: &ImuEffects, seed: u64) -> Option<Self> {
        let g_sensitivity = effects.g_sensitivity_rad_s_per_g / STANDARD_GRAVITY_M_S2;
        if effects.scale_error == 0.0 && effects.misalignment_rad == 0.0 && g_sensitivity == 0.0 {
            return None;
        }
        let mut draws = Draws::new(seed, Purpose::SensorAxes, 0);
        let mut matrix = || {
            let mut matrix = Matrix3::identity();
            for axis in 0..3 {
                let sign = if draws.unit() < 0.5 { -1.0 } else { 1.0 };
                let direction = draws.range(0.0, TAU);
                matrix[(axis, axis)] += sign * effects.scale_error;
                matrix[(axis, (axis + 1) % 3)] += effects.misalignment_rad * libm::cos(direction);
                matrix[(axis, (axis + 2) % 3)] += effects.misalignment_rad * libm::sin(direction);
            }
            matrix
        };
        let (gyro, accel) = (matrix(), matrix());
        let directions = [(); 3].map(|()| normal3(&mut draws).normalize().transpose());
        let gyro_by_force = Matrix3::from_rows(&directions) * g_sensitivity;
        Some(Self { gyro, accel, gyro_by_force })
    }
}

/// The Gauss-Markov process of the accelerometer at `count` samples; empty for none.
fn coloured(config: &ImuConfig, effects: &ImuEffects, seed: u64, count: usize) -> Vec<Vector3<f64>> {
    if effects.force_sigma_m_s2 == 0.0 {
        return Vec::new();
    }
    let kept = libm::exp(-1.0 / (config.rate_hz * effects.force_time_s));
    let fresh = effects.force_sigma_m_s2 * (1.0 - kept * kept).sqrt();
    let mut draws = Draws::new(seed, Purpose::ForceError, 0);
    let mut now = normal3(&mut draws) * effects.force_sigma_m_s2;
    let mut step = |_| {
        let error = now;
        now = now * kept + normal3(&mut draws) * fresh;
        error
    };
    (0..count).map(&mut step).collect()
}

fn normal3(draws: &mut Draws) -> Vector3<f64> {
    let mut next = || draws.normal();
    Vector3::new(next(), next(), next())
}

fn walk(config: &ImuConfig, effects: &ImuEffects, seed: u64, count: usize) -> Vec<Biases> {
    let mut draws = Draws::new(seed, Purpose::Bias, 0);
    let mut now = Biases {
        gyro: normal3(&mut draws) * effects.initial_bias_gyro_sigma_rad_s,
        accel: normal3(&mut draws) * effects.initial_bias_accel_sigma_m_s2,
    };
    let step = effects.bias_walk_scale / config.rate_hz.sqrt();
    let mut all = Vec::with_capacity(count);
    for _ in 0..count {
        all.push(now);
        now.gyro += normal3(&mut draws) * (config.gyro_bias_walk * step);
        now.accel += normal3(&mut draws) * (config.accel_bias_walk * step);
    }
    all
}

#[cfg(test)]
#[path = "imu_tests.rs"]
mod tests;
