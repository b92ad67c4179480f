//! Readings that repeat: a sensor whose numbers stay bit for bit the same has ceased to measure.
//!
//! The noise of a sensor changes the last bits of every reading. In 20 minutes of recorded flight (242,000 samples of an
//! ADIS16448 at 200 Hz, EuRoC) one axis repeated itself four times on end at most, and all three of a sensor once. But a coarse
//! sensor at rest may repeat itself for longer. So a sensor is stuck if all its axes repeat for
//! [`plumbline_config::options::ImuConfig::stuck_after_s`]. A share of that time is enough if the other sensor repeats
//! itself as well, or if some axis proves meanwhile that the vehicle moves. With such a proof one axis alone is enough.
//!
//! An unmeasured rate is replaced by no rotation, an unmeasured force by the last one. Their uncertainty is
//! the agility of a vehicle.

use super::ImuNoise;
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};

/// Shares of the time that are enough for a sensor, and for one axis, if the vehicle moves: at 200 Hz and by default six and
/// twelve samples.
const MOVING_SHARE: f64 = 0.3;
const AXIS_SHARE: f64 = 0.6;
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

/// Some of the two inertial sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sensors {
    /// The gyroscope.
    pub gyro: bool,
    /// The accelerometer.
    pub accel: bool,
}

/// Sensors that did not measure.
pub type Unmeasured = Sensors;

impl Sensors {
    /// Both of them.
    pub const BOTH: Self = Self { gyro: true, accel: true };

    /// True if it is one of them at least.
    pub fn is_any(self) -> bool {
        self.gyro || self.accel
    }

    /// Those of either.
    pub fn or(self, other: Self) -> Self {
        Self { gyro: self.gyro || other.gyro, accel: self.accel || other.accel }
    }

    /// The noise of a step in which these sensors did not measure; `noise` where both did.
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

/// The readings of both sensors, gyroscope first.
type Readings = [Vector3<f64>; 2];

/// The repetitions of one axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// First sample of the present value, and what both sensors read then.
    since: Timestamp,
    reference: Readings,
    /// Samples that repeated it.
    repeats: u32,
    /// True if another axis has moved since.
    others_moved: bool,
}

impl Axis {
    fn new(stamp: Timestamp, readings: &Readings) -> Self {
        Self { since: stamp, reference: *readings, repeats: 0, others_moved: false }
    }

    /// Takes the readings of `stamp`; the axis is component `k` of `sensor`.
    fn update(&mut self, stamp: Timestamp, readings: &Readings, sensor: usize, k: usize) {
        if readings[sensor][k] != self.reference[sensor][k] || stamp < self.since {
            *self = Self::new(stamp, readings);
            return;
        }
        self.repeats = self.repeats.saturating_add(1);
        self.others_moved |= (readings[0] - self.reference[0]).amax() > MOVED_RAD_S
            || (readings[1] - self.reference[1]).amax() > MOVED_M_S2;
    }

    /// True if the axis has repeated itself for at least `ns`.
    fn repeats_for(&self, stamp: Timestamp, ns: i64) -> bool {
        self.repeats >= MIN_REPEATS && stamp.nanos_since(self.since) >= ns
    }
}

/// Follows the readings of an inertial sensor, and reports which of its sensors are stuck.
#[derive(Clone, Debug)]
pub struct StuckWatch {
    /// Time that is enough for a sensor at rest, for one that moves, and for one axis, ns; 0 for never.
    enough_ns: [i64; 3],
    axes: Option<[[Axis; 3]; 2]>,
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
    pub fn unmeasured(&self) -> Unmeasured {
        Unmeasured { gyro: self.gyro.is_some(), accel: self.accel.is_some() }
    }

    /// The sensors that were stuck at `stamp` already.
    pub fn at(&self, stamp: Timestamp) -> Unmeasured {
        let is_stuck = |since: Option<Timestamp>| since.is_some_and(|since| stamp > since);
        Unmeasured { gyro: is_stuck(self.gyro), accel: is_stuck(self.accel) }
    }
}

