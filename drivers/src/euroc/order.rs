//! The order in which stamps were recorded: what is late, what is there twice, and a clock that stepped back.
//!
//! Messages that arrive late are put right by sorting. A clock that steps back is another thing: what follows is stamped into
//! the time of what came before, and sorting shuffles two stretches of a flight into each other. The two differ in the number
//! of samples: after a step the time that was passed through twice holds twice as many. A step to before the first sample needs
//! no count.

use crate::Faults;
use plumbline_config::Timestamp;

/// Forward steps longer than this are gaps, and do not count for the period, ns.
const GAP_NS: i64 = 1_000_000_000;
/// A step back is longer than so many periods: below, it is jitter.
const MIN_PERIODS: f64 = 2.0;
/// The time of a step holds so many times the samples of one pass.
const CROWDED: f64 = 1.5;
/// With more descending stamps than one in this many, the rows are shuffled and no clock is judged.
const SHUFFLED_ONE_IN: usize = 10;

/// Deviation of the recorded order from that of time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Order {
    /// Rows judged.
    pub(crate) rows: u64,
    /// Rows earlier than one before them, or with the stamp of another.
    pub(crate) disordered: u64,
    /// Rows with the stamp of another.
    pub(crate) repeated: u64,
    /// Times that the clock stepped back.
    pub(crate) steps_back: u64,
    /// Largest of these steps, ns.
    pub(crate) longest_step_back_ns: u64,
    /// Stamp before the largest step.
    pub(crate) step_at: Timestamp,
}

impl Order {
    /// Judges stamps in the order in which they were recorded.
    pub(crate) fn of(stamps: &[Timestamp]) -> Self {
        let mut order = Self { rows: stamps.len() as u64, ..Self::default() };
        let mut latest = Timestamp::MIN;
        for stamp in stamps {
            order.disordered += u64::from(*stamp < latest);
            latest = latest.max(*stamp);
        }
        let mut sorted = stamps.to_vec();
        sorted.sort_unstable();
        order.repeated = sorted.windows(2).filter(|two| two[0] == two[1]).count() as u64;
        order.disordered += order.repeated;
        order.find_steps(stamps);
        order
    }

    /// Adds what is known of the order to what a source survived.
    pub(crate) fn add_to(&self, faults: &mut Faults) {
        faults.disordered += self.disordered;
        faults.repeated += self.repeated;
        faults.steps_back += self.steps_back;
        faults.longest_step_back_ns = faults.longest_step_back_ns.max(self.longest_step_back_ns);
    }

    /// The order of both together.
    pub(crate) fn with(self, other: &Self) -> Self {
        let larger = if other.longest_step_back_ns > self.longest_step_back_ns { other } else { &self };
        Self {
            rows: self.rows + other.rows,
            disordered: self.disordered + other.disordered,
            repeated: self.repeated + other.repeated,
            steps_back: self.steps_back + other.steps_back,
            ..*larger
        }
    }

    /// True if there are several rows, all with one stamp.
    pub(crate) fn is_constant(&self) -> bool {
        self.rows > 1 && self.repeated + 1 == self.rows
    }

    fn find_steps(&mut self, stamps: &[Timestamp]) {
        let descents = stamps.windows(2).filter(|two| two[1] < two[0]).count();
        let Some(period_ns) = mean_period_ns(stamps) else { return };
        if descents == 0 || descents * SHUFFLED_ONE_IN > stamps.len() {
            return;
        }
        // Counting looks at each row a few times at most, whatever the stamps are.
        let mut budget = 16 * stamps.len();
        let mut latest = stamps[0];
        for k in 1..stamps.len() {
            let (before, now) = (stamps[k - 1], stamps[k]);
            let back_ns = before.nanos_since(now);
            if back_ns > 0 && back_ns as f64 > MIN_PERIODS * period_ns {
                let passed = stamps[..k].iter().rev().take(budget).take_while(|stamp| **stamp >= now).count();
                let again = stamps[k..].iter().take(budget).take_while(|stamp| **stamp <= latest).count();
                budget = budget.saturating_sub(passed + again);
                let once = back_ns as f64 / period_ns;
                let is_before_all = passed == k && back_ns > GAP_NS;
                if is_before_all || (passed + again) as f64 > CROWDED * once + 1.0 {
                    // The clock itself went one period further.
                    self.add(back_ns.saturating_add(period_ns.round() as i64), before);
                }
            }
            latest = latest.max(now);
        }
    }

