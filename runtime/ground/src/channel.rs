//! Statistics of the messages of one key: counts, rates, gaps and delays.

use hdrhistogram::Histogram;
use std::time::{Duration, Instant};

/// Data older than this are shown as stale.
pub const STALE_AFTER: Duration = Duration::from_millis(500);
/// Rates are measured over this time.
const RATE_WINDOW: Duration = Duration::from_secs(1);
/// Longest delay that the histogram resolves, us: a minute.
const MAX_DELAY_US: u64 = 60_000_000;

/// Where so many messages of a second, and this share of them, come behind a later one, there are two senders: another route, or
/// a sender that has restarted, does that to few.
const MIN_TURNS: u64 = 4;
const MIN_TURNED_SHARE: f64 = 0.25;

/// Keys have at most so many messages a second: a number that is further ahead is that of another sender, and none are lost.
const MOST_HZ: f64 = 2000.0;

/// A message that took another route can have been published this much before the newest, ns.
const LATEST_NS: i64 = 10_000_000_000;

/// Place of a message in the sequence of its key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SequencePlace {
    /// It is the newest.
    Next,
    /// A newer one has arrived already, by another route: its content is old.
    Late,
    /// The sender has restarted and counts from the beginning.
    Restarted,
}

/// Counts the messages of one key.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// Messages received.
    pub received: u64,
    /// Messages missing by their sequence numbers.
    pub lost: u64,
    /// Messages a second.
    pub rate_hz: f64,
    /// Bytes a second.
    pub bytes_per_s: f64,
    /// Share of the messages that arrived, over the last second with any.
    pub arrived: Option<f64>,
    /// True if two senders share the key, by the last second with any messages: their numbers go back and
    /// forth.
    pub is_shared: bool,
    /// Longest silence between two messages, s.
    pub longest_gap_s: f64,
    newest: Option<Newest>,
    was_away: bool,
    bytes: u64,
    last: Option<Instant>,
    window: Option<Window>,
    /// Number of the last message, in the order of arrival.
    last_sequence: u64,
    /// Messages whose number is below that of the one before.
    turns: u64,
}

/// The newest message so far.
#[derive(Clone, Copy, Debug)]
struct Newest {
    sequence: u64,
    published_ns: i64,
}

/// The counts when a window of time began.
#[derive(Clone, Copy, Debug)]
struct Window {
    since: Instant,
    received: u64,
    lost: u64,
    bytes: u64,
    turns: u64,
}

impl Channel {
    /// Counts a message of `bytes` that arrived at `now`.
    pub fn receive(&mut self, sequence: u64, published_ns: i64, bytes: usize, now: Instant) -> SequencePlace {
        self.received += 1;
        self.bytes += bytes as u64;
        let place = self.place(sequence, published_ns);
        self.turns += u64::from(sequence < std::mem::replace(&mut self.last_sequence, sequence));
        if place == SequencePlace::Late {
            self.lost = self.lost.saturating_sub(1);
        } else {
            let was_away = std::mem::take(&mut self.was_away);
            if let Some(newest) = self.newest.filter(|_| !was_away) {
                let missing = sequence.saturating_sub(newest.sequence.saturating_add(1));
                let silent_s = self.age(now).unwrap_or_default().as_secs_f64();
                self.lost += if missing as f64 > MOST_HZ * (1.0 + silent_s) { 0 } else { missing };
            }
            self.newest = Some(Newest { sequence, published_ns });
        }
        if let Some(last) = self.last {
            self.longest_gap_s = self.longest_gap_s.max(now.duration_since(last).as_secs_f64());
        }
        self.last = Some(now);
        let (received, lost, bytes, turns) = (self.received, self.lost, self.bytes, self.turns);
        let window = *self.window.get_or_insert(Window { since: now, received, lost, bytes, turns });
        let elapsed_s = now.duration_since(window.since).as_secs_f64();
        if elapsed_s >= RATE_WINDOW.as_secs_f64() {
            let came = (received - window.received) as f64;
            self.rate_hz = came / elapsed_s;
            self.bytes_per_s = (bytes - window.bytes) as f64 / elapsed_s;
            // Late messages were counted as lost before they arrived.
            let missing = lost.saturating_sub(window.lost) as f64;
            self.arrived = Some(came / (came + missing).max(1.0));
            let turned = turns - window.turns;
            self.is_shared = turned >= MIN_TURNS && turned as f64 >= MIN_TURNED_SHARE * came;
            self.window = Some(Window { since: now, received, lost, bytes, turns });
        }
        place
    }

