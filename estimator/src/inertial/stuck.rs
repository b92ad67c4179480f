//! Readings that repeat: a sensor whose numbers stay bit for bit the same has ceased to measure.
//!
//! The noise of a sensor changes the last bits of every reading. In 20 minutes of recorded flight (242,000 samples of an
//! ADIS16448 at 200 Hz, EuRoC) one axis repeated itself five times on end at most, and all three of a sensor twice. So
//! three axes that repeat for [`plumbline_config::options::ImuConfig::stuck_after_s`] (ten samples at 200 Hz) are stuck. One
//! axis alone may stand still on a coarse sensor at rest: it is stuck if it repeats for twice as long while another axis of
//! the same sensor moves.
//!
//! What is not measured is replaced by no rotation, or by the last force, and is as uncertain as a vehicle is agile.

use super::ImuNoise;
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};

/// One axis alone repeats this many times as long as all three before it counts as stuck.
const AXIS_SHARE: i64 = 2;
/// Fewer repetitions than this prove nothing, however far apart the samples are.
const MIN_REPEATS: u32 = 5;
/// Another axis that has moved by this much proves that the vehicle is not at rest, rad/s and m/s²: twenty steps of a coarse
/// sensor, and less than any second of flight.
const MOVED_RAD_S: f64 = 0.02;
const MOVED_M_S2: f64 = 0.2;
/// Density of a rotation that nothing measured, rad/sqrt(s): 2 rad/s, the most that [`super::belief`] takes for an error of a
/// gap, for an eighth of a second.
const UNMEASURED_GYRO_DENSITY: f64 = 0.7;
/// Density of a force that nothing measured, m/s/sqrt(s): 6 m/s² for an eighth of a second.
const UNMEASURED_ACCEL_DENSITY: f64 = 2.0;

/// Which sensors did not measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unmeasured {
    /// The gyroscope.
    pub gyro: bool,
    /// The accelerometer.
    pub accel: bool,
}

impl Unmeasured {
    /// Neither sensor measured.
    pub const BOTH: Self = Self { gyro: true, accel: true };

    /// Whether any sensor did not measure.
    #[must_use]
    pub fn is_any(self) -> bool {
        self.gyro || self.accel
    }

    /// The sensors that did not measure in either of two samples.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self { gyro: self.gyro || other.gyro, accel: self.accel || other.accel }
    }

    /// The noise of a step in which these sensors did not measure; `noise` where both did.
    #[must_use]
    pub fn noise(self, noise: ImuNoise) -> ImuNoise {
        let density = |is_missing: bool, of_sensor: f64, unmeasured: f64| {
            if is_missing { libm::hypot(of_sensor, unmeasured) } else { of_sensor }
        };
        ImuNoise {
            gyro_density: density(self.gyro, noise.gyro_density, UNMEASURED_GYRO_DENSITY),
            accel_density: density(self.accel, noise.accel_density, UNMEASURED_ACCEL_DENSITY),
            ..noise
        }
    }
}

/// The repetitions of one axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// First sample of the present value.
    since: Timestamp,
    /// All axes of the sensor in that sample.
    reference: Vector3<f64>,
    /// Samples that repeated it.
    repeats: u32,
    /// Whether another axis has moved since.
    others_moved: bool,
}

/// The repetitions of one sensor of three axes.
#[derive(Clone, Debug)]
struct SensorWatch {
    moved: f64,
    axes: Option<[Axis; 3]>,
}

impl SensorWatch {
    fn new(moved: f64) -> Self {
        Self { moved, axes: None }
    }

    /// Takes a reading; returns since when the sensor is stuck, if it is.
    fn update(&mut self, stamp: Timestamp, reading: &Vector3<f64>, stuck_after_ns: i64) -> Option<Timestamp> {
        let fresh = Axis { since: stamp, reference: *reading, repeats: 0, others_moved: false };
        let axes = self.axes.get_or_insert([fresh; 3]);
        let (mut newest_change, mut least_repeats) = (Timestamp::MIN, u32::MAX);
        let mut stuck_axis: Option<Timestamp> = None;
        for (k, axis) in axes.iter_mut().enumerate() {
            if reading[k].to_bits() != axis.reference[k].to_bits() || stamp < axis.since {
                *axis = fresh;
            } else {
                axis.repeats = axis.repeats.saturating_add(1);
            }
            axis.others_moved |= (reading - axis.reference).amax() > self.moved;
            newest_change = newest_change.max(axis.since);
            least_repeats = least_repeats.min(axis.repeats);
            let is_long = stamp.nanos_since(axis.since) >= AXIS_SHARE * stuck_after_ns;
            if axis.others_moved && is_long && axis.repeats >= MIN_REPEATS {
                stuck_axis = Some(stuck_axis.map_or(axis.since, |since| since.min(axis.since)));
            }
        }
        let is_frozen =
            stamp.nanos_since(newest_change) >= stuck_after_ns && least_repeats >= MIN_REPEATS;
        if is_frozen { Some(stuck_axis.map_or(newest_change, |s| s.min(newest_change))) } else { stuck_axis }
    }
}

/// Follows the readings of an inertial sensor, and reports which of its sensors are stuck.
#[derive(Clone, Debug)]
pub struct StuckWatch {
    stuck_after_ns: i64,
    gyro: SensorWatch,
    accel: SensorWatch,
}

