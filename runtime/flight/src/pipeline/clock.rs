//! Stopwatches: they time the stages, and have no say in any estimate.

use rustix::thread::ClockId;
use std::time::Instant;

/// Wall time.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Milliseconds since the start.
    pub fn elapsed_ms(&self) -> f64 {
        self.0.elapsed().as_secs_f64() * 1e3
    }
}

/// Processor time of this thread: what the computation took, without what other processes took from it.
#[derive(Clone, Copy, Debug)]
pub struct CpuStopwatch(f64);

impl CpuStopwatch {
    /// Starts.
    pub fn start() -> Self {
        Self(thread_cpu_ms())
    }

    /// Milliseconds since the start.
    pub fn elapsed_ms(&self) -> f64 {
        thread_cpu_ms() - self.0
    }
}

fn thread_cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
