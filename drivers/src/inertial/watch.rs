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
/// Counts of faulty samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct WatchFigures {
    /// With an axis at the end of its range, by their numbers or by what the device says.
    pub saturated: u64,
    /// Samples that repeated the ones before.
    pub stuck: u64,
    /// Samples that the device marked failed or that no sensor can measure: dropped.
    pub impossible: u64,
}

/// Looks at samples.
#[derive(Clone, Debug)]
pub struct SampleWatch {
    gyro_range: f64,
    accel_range: f64,
    last: Option<(Vector3<f64>, Vector3<f64>)>,
    repeats: u32,
    figures: WatchFigures,
}

impl SampleWatch {
    /// For a sensor of these ranges.
    pub fn new(imu: &ImuConfig) -> Self {
        Self {
            gyro_range: imu.gyro_range_rad_s,
            accel_range: imu.accel_range_m_s2,
            last: None,
            repeats: 0,
            figures: WatchFigures::default(),
        }
    }

    /// Looks at a sample, rad/s and m/s², and says whether it is to be handed out; `is_flagged` when the device itself says
    /// that a range was exceeded.
    pub fn look(&mut self, gyro: &Vector3<f64>, accel: &Vector3<f64>, is_flagged: bool) -> bool {
        let is_sound = |v: &Vector3<f64>, range: f64| v.iter().all(|x| x.abs() <= IMPOSSIBLE * range);
        if !is_sound(gyro, self.gyro_range) || !is_sound(accel, self.accel_range) {
            self.failed();
            return false;
        }
        let is_at_end = |v: &Vector3<f64>, range: f64| v.iter().any(|x| x.abs() >= AT_END * range);
        let is_saturated =
            is_flagged || is_at_end(gyro, self.gyro_range) || is_at_end(accel, self.accel_range);
        self.figures.saturated += u64::from(is_saturated);
        let is_repeated = self.last.is_some_and(|last| last == (*gyro, *accel));
        self.repeats = if is_repeated { self.repeats.saturating_add(1) } else { 0 };
        self.figures.stuck += u64::from(self.repeats >= STUCK);
        self.last = Some((*gyro, *accel));
        true
    }

    /// A sample that the device itself calls failed.
    pub fn failed(&mut self) {
        self.figures.impossible += 1;
    }

    /// Counts so far.
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
            assert!(watch.look(&of(gyro), &of(accel), flag));
        }
        assert_eq!(watch.figures().saturated, 3);
    }

    #[test]
    fn what_no_sensor_can_measure_is_not_handed_out() {
        let mut watch = watch();
        for (gyro, accel) in [(15.1, 0.0), (0.0, -151.0), (f64::NAN, 0.0), (0.0, f64::INFINITY)] {
            assert!(!watch.look(&of(gyro), &of(accel), false));
        }
        assert_eq!(watch.figures(), WatchFigures { impossible: 4, ..WatchFigures::default() });
    }

    #[test]
    fn a_sensor_that_repeats_itself_is_stuck_and_one_that_rests_is_not() {
        let mut watch = watch();
        let look = |watch: &mut SampleWatch, accel: f64| watch.look(&of(0.5), &of(accel), false);
        assert!((0..30).all(|_| look(&mut watch, 9.8)));
        assert_eq!(watch.figures().stuck, 20);
        // At rest the last bit of one axis goes to and fro.
        assert!((1..31).all(|k| look(&mut watch, 9.8 + 1e-3 * f64::from(k % 3))));
        assert_eq!(watch.figures().stuck, 20);
    }
}