/// Since when the sensors are stuck.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StuckSince {
    /// First of the repeated samples of the gyroscope.
    pub gyro: Option<Timestamp>,
    /// First of the repeated samples of the accelerometer.
    pub accel: Option<Timestamp>,
}

impl StuckSince {
    /// The sensors that do not measure.
    #[must_use]
    pub fn unmeasured(&self) -> Unmeasured {
        Unmeasured { gyro: self.gyro.is_some(), accel: self.accel.is_some() }
    }

    /// The sensors that were stuck at `stamp` already.
    #[must_use]
    pub fn at(&self, stamp: Timestamp) -> Unmeasured {
        let is_stuck = |since: Option<Timestamp>| since.is_some_and(|since| stamp > since);
        Unmeasured { gyro: is_stuck(self.gyro), accel: is_stuck(self.accel) }
    }
}

impl StuckWatch {
    /// A watch for readings that repeat for `stuck_after_s`; never if that is 0.
    #[must_use]
    pub fn new(stuck_after_s: f64) -> Self {
        Self {
            stuck_after_ns: (stuck_after_s * 1e9) as i64,
            gyro: SensorWatch::new(MOVED_RAD_S),
            accel: SensorWatch::new(MOVED_M_S2),
        }
    }

    /// A watch for a configured sensor.
    #[must_use]
    pub fn of(imu: &ImuConfig) -> Self {
        Self::new(imu.stuck_after_s)
    }

    /// Forgets all readings.
    pub fn clear(&mut self) {
        (self.gyro.axes, self.accel.axes) = (None, None);
    }

    /// Takes a sample; returns since when each sensor is stuck.
    pub fn update(&mut self, sample: &ImuSample) -> StuckSince {
        if self.stuck_after_ns == 0 {
            return StuckSince::default();
        }
        StuckSince {
            gyro: self.gyro.update(sample.stamp, &sample.gyro, self.stuck_after_ns),
            accel: self.accel.update(sample.stamp, &sample.accel, self.stuck_after_ns),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEVER: StuckSince = StuckSince { gyro: None, accel: None };

    fn at(k: u32) -> Timestamp {
        Timestamp::from_nanos(i64::from(k) * 5_000_000)
    }

    /// Readings that change in every sample, as `spoil` changes them, and what is said of each.
    fn watch(count: u32, spoil: impl Fn(u32, &mut ImuSample)) -> Vec<StuckSince> {
        let mut watch = StuckWatch::new(0.05);
        let mut next = |k: u32| {
            let x = libm::sin(f64::from(k * k));
            let gyro = Vector3::new(x, -x, 0.5 * x) * 0.1;
            let mut sample = ImuSample { stamp: at(k), gyro, accel: Vector3::new(x, 2.0 * x, 9.8 + x) };
            spoil(k, &mut sample);
            watch.update(&sample)
        };
        (0..count).map(&mut next).collect()
    }

    #[test]
    fn a_sound_sensor_is_never_stuck() {
        assert!(watch(1000, |_, _| {}).iter().all(|s| *s == NEVER));
    }

    #[test]
    fn a_gyroscope_at_zero_is_stuck_since_its_first_zero() {
        let said = watch(200, |k, s| s.gyro *= f64::from(u8::from(k < 100)));
        assert!(said[..110].iter().all(|s| *s == NEVER));
        assert!(said[110..].iter().all(|s| s.gyro == Some(at(100)) && s.accel.is_none()));
        assert_eq!(said[110].at(at(100)), Unmeasured::default(), "the first of them may be real");
        assert_eq!(said[110].at(at(101)), Unmeasured { gyro: true, accel: false });
    }

    #[test]
    fn one_stuck_axis_takes_twice_as_long_and_a_change_ends_it() {
        let said = watch(300, |k, s| s.accel.y = if (100..200).contains(&k) { 1.0 } else { s.accel.y });
        assert!(said[..120].iter().chain(&said[200..]).all(|s| *s == NEVER));
        assert!(said[120..200].iter().all(|s| s.accel == Some(at(100)) && s.gyro.is_none()));
    }

    #[test]
    fn a_coarse_axis_at_rest_is_not_stuck() {
        // One axis goes to and fro between two steps of the sensor, the others stand.
        let rest = |k: u32, s: &mut ImuSample| {
            s.gyro = Vector3::new(1e-3 * f64::from(k / 3 % 2), 2e-3, -1e-3);
            s.accel = Vector3::new(0.0, 5e-3 * f64::from(k / 2 % 2), 9.81);
        };
        assert!(watch(1000, rest).iter().all(|s| *s == NEVER));
    }

    #[test]
    fn zero_seconds_switch_the_watch_off() {
        let mut watch = StuckWatch::new(0.0);
        let sample = |k| ImuSample { stamp: at(k), gyro: Vector3::zeros(), accel: Vector3::zeros() };
        assert!((0..1000).all(|k| watch.update(&sample(k)) == NEVER));
    }

    #[test]
    fn what_is_measured_has_the_noise_of_the_sensor_bit_for_bit() {
        let noise = ImuNoise { gyro_density: 1e-4, accel_density: 1e-3, gyro_walk: 1e-5, accel_walk: 1e-4 };
        assert_eq!(Unmeasured::default().noise(noise), noise);
        let of_gyro = Unmeasured { gyro: true, accel: false }.noise(noise);
        assert!(of_gyro.gyro_density > 0.5 && of_gyro.accel_density.to_bits() == noise.accel_density.to_bits());
    }
}
