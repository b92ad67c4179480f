//! Heartbeats: every task says when it begins and ends a piece of work; who is silent for too long is named.
//!
//! A task that waits for its device is not stalled; one that waits for nothing, and does not come back, is; one that has
//! ended by a fault of its own is dead, which is neither. To beat is one atomic store.

use super::tasks::{TaskId, TaskTable, WATCH_PERIOD};
use super::ticker::Monotonic;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering};
use std::time::Duration;

/// The heartbeat of a task that waits, or is over.
const IDLE: i64 = i64::MIN;
/// Heartbeat of a task that has ended by a fault of its own.
const DEAD: i64 = i64::MIN + 1;

/// The heartbeat of one task.
#[derive(Debug)]
pub struct Pulse {
    id: TaskId,
    beat: AtomicI64,
    deaths: AtomicU32,
}

/// Meaning of a heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskSign {
    /// The task waits, or is over.
    Idle,
    /// It has been at work for so long without a sign of life.
    Busy(Duration),
    /// It has ended by a fault of its own.
    Dead,
}

impl Pulse {
    /// Creates the heartbeat of a task that waits.
    pub fn new(id: TaskId) -> Self {
        Self { id, beat: AtomicI64::new(IDLE), deaths: AtomicU32::new(0) }
    }

    /// Task of the heartbeat.
    pub fn id(&self) -> TaskId {
        self.id
    }

    /// The task is at work, and alive now.
    pub fn busy(&self) {
        self.beat.store(Monotonic::now().0, Ordering::Relaxed);
        #[cfg(feature = "sabotage")]
        super::sabotage::strike(self.id);
    }

    /// The task is given work: if it was waiting, it is at work from now on, whether it wakes up or not.
    pub fn give(&self) {
        let now = Monotonic::now().0;
        let _ = self.beat.compare_exchange(IDLE, now, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// The task waits for something that may take its time.
    pub fn idle(&self) {
        self.beat.store(IDLE, Ordering::Relaxed);
    }

    /// The task has ended by a fault of its own.
    pub fn die(&self) {
        self.beat.store(DEAD, Ordering::Relaxed);
        self.deaths.fetch_add(1, Ordering::Relaxed);
    }

    /// Number of times it has ended by a fault.
    pub fn deaths(&self) -> u32 {
        self.deaths.load(Ordering::Relaxed)
    }

    /// Sign at `now`.
    pub fn sign(&self, now: Monotonic) -> TaskSign {
        match self.beat.load(Ordering::Relaxed) {
            IDLE => TaskSign::Idle,
            DEAD => TaskSign::Dead,
            since => TaskSign::Busy(Duration::from_nanos((now.0 - since).max(0) as u64)),
        }
    }
}

/// The heartbeats of all tasks.
#[derive(Debug)]
pub struct Heartbeats([Arc<Pulse>; TaskId::ALL.len()]);

impl Default for Heartbeats {
    fn default() -> Self {
        Self(TaskId::ALL.map(|id| Arc::new(Pulse::new(id))))
    }
}

impl Heartbeats {
    /// Looks after a task that has a heartbeat of its own.
    pub fn adopt(&mut self, pulse: Arc<Pulse>) {
        let id = pulse.id();
        self.0[id as usize] = pulse;
    }

    /// Returns the heartbeat of a task.
    pub fn of(&self, id: TaskId) -> &Pulse {
        &self.0[id as usize]
    }

    /// The task is at work, and alive now.
    pub fn busy(&self, id: TaskId) {
        self.of(id).busy();
    }

    /// The task is given work: if it was waiting, it is at work from now on, whether it wakes up or not.
    pub fn give(&self, id: TaskId) {
        self.of(id).give();
    }

    /// The task waits for something that may take its time.
    pub fn idle(&self, id: TaskId) {
        self.of(id).idle();
    }
}

/// Change of a task's state that the watchdog detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskEvent {
    /// A task has been silent for longer than it may.
    Stalled(TaskId, Duration),
    /// A stalled task that is not expected to recover.
    Hopeless(TaskId),
    /// A task has ended by a fault of its own.
    Died(TaskId),
    /// A stalled task that runs again.
    Recovered(TaskId),
}

/// State of one task.
#[derive(Clone, Copy, Debug, Default)]
struct Watched {
    is_stalled: bool,
    is_dead: bool,
    is_given_up: bool,
    deaths: u32,
    /// Looks in a row at which it was stalled.
    stalled_looks: u32,
}

/// Looks at the heartbeats and tells what changed.
#[derive(Debug, Default)]
pub struct Watchdog {
    tasks: [Watched; TaskId::ALL.len()],
    stalls: u64,
    deaths: u64,
}

impl Watchdog {
    /// One look, at `now`. A host that stood still did so for the watchdog too: how long a task is waited for is counted in
    /// looks.
    pub fn look(
        &mut self,
        table: &TaskTable,
        heartbeats: &Heartbeats,
        now: Monotonic,
        mut tell: impl FnMut(TaskEvent),
    ) {
        for id in TaskId::ALL {
            let (pulse, task, row) = (heartbeats.of(id), &mut self.tasks[id as usize], table.row(id));
            let deaths = pulse.deaths();
            if std::mem::replace(&mut task.deaths, deaths) != deaths {
                self.deaths += 1;
                tell(TaskEvent::Died(id));
            }
            let sign = pulse.sign(now);
            let silence = if let TaskSign::Busy(silence) = sign { silence } else { Duration::ZERO };
            let before = *task;
            (task.is_stalled, task.is_dead) = (silence > row.stall - WATCH_PERIOD, sign == TaskSign::Dead);
            task.stalled_looks = if task.is_stalled { task.stalled_looks + 1 } else { 0 };
            if task.is_stalled && !before.is_stalled {
                self.stalls += 1;
                tell(TaskEvent::Stalled(id, silence));
            } else if (before.is_stalled || before.is_dead) && !task.is_stalled && !task.is_dead {
                tell(TaskEvent::Recovered(id));
            }
            let waited = row.stall + WATCH_PERIOD * task.stalled_looks;
            if task.is_stalled && !task.is_given_up && row.patience.is_some_and(|patience| waited > patience)
            {
                task.is_given_up = true;
                tell(TaskEvent::Hopeless(id));
            }
        }
    }

