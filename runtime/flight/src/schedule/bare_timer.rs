//! A timer thread that does nothing else: what the host itself does to a tick.

use super::host::{pin, raise_priority};
use super::ticker::{Monotonic, Ticker};
use crate::schedule::times::Times;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Timing of a bare timer.
#[derive(Clone, Debug)]
pub struct BareTimer {
    /// Lateness of its releases, ms.
    pub late_ms: Times,
    /// Releases that passed unseen.
    pub missed: u64,
}

/// Releases every `period` at `priority`, where the host allows it, until `stop` is set or `duration` has
/// passed. Runs on the calling thread.
pub fn run(
    period: Duration,
    priority: Option<u8>,
    cpus: &[usize],
    duration: Duration,
    stop: &AtomicBool,
) -> BareTimer {
    if let Some(priority) = priority {
        // Without it the measurement says what a run without it would meet.
        let _ = raise_priority(priority);
    }
    let _ = pin(cpus);
    let start = Monotonic::now();
    let mut ticker = Ticker::new(start.plus_nanos(period.as_nanos() as i64), period);
    let mut timer = BareTimer { late_ms: Times::default(), missed: 0 };
    while !stop.load(Ordering::Relaxed) {
        let release = ticker.wait();
        timer.late_ms.record(release.late_ms);
        timer.missed += release.missed;
        if release.due.ms_since(start) >= duration.as_secs_f64() * 1e3 {
            break;
        }
    }
    timer
}

#[cfg(test)]
mod realtime {
    use super::*;

    #[test]
    fn it_releases_for_the_whole_of_its_time() {
        let timer =
            run(Duration::from_millis(2), None, &[], Duration::from_millis(40), &AtomicBool::new(false));
        assert!(timer.late_ms.count() + timer.missed >= 20);
    }
}
