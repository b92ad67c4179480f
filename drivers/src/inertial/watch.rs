//! Faults of samples other than those of their time.

use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use serde::Serialize;

/// A component this near to the end of its range is at it: rounding of scales.
const AT_END: f64 = 0.999;
/// A component this far beyond its range is noise or a wrong unit.
const IMPOSSIBLE: f64 = 1.5;
/// A sensor whose six numbers are all the same so often in a row is stuck: noise alone would change them.
const STUCK: u32 = 10;
/// A change of temperature by this within [`STEP_NS`] is none of the sensor's, degrees.
const STEP_C: f64 = 3.0;
/// See [`STEP_C`], ns.
const STEP_NS: i64 = 1_000_000_000;
/// Temperatures that a sensor can have, degrees Celsius.
const POSSIBLE_C: std::ops::RangeInclusive<f64> = -60.0..=150.0;

/// Counts of faulty samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct WatchFigures {
    /// With an axis at the end of its range, by their numbers or by what the device says.
    pub saturated: u64,
    /// Samples that repeated the ones before.
    pub stuck: u64,
    /// Samples that the device marked failed or that no sensor can measure: dropped.
    pub impossible: u64,
    /// Steps of the temperature, and temperatures that cannot be.
    pub temperature_steps: u64,
    /// The last temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
}

/// Decision about a sample: hand it out or drop it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleVerdict {
    /// It is, even if it is flagged.
    Use,
    /// It says nothing.
    Drop,
}

/// Looks at samples.
#[derive(Clone, Debug)]
pub struct SampleWatch {
    gyro_range: f64,
    accel_range: f64,
    last: Option<(Vector3<f64>, Vector3<f64>)>,
    repeats: u32,
    /// A temperature and its time, which those of the next second are held against.
    reference: Option<(f64, i64)>,
    figures: WatchFigures,
}

impl SampleWatch {
    /// For a sensor of these ranges.
    #[must_use]
    pub fn new(imu: &ImuConfig) -> Self {
        Self {
            gyro_range: imu.gyro_range_rad_s,
            accel_range: imu.accel_range_m_s2,
            last: None,
            repeats: 0,
            reference: None,
            figures: WatchFigures::default(),
        }
    }

    /// Looks at a sample, rad/s and m/s²; `is_flagged` when the device itself says that a range was exceeded.
    pub fn look(&mut self, gyro: &Vector3<f64>, accel: &Vector3<f64>, is_flagged: bool) -> SampleVerdict {
        let is_sound = |v: &Vector3<f64>, range: f64| v.iter().all(|x| x.abs() <= IMPOSSIBLE * range);
        if !is_sound(gyro, self.gyro_range) || !is_sound(accel, self.accel_range) {
            return self.failed();
        }
        let is_at_end = |v: &Vector3<f64>, range: f64| v.iter().any(|x| x.abs() >= AT_END * range);
        let is_saturated =
            is_flagged || is_at_end(gyro, self.gyro_range) || is_at_end(accel, self.accel_range);
        self.figures.saturated += u64::from(is_saturated);
        let is_repeated = self.last.is_some_and(|last| last == (*gyro, *accel));
        self.repeats = if is_repeated { self.repeats.saturating_add(1) } else { 0 };
        self.figures.stuck += u64::from(self.repeats >= STUCK);
        self.last = Some((*gyro, *accel));
        SampleVerdict::Use
    }

    /// A sample that the device itself calls failed.
    pub fn failed(&mut self) -> SampleVerdict {
        self.figures.impossible += 1;
        SampleVerdict::Drop
    }

