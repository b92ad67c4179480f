//! The watchdog's thread: looks at the heartbeats and tells systemd; and the thread that reports what it finds.

use super::super::RunError;
use super::shared::RunState;
use crate::alloc;
use crate::pipeline::listener::Listener;
use crate::schedule::ladder::Rung;
use crate::schedule::ring::{Bell, Reader, Writer, ring};
use crate::schedule::supervisor::{Supervisor, Word};
use crate::schedule::tasks::{Loss, TaskId, WATCH_PERIOD};
use crate::schedule::ticker::Monotonic;
use crate::schedule::watchdog::{TaskEvent, Watchdog};
use plumbline_config::Portable;
use plumbline_record::{Event, Said, Severity};
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};
use std::time::Duration;

/// Memory counts as settled after this time.
const SETTLED: Duration = Duration::from_secs(60);
/// The memory is looked at this often.
const MEMORY_PERIOD: Duration = Duration::from_secs(1);
/// News that wait for their words.
const NEWS: usize = 64;

/// Findings of the watchdog in a run.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct WatchdogFigures {
    /// Stalls named.
    pub stalls: u64,
    /// Tasks that ended by a fault of their own.
    pub deaths: u64,
    /// Allocations of the watchdog's thread while it watched: it is above all others, and waits for no allocator.
    #[serde(skip)]
    pub allocations: u64,
    /// Growth of the resident memory after the first minute, MB; none in a shorter run.
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
        shared: &'scope RunState<'_>,
        listener: Box<dyn Listener>,
    ) -> Result<ScopedJoinHandle<'scope, WatchdogFigures>, RunError> {
        let refused = |error: std::io::Error| RunError::Thread(error.to_string());
        let bell = Bell::default();
        let (words, news) = ring::<News>(NEWS, &bell);
        let reporter = Builder::new()
            .name("watchdog-words".into())
            .spawn_scoped(scope, move || report(shared, listener, news, &bell))
            .map_err(refused)?;
        Builder::new()
            .name("watchdog".into())
            .spawn_scoped(scope, move || {
                shared.enter(TaskId::Watchdog);
                let figures = self.watch(shared, words);
                // Its words are said before it ends.
                WatchdogFigures { memory_growth_mb: reporter.join().ok().flatten(), ..figures }
            })
            .map_err(refused)
    }

    /// Ends the thread when the guard goes.
    pub fn end_on_drop(&self) -> impl Drop + '_ {
        EndOnDrop(&self.ended)
    }

    fn watch(&self, shared: &RunState<'_>, mut words: Writer<News>) -> WatchdogFigures {
        let mut watchdog = Watchdog::default();
        let mut rung = Rung::Full;
        let supervisor = Supervisor::of_environment();
        supervisor.tell(Word::Ready);
        let mut last_sign = Monotonic::now();
        let counting = alloc::Count::begin();
        while !self.ended.load(Ordering::Relaxed) {
            let now = Monotonic::now();
            shared.heartbeats.busy(TaskId::Watchdog);
            watchdog.look(&shared.table, &shared.heartbeats, now, |event| {
                act_on(shared, event);
                // What finds no room is not worth waiting for.
                let _ = words.push(News::Task(event));
            });
            tell_rung(shared, &mut words, &mut rung);
            if let Some(patience) = supervisor.patience()
                && !watchdog.is_critical()
                && now.ms_since(last_sign) * 3e-3 > patience.as_secs_f64()
            {
                supervisor.tell(Word::Alive);
                last_sign = now;
            }
            std::thread::sleep(WATCH_PERIOD);
        }
        tell_rung(shared, &mut words, &mut rung);
        let allocations = counting.end();
        supervisor.tell(Word::Stopping);
        WatchdogFigures {
            stalls: watchdog.stalls(),
            deaths: watchdog.deaths(),
            allocations,
            memory_growth_mb: None,
        }
    }
}

