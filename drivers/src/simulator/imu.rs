//! The simulated inertial sensor: point samples at their stamps, never means over an interval.
//!
//! `gyro = omega_b + bias_g + n_g`, `accel = R_wb' (a_w - g_w) + bias_a + n_a` with
//! `g_w = (0, 0, -g)`; the discrete noise is `density * sqrt(rate)`, the biases walk by
//! `walk * sqrt(dt)` per sample. Readings beyond the sensor's range are clamped to it. Sample `k` is a
//! pure function of the seed and of `k`.

use super::trajectory::Trajectory;
use crate::random::{Draws, Purpose};
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};
use std::f64::consts::TAU;

/// What the inertial sensor adds to the truth.
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
        }
    }
}

impl ImuEffects {
    /// A perfect sensor: no noise, no bias.
    #[must_use]
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

/// Biases at one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Biases {
    /// rad/s.
    pub(super) gyro: Vector3<f64>,
    /// m/s².
    pub(super) accel: Vector3<f64>,
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
}

impl ImuModel {
    /// A sensor whose first sample is at `begin` and whose last is not after `end`.
    pub(super) fn new(
        config: &ImuConfig,
        effects: ImuEffects,
        seed: u64,
        begin: Timestamp,
        end: Timestamp,
    ) -> Self {
        let count = (end.seconds_since(begin) * config.rate_hz + 1e-6) as usize + 1;
        let mut draws = Draws::new(seed, Purpose::Vibration, 0);
        let phases = [(); 2].map(|()| [(); 3].map(|()| [(); 2].map(|()| draws.range(0.0, TAU))));
        let biases = walk(config, &effects, seed, count);
        Self { config: config.clone(), effects, seed, begin, biases, phases }
    }

    /// Number of samples of the flight.
    pub(super) fn len(&self) -> u64 {
        self.biases.len() as u64
    }

    /// Measurement time of sample `k`.
    pub(super) fn stamp(&self, k: u64) -> Timestamp {
        self.begin.plus_seconds(k as f64 / self.config.rate_hz)
    }

    /// Biases at `stamp`, between samples by interpolation.
    pub(super) fn biases(&self, stamp: Timestamp) -> Biases {
        let last = self.biases.len() - 1;
        let at = (stamp.seconds_since(self.begin) * self.config.rate_hz).clamp(0.0, last as f64);
        let (low, part) = (at as usize, at.fract());
        let (a, b) = (self.biases[low], self.biases[(low + 1).min(last)]);
        Biases { gyro: a.gyro.lerp(&b.gyro, part), accel: a.accel.lerp(&b.accel, part) }
    }

    /// Sample `k`, below [`Self::len`].
    pub(super) fn sample(&self, k: u64, flight: &Trajectory) -> ImuSample {
        let stamp = self.stamp(k);
        let motion = flight.motion(stamp);
        let biases = self.biases[k as usize];
        let up = Vector3::new(0.0, 0.0, self.config.gravity_m_s2);
        let force = motion.pose_w_b.rotation.inverse_transform_vector(&(motion.a_w_b + up));
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
            gyro: clamp(motion.omega_b + biases.gyro + gyro_noise + shake_gyro, self.config.gyro_range_rad_s),
            accel: clamp(force + biases.accel + accel_noise + shake_accel, self.config.accel_range_m_s2),
        }
    }

    /// Vibration of unit amplitude, sensor 0 gyroscope, 1 accelerometer.
    fn vibration(&self, t_s: f64, sensor: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| {
            let angle = TAU * self.effects.vibration_hz * t_s;
            let phases = self.phases[sensor][axis];
            libm::sin(angle + phases[0]) + 0.5 * libm::sin(2.0 * angle + phases[1])
        })
    }
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
mod tests {
    use super::*;
    use crate::simulator::fixture;
    use nalgebra::UnitQuaternion;

    fn model(effects: ImuEffects, flight: &Trajectory, rate_hz: f64) -> ImuModel {
        let config = ImuConfig { rate_hz, ..fixture::config().imu };
        ImuModel::new(&config, effects, 3, flight.begin(), flight.end())
    }

