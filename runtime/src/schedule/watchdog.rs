//! Heartbeats: every task says when it begins and ends a piece of work; who is silent for too long is named.
//!
//! A task that waits for its device is not stalled; one that waits for nothing, and does not come back, is.
//! To beat is one atomic store.

use super::tasks::{TaskId, TaskTable};
use super::ticker::Monotonic;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

/// How often the watchdog looks.
pub const WATCH_PERIOD: Duration = Duration::from_millis(10);
/// The heartbeat of a task that waits, or has ended.
const IDLE: i64 = i64::MIN;

/// The heartbeats of all tasks.
#[derive(Debug)]
pub struct Heartbeats([AtomicI64; TaskId::ALL.len()]);

impl Default for Heartbeats {
    fn default() -> Self {
        Self(std::array::from_fn(|_| AtomicI64::new(IDLE)))
    }
}

impl Heartbeats {
    /// The task is at work, and alive now.
    pub fn busy(&self, id: TaskId) {
        self.0[id as usize].store(Monotonic::now().0, Ordering::Relaxed);
    }

    /// The task is given work: if it was waiting, it is at work from now on, whether it wakes up or not.
    pub fn give(&self, id: TaskId) {
        let now = Monotonic::now().0;
        let _ = self.0[id as usize].compare_exchange(IDLE, now, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// The task waits for something that may take its time.
    pub fn idle(&self, id: TaskId) {
        self.0[id as usize].store(IDLE, Ordering::Relaxed);
    }

    /// How long the task has been at work without a sign of life.
    #[must_use]
    pub fn silence(&self, id: TaskId, now: Monotonic) -> Option<Duration> {
        let since = self.0[id as usize].load(Ordering::Relaxed);
        (since != IDLE).then(|| Duration::from_nanos((now.0 - since).max(0) as u64))
    }
}

/// What the watchdog found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// A task has been silent for longer than it may.
    Stalled(TaskId, Duration),
    /// It is back.
    Recovered(TaskId),
}

/// Looks at the heartbeats and tells what changed.
#[derive(Debug, Default)]
pub struct Watchdog {
    stalled: [bool; TaskId::ALL.len()],
    stalls: u64,
}

impl Watchdog {
    /// One look, at `now`.
    pub fn look(
        &mut self,
        table: &TaskTable,
        heartbeats: &Heartbeats,
        now: Monotonic,
        mut tell: impl FnMut(Finding),
    ) {
        for id in TaskId::ALL {
            let silence = heartbeats.silence(id, now).unwrap_or_default();
            let is_stalled = silence > table.row(id).stall - WATCH_PERIOD;
            if is_stalled && !self.stalled[id as usize] {
                self.stalls += 1;
                tell(Finding::Stalled(id, silence));
            } else if !is_stalled && self.stalled[id as usize] {
                tell(Finding::Recovered(id));
            }
            self.stalled[id as usize] = is_stalled;
        }
    }

    /// Whether a task is stalled that the odometry cannot do without.
    #[must_use]
    pub fn is_critical(&self) -> bool {
        self.stalled[TaskId::Tick as usize]
    }

    /// Stalls found so far.
    #[must_use]
    pub fn stalls(&self) -> u64 {
        self.stalls
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn a_silent_task_is_named_once_within_a_tenth_of_a_second_and_again_when_it_is_back() {
        let table = TaskTable::new(&Config::preset("sim").unwrap(), 1.0);
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.busy(TaskId::Window);
        let start = Monotonic::now();
        let mut named_after_ms = None;
        let mut findings = Vec::new();
        for look in 0..30 {
            let now = start.plus_nanos(look * 10_000_000);
            watchdog.look(&table, &heartbeats, now, |finding| {
                named_after_ms.get_or_insert(look * 10);
                findings.push(finding);
            });
        }
        assert!(matches!(findings[..], [Finding::Stalled(TaskId::Window, _)]), "{findings:?}");
        assert!(named_after_ms.unwrap() <= 100, "{named_after_ms:?}");
        assert!(!watchdog.is_critical());
        heartbeats.idle(TaskId::Window);
        watchdog.look(&table, &heartbeats, start.plus_nanos(1_000_000_000), |finding| findings.push(finding));
        assert_eq!(findings[1..], [Finding::Recovered(TaskId::Window)]);
    }

    #[test]
    fn a_task_that_does_not_wake_up_for_its_work_is_silent_from_then_on() {
        let heartbeats = Heartbeats::default();
        let later = Monotonic::now().plus_nanos(1_000_000_000);
        assert_eq!(heartbeats.silence(TaskId::Window, later), None);
        heartbeats.give(TaskId::Window);
        assert!(heartbeats.silence(TaskId::Window, later).unwrap() > Duration::from_millis(900));
    }

    #[test]
    fn a_task_that_waits_for_its_device_is_not_stalled() {
        let table = TaskTable::new(&Config::preset("sim").unwrap(), 1.0);
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.busy(TaskId::Camera);
        heartbeats.idle(TaskId::Camera);
        let later = Monotonic::now().plus_nanos(60_000_000_000);
        watchdog.look(&table, &heartbeats, later, |finding| panic!("{finding:?}"));
        assert_eq!(watchdog.stalls(), 0);
    }
}
