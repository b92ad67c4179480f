//! Measurement times on this host's monotonic clock.

use crate::pipeline::Stamps;
use crate::schedule::ticker::Monotonic;
use plumbline_config::Timestamp;

/// The smallest delay is taken over one to two times of this, ns.
const WINDOW_NS: i64 = 5_000_000_000;

/// Brings stamps to the host's monotonic clock. A replayed sample is taken to have been measured when it was
/// handed over, less what it was later than the promptest of the last seconds.
#[derive(Clone, Debug)]
pub struct StampClock {
    stamps: Stamps,
    began: Monotonic,
    /// Smallest delay of the window under way and of the one before, ns.
    smallest_ns: [i64; 2],
}

impl StampClock {
    /// A clock that has seen nothing.
    pub fn new(stamps: Stamps) -> Self {
        Self { stamps, began: Monotonic(i64::MIN), smallest_ns: [i64::MAX; 2] }
    }

    /// The time of the host at which the sample of `stamp`, handed over at `now`, was measured.
    pub fn measured(&mut self, stamp: Timestamp, now: Monotonic) -> Monotonic {
        let stamp_ns = stamp.as_nanos();
        if self.stamps == Stamps::OfHost {
            return Monotonic(stamp_ns);
        }
        let delay_ns = now.0.saturating_sub(stamp_ns);
        if now.0.saturating_sub(self.began.0) > WINDOW_NS {
            self.began = now;
            self.smallest_ns = [i64::MAX, self.smallest_ns[0]];
        }
        self.smallest_ns[0] = self.smallest_ns[0].min(delay_ns);
        let offset_ns = self.smallest_ns[0].min(self.smallest_ns[1]);
        Monotonic(stamp_ns.saturating_add(offset_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn a_sample_that_was_held_up_keeps_its_time() {
        let mut clock = StampClock::new(Stamps::Replayed);
        let start = 7_000_000 * MS;
        for k in 0..2000_i64 {
            let held_up = if k % 10 == 3 { 4 * MS } else { 0 };
            let due = start + k * 5 * MS;
            let stamp = Timestamp::from_nanos(1_403_715_273_000_000_000 + k * 5 * MS);
            assert_eq!(clock.measured(stamp, Monotonic(due + held_up)), Monotonic(due), "{k}");
        }
    }

    #[test]
    fn a_playback_that_was_paused_is_found_again() {
        let mut clock = StampClock::new(Stamps::Replayed);
        let mut measured = Monotonic(0);
        for k in 0..6000_i64 {
            let pause = if k > 1000 { 300 * MS } else { 0 };
            measured = clock.measured(Timestamp::from_nanos(k * 5 * MS), Monotonic(k * 5 * MS + pause));
        }
        assert_eq!(measured, Monotonic(5999 * 5 * MS + 300 * MS));
    }

    #[test]
    fn stamps_of_the_host_are_taken_as_they_are() {
        let mut clock = StampClock::new(Stamps::OfHost);
        assert_eq!(clock.measured(Timestamp::from_nanos(42), Monotonic(50)), Monotonic(42));
    }

    #[test]
    fn stamps_at_the_ends_of_time_do_no_harm() {
        let mut clock = StampClock::new(Stamps::Replayed);
        for stamp in [i64::MIN, i64::MAX, 0] {
            let _ = clock.measured(Timestamp::from_nanos(stamp), Monotonic(1));
        }
    }
}
