//! Defects of the stamps of a device or a program, in words that name the clock found and the clock expected.

use std::fmt;

/// A stamp that in another unit is this near to a clock of the host is in that unit, ns: frames are seldom older.
const NEAR_NS: i64 = 10_000_000_000;
/// A device whose clock goes on slower by a unit, within this factor, counts in that unit.
const UNIT_FACTOR: i64 = 3;
/// Length of a window over which a device's clock is compared with the host's, ns.
const WINDOW_NS: i64 = 250_000_000;
/// Windows in a row that show the same, so that a stall of the host or a device that starts anew shows nothing.
const WINDOWS: u32 = 2;
/// Samples of a window that is judged.
const MIN_SAMPLES: u32 = 4;

/// Unit of time that nanoseconds were mistaken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeUnitName {
    /// Microseconds.
    Micros,
    /// Milliseconds.
    Millis,
    /// Seconds.
    Seconds,
}

impl TimeUnitName {
    const ALL: [(Self, i64); 3] =
        [(Self::Micros, 1_000), (Self::Millis, 1_000_000), (Self::Seconds, 1_000_000_000)];
}

impl fmt::Display for TimeUnitName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Micros => "microseconds",
            Self::Millis => "milliseconds",
            Self::Seconds => "seconds",
        })
    }
}

/// Defects of stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StampDefect {
    /// Stamps are 0.
    Zero,
    /// Stamps are in another unit than nanoseconds.
    Unit(TimeUnitName),
    /// Stamps are later than now, ns.
    Ahead(i64),
    /// Stamps are of another clock, this far behind the expected one, ns.
    OtherClock(i64),
    /// Stamps do not increase.
    Repeated,
}

/// Defect of the stamps of a source, with the first stamp that showed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StampProblem {
    /// Defect found.
    pub defect: StampDefect,
    /// The stamp as it was received.
    pub stamp: i64,
    /// The host's monotonic clock when it was received, ns.
    pub now_ns: i64,
}

impl StampProblem {
    /// Defect of a `stamp` that belongs to none of the host's clocks (monotonic and system, ns).
    pub fn of_stamp(stamp: i64, monotonic_ns: i64, system_ns: i64) -> Self {
        let is_of = |factor: i64| {
            let ns = stamp.saturating_mul(factor);
            [monotonic_ns, system_ns].iter().any(|now| now.saturating_sub(ns).saturating_abs() < NEAR_NS)
        };
        let unit = TimeUnitName::ALL.into_iter().find(|(_, factor)| stamp > 0 && is_of(*factor));
        let behind_ns = monotonic_ns.saturating_sub(stamp);
        let defect = match unit {
            _ if stamp == 0 => StampDefect::Zero,
            Some((unit, _)) => StampDefect::Unit(unit),
            None if (-NEAR_NS..0).contains(&behind_ns) => StampDefect::Ahead(behind_ns.saturating_neg()),
            None => StampDefect::OtherClock(behind_ns),
        };
        Self { defect, stamp, now_ns: monotonic_ns }
    }

    /// A stamp that is not after the one before.
    pub fn repeated(stamp: i64, now_ns: i64) -> Self {
        Self { defect: StampDefect::Repeated, stamp, now_ns }
    }

    /// Remembers what is wrong. The first stamp of a kind stays, so that messages do not change with every frame.
    pub fn note(problem: &mut Option<Self>, found: Self) {
        let is_same = problem.is_some_and(|known| {
            std::mem::discriminant(&known.defect) == std::mem::discriminant(&found.defect)
        });
        if !is_same {
            *problem = Some(found);
        }
    }

    /// Clock seen and clock expected, in words. `expected` names the expected clock.
    pub fn words(&self, expected: &str) -> String {
        let Self { defect, stamp, now_ns } = self;
        let seen = match defect {
            StampDefect::Zero => "stamps are 0".to_owned(),
            StampDefect::Unit(unit) => format!("stamps such as {stamp} are in {unit}"),
            StampDefect::Ahead(ns) => format!("stamps such as {stamp} are {:.3} s ahead", *ns as f64 * 1e-9),
            StampDefect::OtherClock(ns) => {
                let seconds = (*ns as f64 * 1e-9).abs();
                format!("stamps such as {stamp} are of another clock, {seconds:.1} s away")
            }
            StampDefect::Repeated => format!("stamps such as {stamp} are not after the ones before"),
        };
        format!("{seen}, where {expected} is expected (now {now_ns})")
    }
}

/// Compares how a device's clock and the host's go on. The offset of both may be anything, their pace may not.
#[derive(Clone, Debug, Default)]
pub struct StampPace {
    begin: Option<(i64, i64)>,
    last: i64,
    samples: u32,
    repeated: u32,
    suspect: Option<(StampDefect, u32)>,
    problem: Option<StampProblem>,
}

