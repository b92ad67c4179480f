//! State shared by all tasks of a live run: the time of data on the clock, signs of life, and the end of the run.

use super::super::{Control, RunError, Stamps};
use crate::schedule::host::Host;
use crate::schedule::ladder::Rung;
use crate::schedule::tasks::{Loss, TaskId, TaskTable};
use crate::schedule::ticker::Monotonic;
use crate::schedule::watchdog::Heartbeats;
use parking_lot::Mutex;
use plumbline_config::Timestamp;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};

/// From the start of the threads to the first release, ns.
const START_DELAY_NS: i64 = 50_000_000;

/// Origin of the relation between the time of data and that of the clock.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    /// The time of the first sample.
    pub stamp: Timestamp,
    /// Time on the clock.
    pub due: Monotonic,
}

impl Origin {
    /// Origin of samples that are stamped by this host's clock.
    pub fn of_host() -> Self {
        let now = Monotonic::now();
        Self { stamp: Timestamp::from_nanos(now.0), due: now }
    }

    /// Origin of a recording whose sample of `stamp` is due soon.
    pub fn soon(stamp: Timestamp) -> Self {
        Self { stamp, due: Monotonic::now().plus_nanos(START_DELAY_NS) }
    }
}

/// Relation between the time of data and that of the clock.
#[derive(Clone, Copy, Debug)]
pub struct RunPace {
    /// Clock domain of the sample timestamps.
    pub stamps: Stamps,
    /// Origin of both times.
    pub origin: Origin,
    /// Multiple of real time.
    pub speed: f64,
}

/// State shared by all tasks of a run.
pub struct RunState<'a> {
    pub table: TaskTable,
    pub heartbeats: Heartbeats,
    pub control: &'a Control,
    pub pace: RunPace,
    host: Arc<Host>,
    /// Time that the window took for its last frame, ms, as the bits of an `f64`.
    window_ms: AtomicU64,
    /// Level of the rung of the ladder.
    rung: AtomicU8,
    /// The window has ended by a fault of its own, and waits for a fresh start.
    is_window_down: AtomicBool,
    failure: Mutex<Option<RunError>>,
}

impl<'a> RunState<'a> {
    /// Creates the shared state of a run at this pace.
    pub fn new(
        table: TaskTable,
        heartbeats: Heartbeats,
        host: Arc<Host>,
        control: &'a Control,
        pace: RunPace,
    ) -> Self {
        Self {
            table,
            heartbeats,
            control,
            pace,
            host,
            window_ms: AtomicU64::default(),
            rung: AtomicU8::default(),
            is_window_down: AtomicBool::default(),
            failure: Mutex::default(),
        }
    }

    /// Time on the clock at which data of `stamp` are due.
    pub fn due(&self, stamp: Timestamp) -> Monotonic {
        let RunPace { stamps, origin, speed } = self.pace;
        match stamps {
            Stamps::OfHost => Monotonic(stamp.as_nanos()),
            Stamps::Replayed => {
                origin.due.plus_nanos((stamp.nanos_since(origin.stamp) as f64 / speed) as i64)
            }
        }
    }

    /// True if samples come from sensors. They are then due on arrival, whatever is known of their clocks.
    pub fn is_of_sensors(&self) -> bool {
        self.pace.stamps == Stamps::OfHost
    }

    /// The time of data that are due at `at`.
    pub fn data_time(&self, at: Monotonic) -> Timestamp {
        let RunPace { stamps, origin, speed } = self.pace;
        match stamps {
            Stamps::OfHost => Timestamp::from_nanos(at.0),
            Stamps::Replayed => origin.stamp.plus_nanos(((at.0 - origin.due.0) as f64 * speed) as i64),
        }
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

    /// The window has ended by a fault of its own: the front-end sees to a fresh start.
    pub fn report_window_down(&self) {
        self.is_window_down.store(true, Ordering::Release);
    }

    pub fn is_window_down(&self) -> bool {
        self.is_window_down.load(Ordering::Acquire)
    }

    /// A fresh start is on its way to the window.
    pub fn forget_window_down(&self) {
        self.is_window_down.store(false, Ordering::Release);
    }

    /// Makes the calling thread the one of a task.
    pub fn enter(&self, id: TaskId) {
        self.host.enter(self.table.row(id));
    }

    /// Tells of a failure of a run, and keeps the first.
    pub fn fail(&self, error: RunError) {
        tracing::error!("{error}");
        self.keep(error);
    }

    /// Keeps the first failure of a run. The watchdog tells of those of tasks.
    fn keep(&self, error: RunError) {
        self.failure.lock().get_or_insert(error);
    }

    /// The first failure, after the end.
    pub fn into_failure(self) -> Option<RunError> {
        self.failure.into_inner()
    }

    /// A task has ended by a fault of its own: so does the run, where it cannot go on without.
    pub fn lose(&self, id: TaskId) {
        let row = self.table.row(id);
        self.keep(RunError::Fault(row.name));
        if row.loss == Loss::Process {
            self.control.give_up();
        }
    }

    /// A task does not come back: the run ends, and the process with it.
    pub fn give_up(&self, id: TaskId) {
        self.keep(RunError::Stalled(self.table.row(id).name));
        self.control.give_up();
    }

    /// Starts the thread of a task.
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
                match outcome {
                    Ok(outcome) => {
                        self.heartbeats.idle(id);
                        Some(outcome)
                    }
                    Err(_) => {
                        self.heartbeats.of(id).die();
                        self.lose(id);
                        None
                    }
                }
            })
            .map_err(|error| RunError::Thread(error.to_string()))
    }
}
