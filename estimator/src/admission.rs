//! Admission of inertial samples that a sensor can have measured, and of stamps in order.
//!
//! A clock may jump. One stamp far ahead must not make every later one count as old, and a clock that was set must not end a
//! flight. So a stamp is believed if it is later than the last one, and by no more than a hole in the stream may last; any
//! other is refused. Refused stamps that follow one another as those of a running clock do are believed after a
//! while: the clock was set, and time goes on from there.

use crate::input::ImuAdmission;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};

/// The longest hole in a stream whose next stamp is believed at once, ns: a stall of host, line or camera is shorter. After a
/// longer one a fraction of a second more is lost, until it is plain that the clock runs.
pub const MAX_HOLE_NS: i64 = 500_000_000;
/// Inertial samples follow one another within this, ns: at 100 Hz, the slowest sensors that fly, every fifth arrives.
const IMU_STEP_NS: i64 = 50_000_000;
/// Inertial samples must have followed one another for this time before their clock is believed again, ns: longer than
/// any burst of garbage on a line, and a tenth of the second within which the estimate must be back.
const IMU_RUN_NS: i64 = 100_000_000;
/// Consecutive frames needed before their clock is believed again: two may be wrong by one fault of a driver.
const FRAME_RUN: u32 = 3;
/// Frames are old beyond this against the inertial samples, ns: their way through driver and front-end takes no second.
const MAX_FRAME_AGE_NS: i64 = 1_000_000_000;
/// A reading beyond its sensor's range by this factor is a fault of the line: full scale is nominal, offset and scale are off
/// by percents, and no sensor reads twice as much.
const MAX_RANGES: f64 = 2.0;

/// Verdict on a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StampVerdict {
    /// It follows the last one.
    Follows,
    /// Not later than the last one.
    NotLater,
    /// Too far ahead of everything else.
    FarAhead,
    /// It does not follow what was believed before, but others that were refused: from here on time goes on anew.
    ClockSet,
}

/// Refused stamps that follow one another.
#[derive(Clone, Copy, Debug)]
struct Run {
    first: Timestamp,
    last: Timestamp,
    count: u32,
}

/// The stamps of one stream.
#[derive(Clone, Debug)]
pub struct StampGate {
    step_ns: i64,
    run_ns: i64,
    run_count: u32,
    newest: Option<Timestamp>,
    run: Option<Run>,
}

impl StampGate {
    /// Creates the gate for inertial samples.
    #[must_use]
    pub const fn of_imu() -> Self {
        Self { step_ns: IMU_STEP_NS, run_ns: IMU_RUN_NS, run_count: 2, newest: None, run: None }
    }

    /// Creates the gate for frames.
    #[must_use]
    pub const fn of_frames() -> Self {
        Self { step_ns: MAX_HOLE_NS, run_ns: 0, run_count: FRAME_RUN, newest: None, run: None }
    }

    /// The last stamp that was believed.
    pub const fn newest(&self) -> Option<Timestamp> {
        self.newest
    }

    /// Forgets everything: the next stamp is believed.
    pub fn clear(&mut self) {
        (self.newest, self.run) = (None, None);
    }

    /// True if `stamp` is later than the last believed one.
    pub fn is_later(&self, stamp: Timestamp) -> bool {
        self.newest.is_none_or(|newest| stamp > newest)
    }

    /// True if `stamp` follows the last one; `other` is the newest stamp of the other stream, if there is
    /// one.
    pub fn follows(&self, stamp: Timestamp, other: Option<Timestamp>) -> bool {
        let latest = self.newest.max(other);
        self.is_later(stamp) && latest.is_none_or(|latest| stamp <= latest.plus_nanos(MAX_HOLE_NS))
    }

    /// Judges the next stamp of the stream. A clock that was set is believed only if it agrees with `other`, the newest
    /// stamp of the stream that this one belongs to.
    pub fn admit(&mut self, stamp: Timestamp, other: Option<Timestamp>) -> StampVerdict {
        let verdict = if self.follows(stamp, other) {
            StampVerdict::Follows
        } else if self.goes_on(stamp) && agrees(stamp, other) {
            StampVerdict::ClockSet
        } else if self.is_later(stamp) {
            return StampVerdict::FarAhead;
        } else {
            return StampVerdict::NotLater;
        };
        (self.newest, self.run) = (Some(stamp), None);
        verdict
    }