    /// Looks at a temperature, degrees Celsius, of `stamp_ns`.
    pub fn temperature(&mut self, temperature_c: f64, stamp_ns: i64) {
        if !POSSIBLE_C.contains(&temperature_c) {
            self.figures.temperature_steps += 1;
            return;
        }
        self.figures.temperature_c = Some(temperature_c);
        match self.reference {
            Some((reference_c, since_ns)) if (temperature_c - reference_c).abs() <= STEP_C => {
                if stamp_ns.saturating_sub(since_ns) >= STEP_NS {
                    self.reference = Some((temperature_c, stamp_ns));
                }
            }
            reference => {
                // After a silence it may be another.
                let is_step =
                    reference.is_some_and(|(_, since)| stamp_ns.saturating_sub(since) <= 2 * STEP_NS);
                self.figures.temperature_steps += u64::from(is_step);
                self.reference = Some((temperature_c, stamp_ns));
            }
        }
    }

    /// Counts so far.
    #[must_use]
    pub fn figures(&self) -> WatchFigures {
        self.figures
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch() -> SampleWatch {
        let mut imu = ImuConfig::with_noise(200.0, (1e-3, 1e-5), (1e-2, 1e-3));
        (imu.gyro_range_rad_s, imu.accel_range_m_s2) = (10.0, 100.0);
        SampleWatch::new(&imu)
    }

    fn of(x: f64) -> Vector3<f64> {
        Vector3::new(0.1, x, -0.1)
    }

    #[test]
    fn an_axis_at_the_end_of_its_range_is_flagged_and_handed_out() {
        let mut watch = watch();
        for (gyro, accel, flag) in
            [(9.9, 99.0, false), (-10.0, 1.0, false), (1.0, 99.99, false), (1.0, 2.0, true)]
        {
            assert_eq!(watch.look(&of(gyro), &of(accel), flag), SampleVerdict::Use);
        }
        assert_eq!(watch.figures().saturated, 3);
    }

    #[test]
    fn what_no_sensor_can_measure_is_not_handed_out() {
        let mut watch = watch();
        for (gyro, accel) in [(15.1, 0.0), (0.0, -151.0), (f64::NAN, 0.0), (0.0, f64::INFINITY)] {
            assert_eq!(watch.look(&of(gyro), &of(accel), false), SampleVerdict::Drop);
        }
        assert_eq!(watch.figures(), WatchFigures { impossible: 4, ..WatchFigures::default() });
    }

    #[test]
    fn a_sensor_that_repeats_itself_is_stuck_and_one_that_rests_is_not() {
        let mut watch = watch();
        let look = |watch: &mut SampleWatch, accel: f64| watch.look(&of(0.5), &of(accel), false);
        assert!((0..30).all(|_| look(&mut watch, 9.8) == SampleVerdict::Use));
        assert_eq!(watch.figures().stuck, 20);
        // At rest the last bit of one axis goes to and fro.
        assert!((1..31).all(|k| look(&mut watch, 9.8 + 1e-3 * f64::from(k % 3)) == SampleVerdict::Use));
        assert_eq!(watch.figures().stuck, 20);
    }

    #[test]
    fn a_step_of_the_temperature_counts_once_and_warming_up_does_not() {
        let mut watch = watch();
        let per_ms = |watch: &mut SampleWatch, from_ms: i64, to_ms: i64, at: &dyn Fn(i64) -> f64| {
            (from_ms..to_ms).for_each(|ms| watch.temperature(at(ms), ms * 1_000_000));
        };
        per_ms(&mut watch, 0, 20_000, &|ms| 20.0 + 1e-3 * ms as f64);
        assert_eq!(watch.figures().temperature_steps, 0);
        per_ms(&mut watch, 20_000, 25_000, &|_| 50.0);
        assert_eq!(watch.figures().temperature_steps, 1);
        per_ms(&mut watch, 60_000, 61_000, &|_| 20.0);
        assert_eq!(watch.figures().temperature_steps, 1, "after a silence it may be another");
        watch.temperature(999.0, 61_000_000_000);
        assert_eq!((watch.figures().temperature_steps, watch.figures().temperature_c), (2, Some(20.0)));
    }
}
