//! Fixed-rate releases on absolute deadlines of the monotonic clock: a late release does not move the next.

use rustix::thread::{ClockId, Timespec, clock_nanosleep_absolute};
use std::time::Duration;

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// A time of the monotonic clock, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Monotonic(pub i64);

impl Monotonic {
    /// Now.
    pub fn now() -> Self {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        Self(time.tv_sec * NANOS_PER_SECOND + time.tv_nsec)
    }

    /// Returns the time `nanos` later.
    #[must_use]
    pub fn plus_nanos(self, nanos: i64) -> Self {
        Self(self.0.saturating_add(nanos))
    }

    /// Milliseconds since `earlier`, negative before it.
    #[must_use]
    pub fn ms_since(self, earlier: Self) -> f64 {
        (self.0 - earlier.0) as f64 * 1e-6
    }

    /// Sleeps until this time; returns at once when it has passed.
    pub fn sleep_until(self) {
        let time = Timespec {
            tv_sec: self.0.div_euclid(NANOS_PER_SECOND),
            tv_nsec: self.0.rem_euclid(NANOS_PER_SECOND),
        };
        // Interrupted by a signal, the sleep goes on: the deadline is absolute.
        while clock_nanosleep_absolute(ClockId::Monotonic, &time) == Err(rustix::io::Errno::INTR) {}
    }
}

/// Releases every `period`.
#[derive(Clone, Copy, Debug)]
pub struct Ticker {
    next: Monotonic,
    period_ns: i64,
}

/// One release.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release {
    /// Time at which it was due.
    pub due: Monotonic,
    /// Lateness of the thread, ms.
    pub late_ms: f64,
    /// Releases that passed unseen since the last.
    pub missed: u64,
}

impl Ticker {
    /// The first release is at `first`.
    pub fn new(first: Monotonic, period: Duration) -> Self {
        Self { next: first, period_ns: i64::try_from(period.as_nanos()).unwrap_or(i64::MAX).max(1) }
    }

    /// Time at which the next release is due.
    pub fn due(&self) -> Monotonic {
        self.next
    }

    /// Time until the next release.
    pub fn until_next(&self) -> Duration {
        Duration::from_nanos(u64::try_from(self.next.0 - Monotonic::now().0).unwrap_or(0))
    }

    /// Sleeps until the next release. One that is more than a period late stands for those it missed.
    pub fn wait(&mut self) -> Release {
        self.next.sleep_until();
        let now = Monotonic::now();
        let late_ns = (now.0 - self.next.0).max(0);
        let release = Release {
            due: self.next,
            late_ms: late_ns as f64 * 1e-6,
            missed: (late_ns / self.period_ns) as u64,
        };
        self.next = self.next.plus_nanos(self.period_ns * (1 + late_ns / self.period_ns));
        release
    }
}

#[cfg(test)]
mod realtime {
    use super::*;

    #[test]
    fn releases_keep_to_their_grid_and_count_what_they_missed() {
        let start = Monotonic::now();
        let mut ticker = Ticker::new(start.plus_nanos(2_000_000), Duration::from_millis(2));
        assert_eq!(ticker.wait().due, start.plus_nanos(2_000_000));
        std::thread::sleep(Duration::from_millis(7));
        let late = ticker.wait();
        assert!(late.missed >= 2 && late.late_ms >= 4.0, "{late:?}");
        let next = ticker.wait();
        assert_eq!((next.due.0 - start.0) % 2_000_000, 0);
        assert!(next.due.0 - late.due.0 >= 6_000_000);
    }
}