    /// True if so many refused stamps have followed one another, `stamp` the last of them, that their clock
    /// runs.
    fn goes_on(&mut self, stamp: Timestamp) -> bool {
        let run = match self.run {
            Some(run) if stamp > run.last && stamp.nanos_since(run.last) <= self.step_ns => {
                Run { last: stamp, count: run.count.saturating_add(1), ..run }
            }
            _ => Run { first: stamp, last: stamp, count: 1 },
        };
        self.run = Some(run);
        run.count >= self.run_count && stamp.nanos_since(run.first) >= self.run_ns
    }

    /// True if the next stamp of a run of refused ones would be believed.
    pub fn is_running(&self) -> bool {
        self.run.is_some_and(|run| run.count + 1 >= self.run_count)
    }
}

/// True if a frame's stamp agrees with the time of the inertial samples.
fn agrees(stamp: Timestamp, other: Option<Timestamp>) -> bool {
    let ages = -MAX_HOLE_NS..=MAX_FRAME_AGE_NS;
    other.is_none_or(|other| ages.contains(&other.nanos_since(stamp)))
}

/// Lets in inertial samples. The same samples find the same answers at every door.
#[derive(Clone, Debug)]
pub struct ImuDoor {
    gate: StampGate,
    max_gyro: f64,
    max_accel: f64,
}

impl ImuDoor {
    /// For the sensor of a configuration.
    #[must_use]
    pub fn of(imu: &ImuConfig) -> Self {
        Self {
            gate: StampGate::of_imu(),
            max_gyro: MAX_RANGES * imu.gyro_range_rad_s,
            max_accel: MAX_RANGES * imu.accel_range_m_s2,
        }
    }

    /// The stamp of the last sample that was let in.
    pub const fn newest(&self) -> Option<Timestamp> {
        self.gate.newest()
    }

    /// Forgets the stamps.
    pub fn clear(&mut self) {
        self.gate.clear();
    }

    /// True if a sample follows those before it and can have been measured.
    pub fn expects(&self, sample: &ImuSample) -> bool {
        self.fault(sample).is_none() && self.gate.follows(sample.stamp, None)
    }

    /// Judges a sample.
    pub fn admit(&mut self, sample: &ImuSample) -> ImuAdmission {
        self.fault(sample).unwrap_or_else(|| match self.gate.admit(sample.stamp, None) {
            StampVerdict::Follows => ImuAdmission::Accepted,
            StampVerdict::ClockSet => ImuAdmission::ClockSet,
            StampVerdict::NotLater => ImuAdmission::NotLater,
            StampVerdict::FarAhead => ImuAdmission::FarAhead,
        })
    }