impl StampPace {
    /// Takes a sample of this device time, which arrived at this time of the host, ns.
    pub fn take(&mut self, device_ns: i64, arrival_ns: i64) {
        let Some((device_begin, host_begin)) = self.begin else {
            return self.restart(device_ns, arrival_ns);
        };
        self.samples += 1;
        self.repeated += u32::from(device_ns <= self.last);
        self.last = device_ns;
        let host_ns = arrival_ns.saturating_sub(host_begin);
        if host_ns < WINDOW_NS || self.samples < MIN_SAMPLES {
            return;
        }
        let defect = self.defect(device_ns.saturating_sub(device_begin), host_ns);
        let count = match (self.suspect, defect) {
            (Some((before, count)), Some(now)) if before == now => count + 1,
            _ => 1,
        };
        self.suspect = defect.map(|defect| (defect, count));
        match defect {
            None => self.problem = None,
            Some(defect) if count >= WINDOWS => {
                let found = StampProblem { defect, stamp: device_ns, now_ns: arrival_ns };
                StampProblem::note(&mut self.problem, found);
            }
            Some(_) => {}
        }
        self.restart(device_ns, arrival_ns);
    }

    /// Present defect of the device's stamps, if any.
    pub fn problem(&self) -> Option<StampProblem> {
        self.problem
    }

    fn restart(&mut self, device_ns: i64, arrival_ns: i64) {
        (self.begin, self.last) = (Some((device_ns, arrival_ns)), device_ns);
        (self.samples, self.repeated) = (0, 0);
    }

    fn defect(&self, device_ns: i64, host_ns: i64) -> Option<StampDefect> {
        if device_ns == 0 && self.last == 0 {
            return Some(StampDefect::Zero);
        }
        if device_ns <= 0 || 2 * self.repeated >= self.samples {
            return Some(StampDefect::Repeated);
        }
        let is_near =
            |there: i64| (there / UNIT_FACTOR..=there.saturating_mul(UNIT_FACTOR)).contains(&device_ns);
        let unit = TimeUnitName::ALL.into_iter().find(|(_, factor)| is_near(host_ns / factor));
        unit.map(|(unit, _)| StampDefect::Unit(unit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MONOTONIC_NS: i64 = 5_000_123_456_789;
    const SYSTEM_NS: i64 = 1_790_000_000_123_456_789;

    fn defect(stamp: i64) -> StampDefect {
        StampProblem::of_stamp(stamp, MONOTONIC_NS, SYSTEM_NS).defect
    }

    #[test]
    fn units_zeros_and_other_clocks_are_told_apart() {
        assert_eq!(defect(0), StampDefect::Zero);
        assert_eq!(defect(MONOTONIC_NS / 1_000), StampDefect::Unit(TimeUnitName::Micros));
        assert_eq!(defect(MONOTONIC_NS / 1_000_000), StampDefect::Unit(TimeUnitName::Millis));
        assert_eq!(defect(SYSTEM_NS / 1_000), StampDefect::Unit(TimeUnitName::Micros));
        assert_eq!(defect(SYSTEM_NS / 1_000_000), StampDefect::Unit(TimeUnitName::Millis));
        assert_eq!(defect(SYSTEM_NS / 1_000_000_000), StampDefect::Unit(TimeUnitName::Seconds));
        assert_eq!(defect(MONOTONIC_NS + 30_000_000), StampDefect::Ahead(30_000_000));
        assert!(matches!(defect(MONOTONIC_NS - 100_000_000_000), StampDefect::OtherClock(_)));
        let words = StampProblem::of_stamp(0, 7, 8).words("CLOCK_MONOTONIC");
        assert_eq!(words, "stamps are 0, where CLOCK_MONOTONIC is expected (now 7)");
    }

    /// Defect found in one second of samples at 200 Hz whose device time is `device` of their true time, ns.
    fn shown(device: impl Fn(i64) -> i64) -> Option<StampDefect> {
        let mut pace = StampPace::default();
        (0..200).map(|k| k * 5_000_000).for_each(|ns| pace.take(device(ns), 77_000_000_000 + ns));
        pace.problem().map(|problem| problem.defect)
    }

    #[test]
    fn the_pace_of_a_devices_clock_shows_its_unit_within_a_second() {
        assert_eq!(shown(|ns| ns), None);
        assert_eq!(shown(|ns| ns + ns / 20_000 + 9_000_000_000), None, "a crystal 50 ppm off");
        assert_eq!(shown(|ns| 1_000_000 + ns / 1_000), Some(StampDefect::Unit(TimeUnitName::Micros)));
        assert_eq!(shown(|ns| ns / 1_000_000), Some(StampDefect::Unit(TimeUnitName::Millis)));
        assert_eq!(shown(|_| 0), Some(StampDefect::Zero));
        assert_eq!(shown(|_| 44), Some(StampDefect::Repeated));
        assert_eq!(shown(|ns| ns / 10_000_000 * 10_000_000), Some(StampDefect::Repeated));
    }

    #[test]
    fn a_device_that_starts_anew_or_a_stall_of_the_host_shows_nothing() {
        assert_eq!(shown(|ns| if ns < 400_000_000 { ns } else { ns - 400_000_000 }), None);
        let mut pace = StampPace::default();
        for k in 0..200_i64 {
            let ns = k * 5_000_000;
            // Samples of 0.3 s arrive together.
            let arrival = if (200_000_000..500_000_000).contains(&ns) { 500_000_000 } else { ns };
            pace.take(ns, arrival);
            assert_eq!(pace.problem(), None, "{k}");
        }
    }
}
