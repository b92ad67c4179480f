//! Belief in the readings of an inertial sensor: at the ends of its range, and where samples are missing.
//!
//! A reading at the end of the range says nothing but that the truth is out there, and is as uncertain as half the range. A
//! force there is the best guess: vibration clips the same side again and again, and any other reading leans to the middle. For
//! an angular rate the last one within the range stands in, since a wild one would throw the images' predictions off. Between two samples that are far apart the motion is taken for steady; what
//! it may have been otherwise grows with their distance, and has nothing to do with the noise of the sensor.

use super::{ImuNoise, Sensors, Unmeasured};
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Portable};

/// Two samples further apart than this many nominal periods have lost samples between them.
pub const GAP_PERIODS: f64 = 2.5;
/// Readings beyond this share of the range count as being at its end.
const SATURATED_SHARE: f64 = 0.99;
/// Readings are cut off at this many times the range: one beyond all measure must not make sums infinite.
const MOST_RANGES: f64 = 10.0;
/// Standard deviation of what a saturated sensor would have read, as a share of its range.
const SATURATED_SIGMA_SHARE: f64 = 0.5;
/// Rates of change of angular rate and specific force of a vehicle in flight, rad/s² and m/s³: one standard
/// deviation in the ground truth of EuRoC's difficult sequences, rounded up.
const CHANGE_OF_RATE_RAD_S2: f64 = 10.0;
const CHANGE_OF_FORCE_M_S3: f64 = 50.0;
/// However long samples are missing, they would not have been further off than this, rad/s and m/s².
const MAX_RATE_ERROR_RAD_S: f64 = 2.0;
const MAX_FORCE_ERROR_M_S2: f64 = 8.0;

/// A sample as it is believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BelievedSample {
    /// The readings, believed or not; that of before where the gyroscope was saturated.
    pub sample: ImuSample,
    /// Sensors whose readings were saturated.
    pub saturated: Sensors,
    /// Sensors that did not measure at all: see [`super::stuck`].
    pub unmeasured: Unmeasured,
}

impl BelievedSample {
    /// Marks `unmeasured` sensors: their readings stand for no rotation, and for the force that they repeat.
    pub fn distrust(&mut self, unmeasured: Unmeasured) {
        self.unmeasured = self.unmeasured.or(unmeasured);
    }

    /// Angular rate to integrate, bias included, rad/s: none where it was not measured.
    pub fn gyro(&self) -> Vector3<f64> {
        if self.unmeasured.gyro { Vector3::zeros() } else { self.sample.gyro }
    }
}

/// The limits of an inertial sensor.
#[derive(Clone, Copy, Debug)]
pub struct SensorLimits {
    period_s: f64,
    gyro_range: f64,
    accel_range: f64,
}

impl SensorLimits {
    /// Limits of a configured sensor.
    pub fn of(imu: &ImuConfig) -> Self {
        Self {
            period_s: 1.0 / imu.rate_hz,
            gyro_range: imu.gyro_range_rad_s,
            accel_range: imu.accel_range_m_s2,
        }
    }

    /// Belief in a sample that follows `last`.
    pub fn believe(&self, sample: &ImuSample, last: Option<&BelievedSample>) -> BelievedSample {
        let saturated = Sensors {
            gyro: sample.gyro.amax() > SATURATED_SHARE * self.gyro_range,
            accel: sample.accel.amax() > SATURATED_SHARE * self.accel_range,
        };
        let mut believed = BelievedSample { sample: *sample, saturated, unmeasured: Unmeasured::default() };
        let bounded = |reading: Vector3<f64>, range: f64| {
            reading.map(|x| x.at_least(-MOST_RANGES * range).at_most(MOST_RANGES * range))
        };
        believed.sample.gyro = bounded(sample.gyro, self.gyro_range);
        believed.sample.accel = bounded(sample.accel, self.accel_range);
        if let Some(last) = last
            && saturated.gyro
        {
            believed.sample.gyro = last.gyro();
        }
        believed
    }

    /// True if samples are missing within `dt_s`.
    pub fn is_gap(&self, dt_s: f64) -> bool {
        dt_s > GAP_PERIODS * self.period_s
    }