    fn add(&mut self, back_ns: i64, before: Timestamp) {
        self.steps_back += 1;
        let back_ns = back_ns.unsigned_abs();
        if back_ns > self.longest_step_back_ns {
            (self.longest_step_back_ns, self.step_at) = (back_ns, before);
        }
    }
}

/// Reason why rows that all have one stamp cannot be flown; `name` is their table or topic, `what` they are.
pub(crate) fn not_stamped(name: &str, what: &str, count: u64, stamp: Timestamp) -> String {
    format!(
        "{name} is not stamped: all {count} {what} have the stamp {}; let the driver write the time of measurement into each \
         (header.stamp in ROS), and record again",
        stamp.as_nanos()
    )
}

/// Mean distance of stamps that follow each other without a gap, ns.
fn mean_period_ns(stamps: &[Timestamp]) -> Option<f64> {
    let forward =
        stamps.windows(2).map(|two| two[1].nanos_since(two[0])).filter(|ns| (1..GAP_NS).contains(ns));
    let (count, sum_ns) =
        forward.fold((0_u64, 0_i64), |(count, sum), ns| (count + 1, sum.saturating_add(ns)));
    (count > 0).then(|| sum_ns as f64 / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn order(ms: impl IntoIterator<Item = i64>) -> Order {
        Order::of(&ms.into_iter().map(|ms| Timestamp::from_nanos(ms * MS)).collect::<Vec<_>>())
    }

    /// 200 Hz for 4 s; from 2 s on the clock is `by_ms` behind.
    fn stepped(by_ms: i64) -> Order {
        order((0..800).map(|k| if k < 400 { 5 * k } else { 5 * k - by_ms }))
    }

    #[test]
    fn late_shuffled_and_jittering_messages_are_no_step() {
        let late_one = order((0..400).map(|k| if k == 200 { 5 * k - 12 } else { 5 * k }));
        assert_eq!((late_one.steps_back, late_one.disordered), (0, 1));
        let late_block = order((0..100).chain(120..140).chain(100..120).chain(140..300).map(|k| 5 * k));
        assert_eq!((late_block.steps_back, late_block.disordered), (0, 20));
        let shuffled = order((0..600).map(|k| 5 * (k / 60 * 60 + (k * 37) % 60)));
        assert_eq!(shuffled.steps_back, 0);
        let jitter = order((0..600).map(|k| 5 * k + (k * k * 7) % 9));
        assert_eq!(jitter.steps_back, 0);
        let ahead = order((0..400).map(|k| if k == 200 { 5 * k + 500 } else { 5 * k }));
        assert_eq!((ahead.steps_back, ahead.repeated), (0, 1));
        assert_eq!(stepped(0), Order { rows: 800, ..Order::default() });
        assert_eq!(order([]), Order::default());
        assert!(order([0, 0]).is_constant() && !order([0]).is_constant() && !order([0, 0, 5]).is_constant());
    }

    #[test]
    fn bursts_are_judged_by_their_mean_rate() {
        let bursts =
            |back: i64| order((0..800).map(move |k| 25 * (k / 5) + k % 5 - if k < 400 { 0 } else { back }));
        assert_eq!(bursts(0), Order { rows: 800, ..Order::default() });
        assert_eq!(bursts(503).steps_back, 1);
    }

    #[test]
    fn stamps_at_the_ends_of_time_do_no_harm() {
        let extreme = [i64::MIN, i64::MAX, 0, 5, i64::MIN, 7].map(Timestamp::from_nanos);
        assert!(Order::of(&extreme).steps_back <= 2);
        let nested: Vec<Timestamp> =
            (0..20_000).map(|k| Timestamp::from_nanos(if k % 11 == 10 { 0 } else { k })).collect();
        let _ = Order::of(&nested);
    }
}
