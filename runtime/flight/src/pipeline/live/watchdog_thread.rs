//! The watchdog's thread: looks at the heartbeats, tells systemd, and keeps an eye on the memory.

use super::super::RunError;
use super::shared::Shared;
use crate::pipeline::listener::Listener;
use crate::schedule::ladder::Rung;
use crate::schedule::supervisor::{Supervisor, Word};
use crate::schedule::tasks::{Loss, TaskId, WATCH_PERIOD};
use crate::schedule::ticker::Monotonic;
use crate::schedule::watchdog::{TaskEvent, Watchdog};
use plumbline_config::Portable;
use plumbline_record::{Event, Said, Severity};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};
use std::time::Duration;

/// Memory counts as settled after this time.
const SETTLED: Duration = Duration::from_secs(60);
/// Looks at the heartbeats between two looks at the memory.
const LOOKS_PER_MEMORY: u32 = 100;

/// What the watchdog saw in a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct WatchdogFigures {
    /// Stalls named.
    pub stalls: u64,
    /// Tasks that ended by a fault of their own.
    pub deaths: u64,
    /// Growth of the resident memory after it had settled, MB.
    pub memory_growth_mb: Option<f64>,
}

/// The watchdog of a run.
#[derive(Debug, Default)]
pub struct WatchdogThread {
    ended: AtomicBool,
}

impl WatchdogThread {
    /// Starts the thread.
    pub fn start<'scope>(
        &'scope self,
        scope: &'scope Scope<'scope, '_>,
        shared: &'scope Shared<'_>,
        listener: Box<dyn Listener>,
    ) -> Result<ScopedJoinHandle<'scope, WatchdogFigures>, RunError> {
        Builder::new()
            .name("watchdog".into())
            .spawn_scoped(scope, move || {
                shared.enter(TaskId::Watchdog);
                self.watch(shared, listener)
            })
            .map_err(|error| RunError::Thread(error.to_string()))
    }

    /// Ends the thread when the guard goes.
    pub fn end_on_drop(&self) -> impl Drop + '_ {
        EndOnDrop(&self.ended)
    }

    fn watch(&self, shared: &Shared<'_>, mut listener: Box<dyn Listener>) -> WatchdogFigures {
        let mut watchdog = Watchdog::default();
        let (start, mut settled_mb, mut peak_mb) = (Monotonic::now(), None, 0.0f64);
        let mut rung = Rung::Full;
        let supervisor = Supervisor::of_environment();
        supervisor.tell(Word::Ready);
        let mut last_sign = start;
        for look in 0u32.. {
            if self.ended.load(Ordering::Relaxed) {
                break;
            }
            let now = Monotonic::now();
            shared.heartbeats.busy(TaskId::Watchdog);
            watchdog.look(&shared.table, &shared.heartbeats, now, |finding| {
                report_finding(shared, &mut *listener, finding);
            });
            report_rung(shared, &mut *listener, &mut rung);
            if let Some(patience) = supervisor.patience()
                && !watchdog.is_critical()
                && now.ms_since(last_sign) * 3e-3 > patience.as_secs_f64()
            {
                supervisor.tell(Word::Alive);
                last_sign = now;
            }
            if look.is_multiple_of(LOOKS_PER_MEMORY)
                && now.ms_since(start) > SETTLED.as_secs_f64() * 1e3
                && let Some(mb) = resident_mb()
            {
                settled_mb.get_or_insert(mb);
                peak_mb = peak_mb.at_least(mb);
            }
            std::thread::sleep(WATCH_PERIOD);
        }
        report_rung(shared, &mut *listener, &mut rung);
        supervisor.tell(Word::Stopping);
        WatchdogFigures {
            stalls: watchdog.stalls(),
            deaths: watchdog.deaths(),
            memory_growth_mb: settled_mb.map(|settled| peak_mb - settled),
        }
    }
}

/// Sets the flag when it goes.
struct EndOnDrop<'a>(&'a AtomicBool);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Message of a step down the ladder.
const SLOW: &str = "frames take longer than their period";
/// Message of a step up the ladder.
const IN_TIME: &str = "frames are in time again";

/// Reports that the front-end has taken a step of the ladder. The front-end itself has no time for that.
fn report_rung(shared: &Shared<'_>, listener: &mut dyn Listener, told: &mut Rung) {
    let rung = shared.rung();
    if rung != *told {
        let now = shared.data_time(Monotonic::now());
        let severity = if rung > *told {
            tracing::warn!("{SLOW}: {}", rung.name());
            Severity::Warning
        } else {
            tracing::info!("{IN_TIME}: {}", rung.name());
            Severity::Info
        };
        let words = if rung > *told { SLOW } else { IN_TIME };
        listener.said(&Said::Event(Event::new(now, severity, format_args!("{words}: {}", rung.name()))));
        *told = rung;
    }
}

/// Says what was found, in the log of the process and in that of the flight, and does what is to be done about it.
fn report_finding(shared: &Shared<'_>, listener: &mut dyn Listener, finding: TaskEvent) {
    let now = shared.data_time(Monotonic::now());
    let mut tell = |severity: Severity, text: std::fmt::Arguments<'_>| {
        match severity {
            Severity::Error => tracing::error!("{text}"),
            Severity::Warning => tracing::warn!("{text}"),
            Severity::Info => tracing::info!("{text}"),
        }
        listener.said(&Said::Event(Event::new(now, severity, text)));
    };
    match finding {
        TaskEvent::Stalled(id, silence) => {
            let (name, ms) = (shared.table.row(id).name, silence.as_secs_f64() * 1e3);
            tell(Severity::Error, format_args!("{name} is stalled: no sign of life for {ms:.0} ms"));
        }
        TaskEvent::Hopeless(id) => {
            let name = shared.table.row(id).name;
            tell(Severity::Error, format_args!("{name} does not come back: this process ends"));
            shared.give_up(id);
        }
        TaskEvent::Died(id) => {
            let row = shared.table.row(id);
            let consequence = match row.loss {
                Loss::Process => "this process ends",
                Loss::Estimate => "the estimate starts anew",
                Loss::Itself => "the flight goes on without it",
            };
            let name = row.name;
            tell(Severity::Error, format_args!("{name} ended by a fault of its own: {consequence}"));
            if row.loss == Loss::Process {
                shared.lose(id);
            }
        }
        TaskEvent::Recovered(id) => {
            let name = shared.table.row(id).name;
            tell(Severity::Info, format_args!("{name} is back"));
        }
    }
}

/// Resident memory of this process.
fn resident_mb() -> Option<f64> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = statm.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * rustix::param::page_size() as f64 / (1024.0 * 1024.0))
}
