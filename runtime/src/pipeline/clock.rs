//! The wall clock: paces a run and times its stages, and has no say in any estimate.

use plumbline_config::Timestamp;
use rustix::thread::ClockId;
use std::time::{Duration, Instant};

/// Holds samples back until their time has come.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    speed: Option<f64>,
    origin: Option<(Instant, Timestamp)>,
}

impl Pace {
    /// `speed` times real time; `None` never waits.
    #[must_use]
    pub fn new(speed: Option<f64>) -> Self {
        Self { speed, origin: None }
    }

    /// Returns when data of `stamp` are due, or at once, with the milliseconds by which that is late. `None`
    /// without a pace. The first call sets the origin.
    pub fn wait_for(&mut self, stamp: Timestamp) -> Option<f64> {
        let speed = self.speed?;
        let (start, first) = *self.origin.get_or_insert_with(|| (Instant::now(), stamp));
        let due = start + Duration::from_secs_f64((stamp.seconds_since(first) / speed).max(0.0));
        let now = Instant::now();
        if due > now {
            std::thread::sleep(due - now);
        }
        Some(due.elapsed().as_secs_f64() * 1e3)
    }
}

/// Wall time.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts.
    #[must_use]
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Milliseconds since the start.
    #[must_use]
    pub fn elapsed_ms(&self) -> f64 {
        self.0.elapsed().as_secs_f64() * 1e3
    }
}

/// Processor time of this thread: what the computation took, without what other processes took from it.
#[derive(Clone, Copy, Debug)]
pub struct CpuStopwatch(f64);

impl CpuStopwatch {
    /// Starts.
    #[must_use]
    pub fn start() -> Self {
        Self(thread_cpu_ms())
    }

    /// Milliseconds since the start.
    #[must_use]
    pub fn elapsed_ms(&self) -> f64 {
        thread_cpu_ms() - self.0
    }
}

fn thread_cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
