//! Options of a live run: what is asked of the host.

use plumbline_keys::keys;

/// Requests of a live run to the host. A refused request is logged, and the run continues without it.
#[keys]
pub struct RuntimeConfig {
    /// Use real-time priorities (SCHED_FIFO).
    #[key(default = true)]
    pub realtime: bool,
    /// Lock all memory (mlockall).
    #[key(default = true)]
    pub lock_memory: bool,
    /// Largest wake-up latency of idle processors. Deeper sleep states delay the tick. 0 keeps the processors awake:
    /// use it on virtual machines, where each wake-up waits for the host; it produces heat. -1 leaves the latency to
    /// the system.
    #[key(default = 50, range = -1..=1_000_000, unit = MICROSECONDS,
        cure = "write it in microseconds; 0 keeps processors awake, -1 leaves it to the system")]
    pub idle_latency_us: i64,
    /// Processors for the tick, counted from 0; empty for any.
    #[key(default, range = 0..=1023, cure = "give the number of a processor")]
    pub tick_cpus: Vec<usize>,
    /// Processors for front-end and window, counted from 0; empty for any.
    #[key(default, range = 0..=1023, cure = "give the number of a processor")]
    pub work_cpus: Vec<usize>,
}
