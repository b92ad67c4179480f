//! When a change of state is worth telling: at once where it is for the worse, else when it has lasted.

use std::time::{Duration, Instant};

/// The state before a vehicle has said any, and while it has no pose yet.
const UNKNOWN: &str = "unknown";
const BEGINNING: &str = "initialising";
/// The state when all is well.
const WELL: &str = "tracking";
/// Being well again is told when it has lasted so long: a state that flickers is told once.
const LASTING: Duration = Duration::from_secs(1);

/// What was told of a vehicle's state.
#[derive(Clone, Debug)]
pub struct StateNews {
    told: &'static str,
    /// Well since then, which is still to be told.
    well_since: Option<Instant>,
}

impl Default for StateNews {
    fn default() -> Self {
        Self { told: UNKNOWN, well_since: None }
    }
}

impl StateNews {
    /// Whether `words`, the state at `now`, are to be told; they then count as told.
    pub fn is_due(&mut self, words: &'static str, now: Instant) -> bool {
        if words == self.told {
            self.well_since = None;
            return false;
        }
        if words == WELL && ![UNKNOWN, BEGINNING].contains(&self.told) {
            let since = *self.well_since.get_or_insert(now);
            if now.saturating_duration_since(since) < LASTING {
                return false;
            }
        }
        *self = Self { told: words, well_since: None };
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
