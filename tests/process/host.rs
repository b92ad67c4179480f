//! Disturbances by the host, seen by timers that do nothing else: tests of time judge beyond them.

use plumbline_flight::schedule::bare_timer::{self, BareTimer};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Lateness of bare timers beside some work, one on each processor.
pub struct Host(Vec<BareTimer>);

impl Host {
    /// Lateness that a share `q` of the releases kept, on the processor that fared worst, ms.
    pub fn late_ms(&self, q: f64) -> f64 {
        self.0.iter().map(|timer| timer.late_ms.quantile(q)).fold(0.0, f64::max)
    }

    /// Releases that passed unseen, on the processor that fared worst.
    pub fn missed(&self) -> u64 {
        self.0.iter().map(|timer| timer.missed).max().unwrap_or_default()
    }
}

/// Result of `work`, and the lateness meanwhile of timers of this period and SCHED_FIFO priority.
pub fn beside_bare_timers<T>(period: Duration, priority: u8, work: impl FnOnce() -> T) -> (T, Host) {
    let stop = AtomicBool::new(false);
    let cpus = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        let time = |cpu| bare_timer::run(period, Some(priority), &[cpu], Duration::from_secs(600), &stop);
        let timers: Vec<_> = (0..cpus).map(|cpu| scope.spawn(move || time(cpu))).collect();
        let result = work();
        stop.store(true, Ordering::Relaxed);
        (result, Host(timers.into_iter().map(|timer| timer.join().unwrap()).collect()))
    })
}