    /// True if there is no odometry because a task is stalled or dead: systemd then gets no sign of life.
    pub fn is_critical(&self) -> bool {
        [TaskId::Imu, TaskId::Tick]
            .map(|id| self.tasks[id as usize])
            .iter()
            .any(|t| t.is_stalled || t.is_dead)
    }

    /// Stalls found so far.
    pub fn stalls(&self) -> u64 {
        self.stalls
    }

    /// Tasks that ended by a fault of their own so far.
    pub fn deaths(&self) -> u64 {
        self.deaths
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    fn table() -> TaskTable {
        TaskTable::new(&Config::preset("sim").unwrap(), 1.0)
    }

    /// Findings of checks every 10 ms, and their times, ms.
    fn findings(heartbeats: &Heartbeats, watchdog: &mut Watchdog, looks: i64) -> Vec<(i64, TaskEvent)> {
        let (table, start, mut found) = (table(), Monotonic::now(), Vec::new());
        for look in 0..looks {
            let now = start.plus_nanos(look * 10_000_000);
            watchdog.look(&table, heartbeats, now, |finding| found.push((look * 10, finding)));
        }
        found
    }

    #[test]
    fn a_silent_task_is_named_once_within_a_tenth_of_a_second_and_again_when_it_is_back() {
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.busy(TaskId::Window);
        let found = findings(&heartbeats, &mut watchdog, 30);
        assert!(matches!(found[..], [(_, TaskEvent::Stalled(TaskId::Window, _))]), "{found:?}");
        assert!(found[0].0 <= 100, "{found:?}");
        assert!(!watchdog.is_critical());
        heartbeats.idle(TaskId::Window);
        let found = findings(&heartbeats, &mut watchdog, 1);
        assert_eq!(found, [(0, TaskEvent::Recovered(TaskId::Window))]);
    }

    #[test]
    fn a_task_that_does_not_wake_up_for_its_work_is_silent_from_then_on() {
        let heartbeats = Heartbeats::default();
        let later = Monotonic::now().plus_nanos(1_000_000_000);
        assert_eq!(heartbeats.of(TaskId::Window).sign(later), TaskSign::Idle);
        heartbeats.give(TaskId::Window);
        let sign = heartbeats.of(TaskId::Window).sign(later);
        assert!(matches!(sign, TaskSign::Busy(silence) if silence > Duration::from_millis(900)), "{sign:?}");
    }

    #[test]
    fn a_task_that_waits_for_its_device_is_not_stalled() {
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.busy(TaskId::Camera);
        heartbeats.idle(TaskId::Camera);
        let later = Monotonic::now().plus_nanos(60_000_000_000);
        watchdog.look(&table(), &heartbeats, later, |finding| panic!("{finding:?}"));
        assert_eq!(watchdog.stalls(), 0);
    }

    #[test]
    fn a_dead_task_is_not_one_that_waits() {
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.busy(TaskId::Tick);
        heartbeats.of(TaskId::Tick).die();
        heartbeats.give(TaskId::Tick);
        assert_eq!(findings(&heartbeats, &mut watchdog, 300), [(0, TaskEvent::Died(TaskId::Tick))]);
        assert!(watchdog.is_critical(), "systemd hears nothing any more");
    }

    #[test]
    fn a_task_that_died_and_was_back_before_the_next_look_is_named_too() {
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.of(TaskId::Window).die();
        heartbeats.idle(TaskId::Window);
        assert_eq!(findings(&heartbeats, &mut watchdog, 3), [(0, TaskEvent::Died(TaskId::Window))]);
        assert_eq!(watchdog.deaths(), 1);
    }

    #[test]
    fn a_task_that_does_not_come_back_is_given_up_and_one_that_may_be_missing_is_not() {
        let (heartbeats, mut watchdog) = (Heartbeats::default(), Watchdog::default());
        heartbeats.busy(TaskId::FrontEnd);
        heartbeats.busy(TaskId::Local);
        let found = findings(&heartbeats, &mut watchdog, 400);
        let given_up: Vec<_> = found.iter().filter(|(_, f)| matches!(f, TaskEvent::Hopeless(_))).collect();
        assert!(matches!(given_up[..], [(_, TaskEvent::Hopeless(TaskId::FrontEnd))]), "{found:?}");
        assert!((1000..=1600).contains(&given_up[0].0), "{found:?}");
    }

    #[test]
    fn a_host_that_stood_still_costs_no_task_its_life() {
        let (heartbeats, mut watchdog, table) = (Heartbeats::default(), Watchdog::default(), table());
        TaskId::ALL.iter().for_each(|id| heartbeats.busy(*id));
        let later = Monotonic::now().plus_nanos(60_000_000_000);
        let mut found = Vec::new();
        (0..3).for_each(|_| watchdog.look(&table, &heartbeats, later, |finding| found.push(finding)));
        assert_eq!(found.len(), TaskId::ALL.len(), "{found:?}");
        assert!(found.iter().all(|finding| matches!(finding, TaskEvent::Stalled(..))), "{found:?}");
    }
}
