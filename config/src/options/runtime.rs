//! Options of a live run: what is asked of the host.

use serde::{Deserialize, Serialize};

/// Requests of a live run to the host. A refused request is logged, and the run continues without it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RuntimeConfig {
    /// Real-time priorities (SCHED_FIFO), as in the task table.
    pub realtime: bool,
    /// Lock all memory (mlockall).
    pub lock_memory: bool,
    /// Longest time to wake up that an idle processor's state may have, us (the kernel's PM QoS, for all
    /// processors); 0 keeps them awake, -1 leaves it to the system.
    pub idle_latency_us: i64,
    /// Processors for the tick, counted from 0; empty for any.
    pub tick_cpus: Vec<usize>,
    /// Processors for front-end and window; empty for any.
    pub work_cpus: Vec<usize>,
}

impl Default for RuntimeConfig {
    fn default() -> Self {
        Self {
            realtime: true,
            lock_memory: true,
            idle_latency_us: 50,
            tick_cpus: Vec::new(),
            work_cpus: Vec::new(),
        }
    }
}
