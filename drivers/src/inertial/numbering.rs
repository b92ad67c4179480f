//! Numbers for samples, so that losses show: by the device's own counter where there is one, else by time.

/// Intervals that the period is the median of.
const INTERVALS: usize = 31;
/// An interval of so many periods lacks a sample.
const LACKING: f64 = 1.5;
/// A counter that jumps further was started anew, or hit: time decides.
const FURTHEST: i64 = 1_000_000;

/// Numbers samples from 0.
#[derive(Clone, Debug)]
pub struct Numbering {
    /// Number, counter and time of the last sample.
    last: Option<(u64, Option<i64>, i64)>,
    intervals_ns: [i64; INTERVALS],
    seen: usize,
    missing: u64,
}

impl Numbering {
    /// For a sensor that should give so many samples a second.
    pub fn new(rate_hz: f64) -> Self {
        let period_ns = (1e9 / rate_hz).round() as i64;
        Self { last: None, intervals_ns: [period_ns; INTERVALS], seen: 0, missing: 0 }
    }

    /// The number of a sample; its device's counter never begins anew. Stamps rise, ns.
    pub fn next(&mut self, counter: Option<i64>, stamp_ns: i64) -> u64 {
        let Some((number, last_counter, last_ns)) = self.last else {
            self.last = Some((0, counter, stamp_ns));
            return 0;
        };
        let interval_ns = stamp_ns.saturating_sub(last_ns).max(1);
        let counted = match (counter, last_counter) {
            (Some(counter), Some(last)) => {
                Some(counter.saturating_sub(last)).filter(|c| (1..FURTHEST).contains(c))
            }
            _ => None,
        };
        let steps = counted.unwrap_or_else(|| self.steps_in(interval_ns)) as u64;
        self.missing += steps - 1;
        self.intervals_ns[self.seen % INTERVALS] = interval_ns;
        self.seen = self.seen.wrapping_add(1);
        let number = number.saturating_add(steps);
        self.last = Some((number, counter, stamp_ns));
        number
    }

    /// Samples that were lost so far.
    pub fn missing(&self) -> u64 {
        self.missing
    }

    fn period_ns(&self) -> i64 {
        let mut sorted = self.intervals_ns;
        sorted.sort_unstable();
        sorted[INTERVALS / 2].max(1)
    }

    /// Periods in an interval: at least one.
    fn steps_in(&self, interval_ns: i64) -> i64 {
        let periods = interval_ns as f64 / self.period_ns() as f64;
        if periods < LACKING { 1 } else { periods.round() as i64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn the_devices_counter_tells_losses() {
        let mut numbering = Numbering::new(200.0);
        let numbers: Vec<u64> = [7, 8, 11, 12]
            .iter()
            .enumerate()
            .map(|(k, c)| numbering.next(Some(*c), k as i64 * 5 * MS))
            .collect();
        assert_eq!(numbers, [0, 1, 4, 5]);
        assert_eq!(numbering.missing(), 2);
    }

    #[test]
    fn without_a_counter_time_does() {
        let mut numbering = Numbering::new(200.0);
        let stamps = (0..100_i64).filter(|k| !(40..43).contains(k)).map(|k| k * 5 * MS + k % 3 * MS / 2);
        let last = stamps.map(|stamp| numbering.next(None, stamp)).last();
        assert_eq!((last, numbering.missing()), (Some(99), 3));
    }

    #[test]
    fn a_sensor_with_another_rate_than_was_said_lacks_nothing_once_its_rate_is_known() {
        let mut numbering = Numbering::new(200.0);
        let all: Vec<u64> = (0..200_i64).map(|k| numbering.next(None, k * 20 * MS)).collect();
        assert!(all[20..].windows(2).all(|pair| pair[1] == pair[0] + 1), "{all:?}");
    }

    #[test]
    fn a_counter_that_was_started_anew_is_told_by_time() {
        let mut numbering = Numbering::new(200.0);
        numbering.next(Some(1_000_000), 0);
        assert_eq!(numbering.next(Some(0), 50 * MS), 10);
        assert_eq!(numbering.next(Some(i64::MAX), 55 * MS), 11);
        assert_eq!(numbering.next(None, 60 * MS), 12);
    }
}
