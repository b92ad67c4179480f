//! Rate limit of requests for states at instants.

use std::time::Instant;

/// Answers a second in all, and those of one reader: the thread of the odometry gives them.
const RATE: f64 = 2_000.0;
const RATE_OF_A_READER: f64 = 1_000.0;
/// Largest burst of answers, s of the rate.
const BURST_S: f64 = 0.2;

/// Allowance that grows with time.
#[derive(Clone, Copy, Debug)]
pub struct Allowance {
    left: f64,
    rate: f64,
    since: Instant,
}

impl Allowance {
    fn new(rate: f64) -> Self {
        Self { left: rate * BURST_S, rate, since: Instant::now() }
    }

    /// Allowance of all readers together.
    pub(super) fn of_all() -> Self {
        Self::new(RATE)
    }

    /// Allowance of one reader.
    pub fn of_a_reader() -> Self {
        Self::new(RATE_OF_A_READER)
    }

    /// Takes one, if it is there.
    pub(super) fn take(&mut self) -> bool {
        let now = Instant::now();
        let earned = now.saturating_duration_since(self.since).as_secs_f64() * self.rate;
        (self.left, self.since) = ((self.left + earned).min(self.rate * BURST_S), now);
        let is_allowed = self.left >= 1.0;
        self.left -= f64::from(u8::from(is_allowed));
        is_allowed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn an_allowance_is_spent_and_earned_again() {
        let mut allowance = Allowance::of_a_reader();
        let taken = (0..1_000).filter(|_| allowance.take()).count();
        assert!((200..300).contains(&taken), "{taken}");
        allowance.since -= Duration::from_millis(100);
        let taken = (0..1_000).filter(|_| allowance.take()).count();
        assert!((100..200).contains(&taken), "{taken}");
    }
}