    #[test]
    fn at_rest_it_feels_gravity_upwards() {
        let flight = fixture::standing(2.0);
        let sample = model(ImuEffects::none(), &flight, 200.0).sample(100, &flight);
        let up_b = flight.motion_at(0.5).pose_w_b.rotation.inverse() * Vector3::new(0.0, 0.0, 9.81);
        assert!((sample.accel - up_b).norm() < 1e-6);
        assert!(sample.gyro.norm() < 1e-6);
    }

    #[test]
    fn integrated_finely_it_gives_the_truth() {
        let flight = fixture::wobble(4.0);
        let imu = model(ImuEffects::none(), &flight, 4000.0);
        let dt = 1.0 / 4000.0;
        let first = flight.motion(imu.stamp(0));
        let (mut q, mut v, mut p) = (first.pose_w_b.rotation, first.v_w_b, first.pose_w_b.translation.vector);
        for k in 0..imu.len() - 1 {
            let (a, b) = (imu.sample(k, &flight), imu.sample(k + 1, &flight));
            let next = q * UnitQuaternion::from_scaled_axis((a.gyro + b.gyro) * (0.5 * dt));
            let gravity = Vector3::new(0.0, 0.0, -9.81);
            let acceleration = (q * a.accel + next * b.accel) * 0.5 + gravity;
            p += v * dt + acceleration * (0.5 * dt * dt);
            v += acceleration * dt;
            q = next;
        }
        let last = flight.motion(imu.stamp(imu.len() - 1));
        assert!((p - last.pose_w_b.translation.vector).norm() < 1e-4);
        assert!((v - last.v_w_b).norm() < 1e-4);
        assert!(q.angle_to(&last.pose_w_b.rotation) < 1e-5);
    }

    #[test]
    fn noise_has_the_configured_density() {
        let flight = fixture::standing(50.0);
        let quiet = ImuEffects { noise_scale: 1.0, ..ImuEffects::none() };
        let imu = model(quiet, &flight, 200.0);
        let mean_square = (0..imu.len()).map(|k| imu.sample(k, &flight).gyro.norm_squared()).sum::<f64>()
            / (3.0 * imu.len() as f64);
        let expected = fixture::config().imu.gyro_noise_density * 200.0_f64.sqrt();
        assert!((mean_square.sqrt() / expected - 1.0).abs() < 0.02);
    }

    #[test]
    fn biases_are_in_the_samples_and_in_the_truth() {
        let flight = fixture::standing(5.0);
        let effects = ImuEffects { noise_scale: 0.0, ..ImuEffects::default() };
        let imu = model(effects, &flight, 200.0);
        let sample = imu.sample(500, &flight);
        let biases = imu.biases(sample.stamp);
        assert!((sample.gyro - biases.gyro).norm() < 1e-6 && biases.gyro.norm() > 1e-3);
        let start = imu.biases(imu.stamp(0));
        assert!((start.accel - biases.accel).norm() > 1e-6, "the bias walks");
    }

    #[test]
    fn vibration_shakes_the_samples() {
        let flight = fixture::standing(2.0);
        let effects = ImuEffects { vibration_accel_m_s2: 3.0, ..ImuEffects::none() };
        let imu = model(effects, &flight, 200.0);
        let still = model(ImuEffects::none(), &flight, 200.0);
        let most = (0..imu.len())
            .map(|k| (imu.sample(k, &flight).accel - still.sample(k, &flight).accel).amax())
            .fold(0.0, f64::max);
        assert!((2.0..4.6).contains(&most));
    }

    #[test]
    fn readings_stay_within_range() {
        let flight = fixture::standing(1.0);
        let config = ImuConfig { accel_range_m_s2: 5.0, ..fixture::config().imu };
        let imu = ImuModel::new(&config, ImuEffects::none(), 1, flight.begin(), flight.end());
        assert!(imu.sample(0, &flight).accel.amax() <= 5.0);
    }
}
