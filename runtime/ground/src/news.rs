//! Timing of events about a vehicle's state: at once when it gets worse, after a second when it recovers.

use std::time::{Duration, Instant};

/// The state before any message, and before the first pose.
const UNKNOWN: &str = "unknown";
const BEGINNING: &str = "initialising";
/// The state with a valid estimate.
const WELL: &str = "tracking";
/// A recovery is reported after this time, so that a state that flickers is reported once.
const LASTING: Duration = Duration::from_secs(1);

/// The state of a vehicle that was reported last.
#[derive(Clone, Debug)]
pub struct StateNews {
    reported: &'static str,
    /// Tracking again since then, not yet reported.
    well_since: Option<Instant>,
}

impl Default for StateNews {
    fn default() -> Self {
        Self { reported: UNKNOWN, well_since: None }
    }
}

impl StateNews {
    /// True if `state`, valid at `now`, becomes an event; it then counts as reported.
    pub fn is_due(&mut self, state: &'static str, now: Instant) -> bool {
        if state == self.reported {
            self.well_since = None;
            return false;
        }
        if state == WELL && ![UNKNOWN, BEGINNING].contains(&self.reported) {
            let since = *self.well_since.get_or_insert(now);
            if now.saturating_duration_since(since) < LASTING {
                return false;
            }
        }
        *self = Self { reported: state, well_since: None };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_that_flickers_is_told_once_and_its_end_when_it_has_lasted() {
        let (mut news, start) = (StateNews::default(), Instant::now());
        let mut told = Vec::new();
        for k in 0..400_u64 {
            // 2 s well, 4 s to and fro, then well.
            let words = if (40..120).contains(&k) && k % 2 == 0 { "blind" } else { "tracking" };
            if news.is_due(words, start + Duration::from_millis(50 * k)) {
                told.push((k, words));
            }
        }
        assert_eq!(told, [(0, "tracking"), (40, "blind"), (139, "tracking")]);
    }
}