    fn place(&self, sequence: u64, published_ns: i64) -> SequencePlace {
        let Some(newest) = self.newest else { return SequencePlace::Next };
        if sequence > newest.sequence {
            return SequencePlace::Next;
        }
        // A restarted sender publishes later, unless its clock was set back.
        let overtaken_by_ns = newest.published_ns.saturating_sub(published_ns);
        let is_late = !self.was_away && (0..LATEST_NS).contains(&overtaken_by_ns);
        if is_late { SequencePlace::Late } else { SequencePlace::Restarted }
    }

    /// The sender was off the network: what it published meanwhile does not count as lost.
    pub fn reappear(&mut self) {
        self.was_away = true;
    }

    /// Time since the last message.
    pub fn age(&self, now: Instant) -> Option<Duration> {
        self.last.map(|last| now.saturating_duration_since(last))
    }

    /// True if the last message is older than [`STALE_AFTER`].
    pub fn is_stale(&self, now: Instant) -> bool {
        self.age(now).is_none_or(|age| age > STALE_AFTER)
    }

    /// Messages a second at `now`: zero when none has arrived for two seconds.
    pub fn rate_hz(&self, now: Instant) -> f64 {
        if self.age(now).is_none_or(|age| age > 2 * RATE_WINDOW) { 0.0 } else { self.rate_hz }
    }
}

/// Delays from publication to reception, by the clocks of both hosts.
#[derive(Clone, Debug)]
pub struct Delays(Histogram<u64>);

impl Default for Delays {
    fn default() -> Self {
        // The bounds are constants that the library accepts.
        Self(Histogram::new_with_bounds(1, MAX_DELAY_US, 2).unwrap_or_else(|_| unreachable!("valid bounds")))
    }
}

impl Delays {
    /// Adds a delay; a negative one, which clocks that differ can give, counts as zero.
    pub fn record(&mut self, delay_ns: i64) {
        let us = u64::try_from(delay_ns / 1_000).unwrap_or(0);
        self.0.saturating_record(us.clamp(1, MAX_DELAY_US));
    }