/// Findings of the watchdog to be reported.
#[derive(Clone, Copy, Debug)]
enum News {
    Task(TaskEvent),
    /// The front-end has taken a step of the ladder, from and to these rungs. It has no time for that itself.
    Rung(Rung, Rung),
}

fn tell_rung(shared: &RunState<'_>, words: &mut Writer<News>, told: &mut Rung) {
    let rung = shared.rung();
    if rung != *told {
        let _ = words.push(News::Rung(*told, rung));
        *told = rung;
    }
}

/// Does what is to be done about a task.
fn act_on(shared: &RunState<'_>, event: TaskEvent) {
    match event {
        TaskEvent::Hopeless(id) => shared.give_up(id),
        TaskEvent::Died(id) if shared.table.row(id).loss == Loss::Process => shared.lose(id),
        TaskEvent::Died(_) | TaskEvent::Stalled(..) | TaskEvent::Recovered(_) => {}
    }
}

/// The thread of normal priority that puts into words what the watchdog finds, and keeps an eye on the memory: both allocate, and
/// the watchdog, above all others, must not wait for who holds the allocator. Returns the growth of the memory, MB.
fn report(
    shared: &RunState<'_>,
    mut listener: Box<dyn Listener>,
    mut news: Reader<News>,
    bell: &Bell,
) -> Option<f64> {
    bell.listen();
    let (start, mut looked) = (Monotonic::now(), Monotonic::now());
    let (mut settled_mb, mut peak_mb) = (None, 0.0_f64);
    loop {
        let newest = bell.wait(MEMORY_PERIOD, || {
            let is_closed = news.is_closed();
            let newest = news.pop();
            (newest.is_some() || is_closed).then_some(newest)
        });
        match newest {
            Some(Some(news)) => report_news(shared, &mut *listener, news),
            Some(None) => return settled_mb.map(|settled| peak_mb - settled),
            None => {}
        }
        let now = Monotonic::now();
        if now.ms_since(looked) >= MEMORY_PERIOD.as_secs_f64() * 1e3 {
            looked = now;
            if now.ms_since(start) > SETTLED.as_secs_f64() * 1e3
                && let Some(mb) = resident_mb()
            {
                settled_mb.get_or_insert(mb);
                peak_mb = peak_mb.at_least(mb);
            }
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

/// Says what was found, in the log of the process and in that of the flight.
fn report_news(shared: &RunState<'_>, listener: &mut dyn Listener, news: News) {
    let now = shared.data_time(Monotonic::now());
    let mut tell = |severity: Severity, text: std::fmt::Arguments<'_>| {
        match severity {
            Severity::Error => tracing::error!("{text}"),
            Severity::Warning => tracing::warn!("{text}"),
            Severity::Info => tracing::info!("{text}"),
        }
        listener.said(&Said::Event(Event::new(now, severity, text)));
    };
    match news {
        News::Rung(before, rung) if rung > before => {
            tell(Severity::Warning, format_args!("{SLOW}: {}", rung.name()));
        }
        News::Rung(_, rung) => tell(Severity::Info, format_args!("{IN_TIME}: {}", rung.name())),
        News::Task(TaskEvent::Stalled(id, silence)) => {
            let (name, ms) = (shared.table.row(id).name, silence.as_secs_f64() * 1e3);
            tell(Severity::Error, format_args!("{name} is stalled: no sign of life for {ms:.0} ms"));
        }
        News::Task(TaskEvent::Hopeless(id)) => {
            let name = shared.table.row(id).name;
            tell(Severity::Error, format_args!("{name} does not come back: this process ends"));
        }
        News::Task(TaskEvent::Died(id)) => {
            let row = shared.table.row(id);
            let consequence = match row.loss {
                Loss::Process => "this process ends",
                Loss::Estimate => "the estimate starts anew",
                Loss::Itself => "the flight goes on without it",
            };
            let name = row.name;
            tell(Severity::Error, format_args!("{name} ended by a fault of its own: {consequence}"));
        }
        News::Task(TaskEvent::Recovered(id)) => {
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
