//! Thins messages out by the time of their data.

use plumbline_config::Timestamp;

/// Stamps jitter: a sample that is early by so much counts for its place on the grid, ns.
const JITTER_NS: i64 = 2_000_000;

/// Lets messages through at a rate of data time, without drift: a grid of due times, of which none is made
/// up for.
#[derive(Clone, Debug)]
pub struct Pace {
    period_ns: Option<i64>,
    due: Option<Timestamp>,
}

impl Pace {
    /// At `rate_hz` at most.
    pub fn new(rate_hz: f64) -> Self {
        Self { period_ns: (rate_hz > 0.0).then(|| (1e9 / rate_hz) as i64), due: None }
    }

    /// True if the message of `stamp` is sent.
    pub fn admits(&mut self, stamp: Timestamp) -> bool {
        let Some(period_ns) = self.period_ns else { return false };
        let due = *self.due.get_or_insert(stamp);
        let late_ns = stamp.nanos_since(due);
        // A clock that was set back starts the grid anew.
        if (-4 * period_ns..-(period_ns / 8).min(JITTER_NS)).contains(&late_ns) {
            return false;
        }
        let next = if late_ns.abs() > period_ns { stamp } else { due };
        self.due = Some(next.plus_nanos(period_ns));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn admitted(rate_hz: f64, source_hz: f64, seconds: f64) -> usize {
        let mut pace = Pace::new(rate_hz);
        let count = (seconds * source_hz) as i64;
        (0..count).filter(|k| pace.admits(Timestamp::from_nanos(k * (1e9 / source_hz) as i64))).count()
    }

    #[test]
    fn messages_are_thinned_to_the_rate() {
        assert_eq!(admitted(50.0, 200.0, 10.0), 500);
        assert_eq!(admitted(10.0, 200.0, 10.0), 100);
        assert_eq!(admitted(2.0, 20.0, 10.0), 20);
        assert!((295..=305).contains(&admitted(30.0, 200.0, 10.0)));
    }

    #[test]
    fn everything_and_nothing_are_rates_too() {
        assert_eq!(admitted(f64::INFINITY, 200.0, 1.0), 200);
        assert_eq!(admitted(0.0, 200.0, 1.0), 0);
    }

    #[test]
    fn a_gap_is_not_made_up_for_and_a_clock_set_back_does_not_silence() {
        let mut pace = Pace::new(10.0);
        let at = |s: f64| Timestamp::default().plus_seconds(s);
        assert!(pace.admits(at(0.0)));
        assert!(pace.admits(at(5.0)));
        assert!(!pace.admits(at(5.05)));
        assert!(pace.admits(at(5.1)));
        assert!(pace.admits(at(1.0)));
        assert!(!pace.admits(at(1.05)));
    }
}