    /// The delay that a share of the messages stayed below, ms; `None` before the first.
    pub fn quantile_ms(&self, share: f64) -> Option<f64> {
        (!self.0.is_empty()).then(|| self.0.value_at_quantile(share) as f64 * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_in_the_numbers_are_counted_and_a_restart_is_none() {
        let (mut channel, start) = (Channel::default(), Instant::now());
        for (k, sequence) in [0u64, 1, 4, 5].into_iter().enumerate() {
            channel.receive(sequence, k as i64, 10, start + Duration::from_millis(5 * k as u64));
        }
        assert_eq!((channel.received, channel.lost), (4, 2));
        channel.reappear();
        assert_eq!(channel.receive(1_000, 5, 10, start), SequencePlace::Next);
        assert_eq!(channel.receive(0, 6, 10, start), SequencePlace::Restarted);
        assert_eq!(channel.lost, 2);
    }

    #[test]
    fn a_number_that_no_sender_can_have_reached_is_no_loss() {
        let (mut channel, start) = (Channel::default(), Instant::now());
        let at = |ms: u64| start + Duration::from_millis(ms);
        channel.receive(0, 0, 10, at(0));
        channel.receive(1 << 63, 9_900_000_000, 10, at(5));
        channel.receive(2, 10_000_000, 10, at(10));
        assert_eq!((channel.received, channel.lost), (3, 0));
    }

    #[test]
    fn who_was_overtaken_on_another_way_is_late_and_not_lost() {
        let (mut channel, start) = (Channel::default(), Instant::now());
        let mut receive = |sequence: u64, published_ns| channel.receive(sequence, published_ns, 10, start);
        assert_eq!(
            [receive(7, 70), receive(9, 90), receive(8, 80)],
            [SequencePlace::Next, SequencePlace::Next, SequencePlace::Late]
        );
        assert_eq!(receive(10, 100), SequencePlace::Next);
        assert_eq!(channel.lost, 0);
        channel.reappear();
        assert_eq!(channel.receive(0, 50, 10, start), SequencePlace::Restarted, "its clock was set back");
    }

    #[test]
    fn a_message_that_is_late_by_more_than_a_window_does_no_harm() {
        let (mut channel, start) = (Channel::default(), Instant::now());
        let at = |s: u64| start + Duration::from_secs(s);
        channel.receive(0, 0, 10, at(0));
        channel.receive(2, 20, 10, at(2));
        assert_eq!(channel.lost, 1);
        assert_eq!(channel.receive(1, 10, 10, at(4)), SequencePlace::Late);
        assert_eq!((channel.lost, channel.arrived), (0, Some(1.0)));
    }

    #[test]
    fn rates_are_those_of_the_last_second_and_end_with_the_data() {
        let (mut channel, start) = (Channel::default(), Instant::now());
        for k in 0..=200u64 {
            channel.receive(k, k as i64, 100, start + Duration::from_millis(5 * k));
        }
        let now = start + Duration::from_secs(1);
        assert!((channel.rate_hz(now) - 200.0).abs() < 1.0);
        assert!((channel.bytes_per_s - 20_000.0).abs() < 100.0);
        assert_eq!(channel.arrived, Some(1.0));
        assert!(!channel.is_stale(now) && channel.is_stale(now + STALE_AFTER + STALE_AFTER));
        assert_eq!(channel.rate_hz(now + Duration::from_secs(3)), 0.0);
    }

    #[test]
    fn two_senders_are_told_from_a_restart_and_from_other_routes() {
        let is_shared = |numbers: &dyn Fn(u64) -> (u64, i64)| {
            let (mut channel, start) = (Channel::default(), Instant::now());
            for k in 0..500 {
                let (sequence, published_ns) = numbers(k);
                channel.receive(sequence, published_ns, 10, start + Duration::from_millis(5 * k));
            }
            channel.is_shared
        };
        let ms = |k: u64| k as i64 * 5_000_000;
        // In turns, whichever of the two began earlier, and whichever clock is behind.
        assert!(is_shared(&|k| (k / 2 + if k % 2 == 0 { 9_000 } else { 0 }, ms(k))));
        assert!(is_shared(&|k| (
            k / 2 + if k % 2 == 0 { 3 } else { 0 },
            ms(k) - (k % 2) as i64 * 1_000_000_000
        )));
        assert!(!is_shared(&|k| (k, ms(k))), "one");
        assert!(!is_shared(&|k| (k % 240, ms(k))), "one that restarts");
        assert!(!is_shared(&|k| (if k % 20 == 0 { k + 2 } else { k }, ms(k))), "one by two routes");
    }

    #[test]
    fn delays_have_quantiles_and_clocks_may_disagree() {
        let mut delays = Delays::default();
        assert_eq!(delays.quantile_ms(0.5), None);
        (1..=100).for_each(|k| delays.record(k * 1_000_000));
        delays.record(-5_000_000);
        assert!((delays.quantile_ms(0.5).unwrap() - 50.0).abs() < 1.5);
    }
}
