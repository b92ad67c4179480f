//! What all tasks of a live run share: the time of data on the clock, signs of life, and who ends the run.

use super::super::{Control, RunError};
use crate::schedule::host::Host;
use crate::schedule::ladder::Rung;
use crate::schedule::tasks::{TaskId, TaskTable};
use crate::schedule::ticker::Monotonic;
use crate::schedule::watchdog::Heartbeats;
use plumbline_config::Timestamp;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, Scope, ScopedJoinHandle};

/// From the start of the threads to the first release, ns.
const START_DELAY_NS: i64 = 50_000_000;

/// Where the time of data and that of the clock meet.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    /// The time of the first sample.
    pub stamp: Timestamp,
    /// When it is due.
    pub due: Monotonic,
}

/// What all tasks of a run share.
pub struct Shared<'a> {
    pub table: TaskTable,
    pub heartbeats: Heartbeats,
    pub control: &'a Control,
    pub origin: Origin,
    host: Arc<Host>,
    speed: f64,
    /// What the window took for its last frame, ms, as the bits of an `f64`.
    window_ms: AtomicU64,
    /// Level of the rung of the ladder.
    rung: AtomicU8,
    failure: Mutex<Option<RunError>>,
}

impl<'a> Shared<'a> {
    /// Of a run whose sample of `first` is due soon, at `speed` times real time.
    pub fn new(
        table: TaskTable,
        host: Arc<Host>,
        control: &'a Control,
        first: Option<Timestamp>,
        speed: f64,
    ) -> Self {
        let due = Monotonic::now().plus_nanos(START_DELAY_NS);
        Self {
            table,
            heartbeats: Heartbeats::default(),
            control,
            origin: Origin { stamp: first.unwrap_or(Timestamp::MIN), due },
            host,
            speed,
            window_ms: AtomicU64::default(),
            rung: AtomicU8::default(),
            failure: Mutex::default(),
        }
    }

    /// When data of `stamp` are due.
    pub fn due(&self, stamp: Timestamp) -> Monotonic {
        let data_ns = stamp.nanos_since(self.origin.stamp) as f64;
        self.origin.due.plus_nanos((data_ns / self.speed) as i64)
    }

    /// The time of data that are due at `at`.
    pub fn data_time(&self, at: Monotonic) -> Timestamp {
        let wall_ns = (at.0 - self.origin.due.0) as f64;
        self.origin.stamp.plus_nanos((wall_ns * self.speed) as i64)
    }

    pub fn is_stopped(&self) -> bool {
        self.control.is_stopped()
    }

    pub fn set_window_ms(&self, ms: f64) {
        self.window_ms.store(ms.to_bits(), Ordering::Relaxed);
    }

    pub fn window_ms(&self) -> f64 {
        f64::from_bits(self.window_ms.load(Ordering::Relaxed))
    }

    /// The front-end is on this rung from now on; the watchdog tells people.
    pub fn set_rung(&self, rung: Rung) {
        self.rung.store(rung.level(), Ordering::Relaxed);
    }

    pub fn rung(&self) -> Rung {
        Rung::of_level(self.rung.load(Ordering::Relaxed)).unwrap_or_default()
    }

    /// Keeps the first failure of a run.
    pub fn fail(&self, error: RunError) {
        tracing::error!("{error}");
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// The first failure, after the end.
    pub fn into_failure(self) -> Option<RunError> {
        self.failure.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts the thread of a task. Its fault ends the task, not the run: the odometry goes on.
    pub fn spawn<'scope, T: Send + 'scope>(
        &'scope self,
        scope: &'scope Scope<'scope, '_>,
        id: TaskId,
        work: impl FnOnce() -> T + Send + 'scope,
    ) -> Result<ScopedJoinHandle<'scope, Option<T>>, RunError> {
        let task = self.table.row(id);
        Builder::new()
            .name(task.name.into())
            .spawn_scoped(scope, move || {
                self.host.enter(task);
                let outcome = catch_unwind(AssertUnwindSafe(work));
                self.heartbeats.idle(id);
                outcome.map_err(|_| self.fail(RunError::Fault(task.name))).ok()
            })
            .map_err(|error| RunError::Thread(error.to_string()))
    }
}
