//! Pauses before a process that died is started again.

use std::time::{Duration, Instant};

/// A process that lived for so long is started again at once.
const SETTLED: Duration = Duration::from_secs(2);
/// Pause before another start: doubles with every death that comes soon.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// Pause after the newest life of a process.
#[derive(Debug)]
pub struct Restarts {
    begun: Instant,
    pause: Duration,
}

impl Restarts {
    /// Begins with the first life.
    pub fn new() -> Self {
        Self { begun: Instant::now(), pause: Duration::ZERO }
    }

    /// True if the process has lived for long.
    pub fn is_settled(&self) -> bool {
        self.begun.elapsed() >= SETTLED
    }

    /// Waits after a death by `wait`, which returns true to give up; then the next life begins.
    pub fn is_over(&mut self, wait: impl FnOnce(Duration) -> bool) -> bool {
        let longer = (2 * self.pause).clamp(FIRST_PAUSE, LONGEST_PAUSE);
        self.pause = if self.is_settled() { Duration::ZERO } else { longer };
        let is_over = wait(self.pause);
        self.begun = Instant::now();
        is_over
    }
}
