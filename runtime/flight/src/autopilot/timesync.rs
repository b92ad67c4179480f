//! The difference between the autopilot's clock and ours, by MAVLink's TIMESYNC.
//!
//! A request carries our time; the answer brings it back with the autopilot's. Half the round trip is taken
//! for the way there, which is wrong by at most that half: so the quick round trips decide, and of these the
//! median.

use crate::schedule::ticker::Monotonic;
use plumbline_config::median_by;
use std::collections::VecDeque;
use std::time::Duration;

/// Between requests until locked, and then.
const PERIOD: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(1)];
/// Requests that may be under way.
const OUTSTANDING: usize = 16;
/// Round trips that are remembered.
const SAMPLES: usize = 16;
/// Round trips that lock.
const LOCK_SAMPLES: usize = 8;
/// Round trips are forgotten after this: two crystals 50 ppm apart go 1 ms apart in it, ns.
const MAX_AGE_NS: i64 = 20_000_000_000;
/// A longer round trip says nothing, ns.
const MAX_ROUND_TRIP_NS: i64 = 500_000_000;
/// A round trip is quick when it takes at most this longer than one and a half of the quickest, ns.
const QUICK_NS: i64 = 200_000;
/// A difference this far from the last, beyond what the round trip explains, is a jump of a clock, ns.
const JUMP_NS: i64 = 10_000_000;
/// Jumps in a row that are believed: the autopilot was started anew.
const JUMPS_BELIEVED: usize = 4;

/// Clocks of autopilots count from their start, or from 1970: none is beyond the year 2100, ns.
const LATEST_NS: i64 = 4_102_444_800 * 1_000_000_000;

/// One round trip.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Monotonic,
    round_trip_ns: i64,
    offset_ns: i64,
}

/// Asks, listens, and tells the difference of the clocks.
#[derive(Clone, Debug)]
pub struct TimeSync {
    outstanding: VecDeque<i64>,
    samples: VecDeque<Sample>,
    next: Monotonic,
    is_locked: bool,
    offset_ns: i64,
    jumps: usize,
}

impl Default for TimeSync {
    fn default() -> Self {
        Self {
            outstanding: VecDeque::with_capacity(OUTSTANDING),
            samples: VecDeque::with_capacity(SAMPLES),
            next: Monotonic(i64::MIN),
            is_locked: false,
            offset_ns: 0,
            jumps: 0,
        }
    }
}

impl TimeSync {
    /// Stamp to ask with (`ts1`, with `tc1` = 0), when it is time to.
    pub fn request(&mut self, now: Monotonic) -> Option<i64> {
        self.forget(now);
        if now < self.next {
            return None;
        }
        let period = PERIOD[usize::from(self.is_locked)];
        self.next = now.plus_nanos(period.as_nanos() as i64);
        if self.outstanding.len() == OUTSTANDING {
            self.outstanding.pop_front();
        }
        self.outstanding.push_back(now.0);
        Some(now.0)
    }

    /// Takes an answer that came at `now`; whether it was one to a question of ours.
    pub fn answer(&mut self, tc1: i64, ts1: i64, now: Monotonic) -> bool {
        let Some(asked) = self.outstanding.iter().position(|asked| *asked == ts1) else { return false };
        self.outstanding.remove(asked);
        let round_trip_ns = now.0.saturating_sub(ts1);
        if !(1..=LATEST_NS).contains(&tc1) || !(0..=MAX_ROUND_TRIP_NS).contains(&round_trip_ns) {
            return true;
        }
        let offset_ns = tc1.saturating_sub(ts1.saturating_add(round_trip_ns / 2));
        if self.is_locked && offset_ns.abs_diff(self.offset_ns) > (JUMP_NS + round_trip_ns) as u64 {
            self.jumps += 1;
            if self.jumps < JUMPS_BELIEVED {
                return true;
            }
            self.restart();
        }
        self.jumps = 0;
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(Sample { at: now, round_trip_ns, offset_ns });
        self.is_locked |= self.samples.len() >= LOCK_SAMPLES;
        self.offset_ns = self.median_of_the_quick();
        true
    }

    /// The autopilot's clock less ours, ns, once locked.
    pub fn offset_ns(&self) -> Option<i64> {
        self.is_locked.then_some(self.offset_ns)
    }

    /// The quickest round trip that is remembered, ns.
    pub fn round_trip_ns(&self) -> Option<i64> {
        self.samples.iter().map(|s| s.round_trip_ns).min()
    }

    /// Forgets what another clock was like.
    pub fn restart(&mut self) {
        self.samples.clear();
        self.outstanding.clear();
        self.next = Monotonic(i64::MIN);
        self.is_locked = false;
        self.jumps = 0;
    }

    /// Forgets round trips of long ago; without any, the lock is lost.
    fn forget(&mut self, now: Monotonic) {
        while self.samples.front().is_some_and(|s| now.0.saturating_sub(s.at.0) > MAX_AGE_NS) {
            self.samples.pop_front();
        }
        if self.samples.is_empty() && self.is_locked {
            self.restart();
        }
    }