    /// The noise of a step of `dt_s` seconds, which lies `apart_s` from the samples that it goes by or as far between two of
    /// them, and at whose ends something is `saturated`; that of the sensor, `noise`, where all is well.
    pub fn noise_of_step(&self, noise: &ImuNoise, dt_s: f64, apart_s: f64, saturated: Sensors) -> ImuNoise {
        let mut of_step = *noise;
        // A mean over the step that is off by sigma has the density sigma sqrt(dt).
        let mut add = |gyro_sigma: f64, accel_sigma: f64| {
            of_step.gyro_density = libm::hypot(of_step.gyro_density, gyro_sigma * dt_s.sqrt());
            of_step.accel_density = libm::hypot(of_step.accel_density, accel_sigma * dt_s.sqrt());
        };
        if self.is_gap(apart_s) {
            let rate = (0.5 * CHANGE_OF_RATE_RAD_S2 * apart_s).at_most(MAX_RATE_ERROR_RAD_S);
            let force = (0.5 * CHANGE_OF_FORCE_M_S3 * apart_s).at_most(MAX_FORCE_ERROR_M_S2);
            add(rate, force);
        }
        if saturated.gyro {
            add(SATURATED_SIGMA_SHARE * self.gyro_range, 0.0);
        }
        if saturated.accel {
            add(0.0, SATURATED_SIGMA_SHARE * self.accel_range);
        }
        of_step
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;

    const LIMITS: SensorLimits = SensorLimits { period_s: 0.005, gyro_range: 10.0, accel_range: 100.0 };
    const NOISE: ImuNoise = ImuNoise { gyro_density: 1e-4, accel_density: 1e-3, ..ImuNoise::NONE };

    fn sample(rate: f64, force: f64) -> ImuSample {
        let stamp = Timestamp::from_nanos(0);
        ImuSample { stamp, gyro: Vector3::x() * rate, accel: Vector3::z() * force }
    }

    #[test]
    fn a_rate_at_the_end_of_its_range_is_the_last_one_within_it_and_a_force_stays() {
        let before = LIMITS.believe(&sample(1.0, 9.8), None);
        let spun = LIMITS.believe(&sample(-9.95, 12.0), Some(&before));
        assert_eq!((spun.sample, spun.saturated), (sample(1.0, 12.0), Sensors { gyro: true, accel: false }));
        let hit = LIMITS.believe(&sample(-3.0, 100.0), Some(&spun));
        assert_eq!((hit.sample, hit.saturated), (sample(-3.0, 100.0), Sensors { gyro: false, accel: true }));
    }

    #[test]
    fn a_reading_beyond_all_measure_is_cut_off() {
        let wild = LIMITS.believe(&sample(-1e300, 1e300), None);
        assert_eq!(wild.sample, sample(-100.0, 1000.0));
        assert_eq!(wild.saturated, Sensors { gyro: true, accel: true });
    }

    #[test]
    fn where_all_is_well_the_noise_is_that_of_the_sensor_bit_for_bit() {
        assert_eq!(LIMITS.noise_of_step(&NOISE, 0.005, 0.005, Sensors::default()), NOISE);
    }

    #[test]
    fn what_was_not_measured_is_as_uncertain_as_a_vehicle_is_agile_whatever_the_sensors_noise() {
        for dt_s in [0.05_f64, 0.2] {
            let of_gap = LIMITS.noise_of_step(&NOISE, dt_s, dt_s, Sensors::default());
            // Standard deviations of the turn and of the change of velocity over the gap.
            let turn = of_gap.gyro_density * dt_s.sqrt();
            let gain = of_gap.accel_density * dt_s.sqrt();
            assert!((turn - 5.0 * dt_s * dt_s).abs() < 1e-3 && (gain - 25.0 * dt_s * dt_s).abs() < 1e-2);
        }
        let long = LIMITS.noise_of_step(&NOISE, 10.0, 10.0, Sensors::default());
        assert!((long.gyro_density * 10.0_f64.sqrt() - 20.0).abs() < 1e-6);
        // A short step long after the last sample goes by a reading that is as old.
        let late = LIMITS.noise_of_step(&NOISE, 0.05, 0.5, Sensors::default());
        assert!((late.gyro_density / 0.05_f64.sqrt() - 2.0).abs() < 1e-3);
    }

    #[test]
    fn a_saturated_step_is_uncertain_by_half_the_range() {
        let saturated = Sensors { gyro: true, accel: false };
        let noise = LIMITS.noise_of_step(&NOISE, 0.005, 0.005, saturated);
        assert!((noise.gyro_density / 0.005_f64.sqrt() - 5.0).abs() < 1e-3);
        assert_eq!(noise.accel_density.to_bits(), NOISE.accel_density.hypot(0.0).to_bits());
    }
}