impl StuckWatch {
    /// A watch for readings that repeat for `stuck_after_s`; never if that is 0.
    pub fn new(stuck_after_s: f64) -> Self {
        Self {
            enough_ns: [1.0, MOVING_SHARE, AXIS_SHARE].map(|share| (share * stuck_after_s * 1e9) as i64),
            axes: None,
        }
    }

    /// A watch for a configured sensor.
    pub fn of(imu: &ImuConfig) -> Self {
        Self::new(imu.stuck_after_s)
    }

    /// Forgets all readings.
    pub fn clear(&mut self) {
        self.axes = None;
    }

    /// Takes a sample; returns since when each sensor is stuck.
    pub fn update(&mut self, sample: &ImuSample) -> StuckSince {
        let [at_rest, moving, of_axis] = self.enough_ns;
        if at_rest == 0 {
            return StuckSince::default();
        }
        let (stamp, readings) = (sample.stamp, [sample.gyro, sample.accel]);
        let sensors = self.axes.get_or_insert([[Axis::new(stamp, &readings); 3]; 2]);
        for (sensor, axes) in sensors.iter_mut().enumerate() {
            (0..3).for_each(|k| axes[k].update(stamp, &readings, sensor, k));
        }
        let all_repeat = |axes: &[Axis; 3], ns: i64| axes.iter().all(|axis| axis.repeats_for(stamp, ns));
        let is_frozen = sensors.iter().all(|axes| all_repeat(axes, moving));
        let [gyro, accel] = sensors.each_ref().map(|axes| {
            let moves = axes.iter().all(|axis| axis.others_moved);
            let is_stuck = all_repeat(axes, at_rest) || (all_repeat(axes, moving) && (moves || is_frozen));
            let whole = axes.iter().map(|axis| axis.since).max().filter(|_| is_stuck);
            let stuck = axes.iter().filter(|axis| axis.others_moved && axis.repeats_for(stamp, of_axis));
            stuck.map(|axis| axis.since).chain(whole).min()
        });
        StuckSince { gyro, accel }
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
        let mut watch = StuckWatch::new(0.1);
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
        assert!(said[..106].iter().all(|s| *s == NEVER));
        assert!(said[106..].iter().all(|s| s.gyro == Some(at(100)) && s.accel.is_none()));
        assert_eq!(said[106].at(at(100)), Unmeasured::default(), "the first of them may be real");
        assert_eq!(said[106].at(at(101)), Unmeasured { gyro: true, accel: false });
    }

    #[test]
    fn one_stuck_axis_takes_twice_as_long_and_a_change_ends_it() {
        let said = watch(300, |k, s| s.accel.y = if (100..200).contains(&k) { 1.0 } else { s.accel.y });
        assert!(said[..112].iter().chain(&said[200..]).all(|s| *s == NEVER));
        assert!(said[112..200].iter().all(|s| s.accel == Some(at(100)) && s.gyro.is_none()));
    }

    #[test]
    fn a_sensor_that_repeats_all_it_reads_is_stuck_though_nothing_moves() {
        let said = watch(200, |k, s| {
            if k >= 100 {
                (s.gyro, s.accel) = (Vector3::x(), Vector3::z());
            }
        });
        assert!(said[..106].iter().all(|s| *s == NEVER));
        assert!(said[106..].iter().all(|s| s.unmeasured() == Unmeasured::BOTH));
    }

    #[test]
    fn a_coarse_sensor_at_rest_is_not_stuck() {
        // One axis goes to and fro between two steps of the sensor, the others stand.
        let rest = |k: u32, s: &mut ImuSample| {
            s.gyro = Vector3::new(1e-3 * f64::from(k / 15 % 2), 2e-3, -1e-3);
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
        let noise = ImuNoise {
            gyro_density: 1e-4,
            accel_density: 1e-3,
            gyro_walk: 1e-5,
            accel_walk: 1e-4,
            ..ImuNoise::NONE
        };
        assert_eq!(Unmeasured::default().noise(noise), noise);
        let of_gyro = Unmeasured { gyro: true, accel: false }.noise(noise);
        assert!(
            of_gyro.gyro_density > 0.5 && of_gyro.accel_density.to_bits() == noise.accel_density.to_bits()
        );
    }
}