    fn median_of_the_quick(&self) -> i64 {
        let quickest = self.round_trip_ns().unwrap_or(0);
        let limit = quickest + quickest / 2 + QUICK_NS;
        let quick = self.samples.iter().filter(|s| s.round_trip_ns <= limit);
        let mut offsets: Vec<i64> = quick.map(|s| s.offset_ns).collect();
        median_by(&mut offsets, Ord::cmp).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: i64 = 1_000_000;

    /// An exchange in which each way takes its time; the other clock is ahead by `offset`.
    fn exchange(sync: &mut TimeSync, now: i64, ways: (i64, i64), offset: i64) -> bool {
        let Some(ts1) = sync.request(Monotonic(now)) else { return false };
        sync.answer(now + ways.0 + offset, ts1, Monotonic(now + ways.0 + ways.1))
    }

    #[test]
    fn a_known_offset_is_found_within_a_second_in_spite_of_slow_answers() {
        let mut sync = TimeSync::default();
        let offset = -987_654_321_000;
        for k in 0..LOCK_SAMPLES as i64 {
            // Every third answer is held up by 30 ms.
            let back = if k % 3 == 0 { 30 * MS } else { MS / 2 };
            assert!(exchange(&mut sync, 2_000_000 * MS + k * 100 * MS, (MS / 2, back), offset));
        }
        assert!((sync.offset_ns().unwrap() - offset).abs() < MS / 10);
        assert_eq!(sync.round_trip_ns(), Some(MS));
    }

    #[test]
    fn it_asks_ten_times_a_second_until_locked_and_then_once() {
        let mut sync = TimeSync::default();
        let asked = |sync: &mut TimeSync, from_ms: i64| {
            (0..1000).filter(|k| exchange(sync, (from_ms + k) * MS, (0, 1000), 5 * MS)).count()
        };
        // The next is on its way when the last that was needed comes back.
        assert_eq!(asked(&mut sync, 1000), LOCK_SAMPLES + 1);
        assert_eq!(asked(&mut sync, 2000), 1);
    }

    #[test]
    fn answers_that_nobody_asked_for_are_refused() {
        let mut sync = TimeSync::default();
        let ts1 = sync.request(Monotonic(5 * MS)).unwrap();
        assert!(!sync.answer(7, ts1 + 1, Monotonic(6 * MS)));
        assert!(sync.answer(7 * MS, ts1, Monotonic(6 * MS)));
        assert!(!sync.answer(7 * MS, ts1, Monotonic(6 * MS)), "an answer counts once");
    }

    #[test]
    fn an_autopilot_that_was_started_anew_is_followed_and_a_single_jump_is_not() {
        let mut sync = TimeSync::default();
        for k in 0..10 {
            exchange(&mut sync, k * 100 * MS, (1000, 1000), 50_000 * MS);
        }
        let locked = sync.offset_ns().unwrap();
        assert!(exchange(&mut sync, 10_000 * MS, (1000, 1000), 90_000 * MS));
        assert_eq!(sync.offset_ns(), Some(locked));
        for k in 0..40 {
            exchange(&mut sync, 11_000 * MS + k * 1000 * MS, (1000, 1000), 100 * MS);
        }
        assert!((sync.offset_ns().unwrap() - 100 * MS).abs() < 2000);
    }

    #[test]
    fn a_time_that_no_clock_tells_is_not_believed() {
        let mut sync = TimeSync::default();
        for k in 0..40 {
            exchange(&mut sync, 1000 * MS + k * 100 * MS, (1000, 1000), 1 << 62);
        }
        assert_eq!(sync.offset_ns(), None);
        for k in 0..10 {
            exchange(&mut sync, 6000 * MS + k * 100 * MS, (1000, 1000), 5 * MS);
        }
        let locked = sync.offset_ns();
        assert!(locked.is_some());
        for k in 0..40 {
            exchange(&mut sync, 8000 * MS + k * 1000 * MS, (1000, 1000), 1 << 62);
        }
        // Without answers that count the lock is lost, and never moved there.
        assert!(sync.offset_ns().is_none_or(|offset| Some(offset) == locked));
    }

    #[test]
    fn without_answers_the_lock_is_lost() {
        let mut sync = TimeSync::default();
        for k in 0..10 {
            exchange(&mut sync, k * 100 * MS, (1000, 1000), 5 * MS);
        }
        assert!(sync.offset_ns().is_some());
        sync.request(Monotonic(60_000 * MS));
        assert_eq!(sync.offset_ns(), None);
    }

    proptest! {
        #[test]
        fn no_answer_makes_it_panic(tc1 in any::<i64>(), late in any::<i64>()) {
            let mut sync = TimeSync::default();
            for _ in 0..40 {
                let ts1 = sync.request(Monotonic(late)).unwrap_or(late);
                sync.answer(tc1, ts1, Monotonic(late.wrapping_add(3)));
                sync.restart();
            }
        }
    }
}