    /// Reason why no sensor can have measured the sample, if any.
    fn fault(&self, sample: &ImuSample) -> Option<ImuAdmission> {
        if !sample.is_finite() {
            Some(ImuAdmission::NotFinite)
        } else if sample.gyro.amax() > self.max_gyro || sample.accel.amax() > self.max_accel {
            Some(ImuAdmission::OutOfRange)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use StampVerdict::{ClockSet, FarAhead, Follows, NotLater};

    const MS: i64 = 1_000_000;
    const HOUR_MS: i64 = 3_600_000;

    fn at(ms: i64) -> Timestamp {
        Timestamp::from_nanos(ms * MS)
    }

    /// Verdicts of samples every 5 ms, from one stamp to before another.
    fn run(gate: &mut StampGate, from_ms: i64, to_ms: i64) -> Vec<StampVerdict> {
        (from_ms / 5..to_ms / 5).map(|k| gate.admit(at(5 * k), None)).collect()
    }

    #[test]
    fn one_stamp_an_hour_ahead_is_refused_and_those_after_it_follow() {
        let mut gate = StampGate::of_imu();
        assert!(run(&mut gate, 0, 1000).iter().all(|v| *v == Follows));
        assert_eq!(gate.admit(at(HOUR_MS), None), FarAhead);
        assert_eq!(gate.admit(at(500), None), NotLater);
        assert!(run(&mut gate, 1000, 2000).iter().all(|v| *v == Follows));
    }

    #[test]
    fn a_first_stamp_an_hour_ahead_is_made_good_within_a_tenth_of_a_second() {
        let mut gate = StampGate::of_imu();
        assert_eq!(gate.admit(at(HOUR_MS), None), Follows);
        let verdicts = run(&mut gate, 0, 1000);
        assert!(verdicts[..20].iter().all(|v| *v == NotLater) && verdicts[20] == ClockSet, "{verdicts:?}");
        assert!(verdicts[21..].iter().all(|v| *v == Follows));
    }

    #[test]
    fn a_clock_that_was_set_is_believed_once_it_runs_and_again_when_it_is_set_right() {
        let mut gate = StampGate::of_imu();
        let _ = run(&mut gate, HOUR_MS, HOUR_MS + 500);
        let back = run(&mut gate, 0, 500);
        assert!(back[20] == ClockSet && back[21..].iter().all(|v| *v == Follows), "{back:?}");
        let right = run(&mut gate, HOUR_MS + 1000, HOUR_MS + 1500);
        assert!(right[..20].iter().all(|v| *v == FarAhead) && right[20] == ClockSet, "{right:?}");
    }

    #[test]
    fn stamps_that_stand_still_or_leap_are_no_clock_that_runs() {
        let mut gate = StampGate::of_imu();
        let _ = run(&mut gate, 1000, 1500);
        assert!((0..100).all(|_| gate.admit(at(7), None) == NotLater));
        assert!((0..100).all(|k| gate.admit(at(HOUR_MS + 500 * k), None) == FarAhead));
        assert_eq!(gate.admit(at(1500), None), Follows, "and nothing of it stays");
    }

    #[test]
    fn frames_are_judged_by_the_time_of_the_inertial_samples() {
        let mut gate = StampGate::of_frames();
        assert_eq!(gate.admit(at(HOUR_MS), Some(at(0))), FarAhead, "the first of all");
        assert_eq!(gate.admit(at(50), Some(at(55))), Follows);
        // Frames may be missing as long as the samples go on.
        assert_eq!(gate.admit(at(5000), Some(at(5000))), Follows);
        assert_eq!(gate.admit(at(7000), Some(at(5000))), FarAhead);
        // The camera's clock alone is an hour ahead: never.
        assert!((0..50).all(|k| gate.admit(at(HOUR_MS + 50 * k), Some(at(5000 + 50 * k))) == FarAhead));
        // Both were set back: after three frames.
        let verdicts: Vec<_> = (0..4).map(|k| gate.admit(at(50 * k), Some(at(50 * k)))).collect();
        assert_eq!(verdicts, [NotLater, NotLater, ClockSet, Follows]);
    }

    #[test]
    fn stamps_at_the_ends_of_time_are_judged() {
        let mut gate = StampGate::of_imu();
        for stamp in [Timestamp::MAX, Timestamp::MIN, at(0), Timestamp::MAX, Timestamp::MIN] {
            let _ = gate.admit(stamp, Some(Timestamp::MAX));
        }
    }

    #[test]
    fn readings_that_no_sensor_has_are_refused_and_leave_no_stamp() {
        let noise = ((1e-3, 1e-5), (1e-2, 1e-3));
        let imu = ImuConfig {
            gyro_error_sigma_rad_s: 0.0,
            accel_error_sigma_m_s2: 0.0,
            error_time_s: 1.5,
            gyro_scale_sigma: 0.0,
            accel_scale_sigma: 0.0,
            gyro_range_rad_s: 17.0,
            accel_range_m_s2: 150.0,
            ..ImuConfig::with_noise(200.0, noise.0, noise.1)
        };
        let mut door = ImuDoor::of(&imu);
        let sample = |ms: i64, gyro: f64, accel: f64| ImuSample {
            stamp: at(ms),
            gyro: nalgebra::Vector3::new(0.0, gyro, 0.0),
            accel: nalgebra::Vector3::new(0.0, 0.0, accel),
        };
        assert_eq!(door.admit(&sample(5, 16.0, -149.0)), ImuAdmission::Accepted);
        for (gyro, accel) in [(1e300, 0.0), (0.0, -1e300), (35.0, 0.0), (0.0, 301.0), (0.0, f64::MAX)] {
            assert_eq!(door.admit(&sample(400, gyro, accel)), ImuAdmission::OutOfRange, "{gyro} {accel}");
        }
        assert_eq!(door.admit(&sample(400, f64::NAN, 0.0)), ImuAdmission::NotFinite);
        // At full scale, and somewhat beyond, it is saturated: that is for the window to judge.
        assert_eq!(door.admit(&sample(10, -20.0, 160.0)), ImuAdmission::Accepted);
    }
}
