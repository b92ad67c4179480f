//! Means of the host for a real-time run: SCHED_FIFO, locked memory, a processor of one's own, processors that do not sleep
//! deeply. Each is requested once; a refusal is reported once, with the cure.

use super::tasks::{ProcessorSet, Task};
use plumbline_config::options::RuntimeConfig;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity};
use std::fs::{File, OpenOptions};
use std::hint::black_box;
use std::io::Write;
use std::sync::OnceLock;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// File of requests for short wake-ups; they hold as long as it is open.
const IDLE_LATENCY: &str = "/dev/cpu_dma_latency";

/// Stack that every task touches before its first release, bytes.
const PREFAULTED_STACK: usize = 256 * 1024;

/// Something the host would not grant.
#[derive(Clone, Debug, thiserror::Error)]
pub enum HostRefusal {
    /// No priority above others.
    #[error(
        "no real-time priority ({0}): ticks may be late under load; grant CAP_SYS_NICE, or set LimitRTPRIO=99 \
         in the unit file (rtprio in /etc/security/limits.conf)"
    )]
    Priority(String),
    /// Memory may be paged out.
    #[error(
        "memory is not locked ({0}): a page fault may delay a tick; set LimitMEMLOCK=infinity in the unit file"
    )]
    Memory(String),
    /// Not on the processor that was asked for.
    #[error("cannot use processor {1} ({0}); check runtime.tick_cpus and runtime.work_cpus")]
    Affinity(String, usize),
    /// Processors sleep as deeply as the system likes.
    #[error(
        "no limit to the sleep of processors ({0}): ticks may be late by their wake-up time; let the \
         user write {IDLE_LATENCY} (as the unit file does), or set runtime.idle_latency_us = -1"
    )]
    Idle(String),
}

/// Asks for what the configuration wants, and remembers what was refused.
#[derive(Debug, Default)]
pub struct Host {
    wants: RuntimeConfig,
    priority: OnceLock<()>,
    affinity: OnceLock<()>,
    /// Holds the request.
    _awake: Option<File>,
}

impl Host {
    /// Locks the memory of the process and limits the sleep of the processors, if wanted.
    pub fn new(wants: &RuntimeConfig) -> Self {
        if wants.lock_memory
            && let Err(refusal) = lock_memory()
        {
            tracing::warn!("{refusal}");
        }
        let awake = limit_idle_latency(wants.idle_latency_us).unwrap_or_else(|refusal| {
            tracing::warn!("{refusal}");
            None
        });
        Self { wants: wants.clone(), _awake: awake, ..Self::default() }
    }

    /// Makes the calling thread the one of `task`: its stack is touched, its priority and processor are set.
    pub fn enter(&self, task: &Task) {
        prefault_stack();
        if let Some(priority) = task.priority.filter(|_| self.wants.realtime)
            && let Err(refusal) = raise_priority(priority)
            && self.priority.set(()).is_ok()
        {
            tracing::warn!("{refusal}");
        }
        let cpus = match task.place {
            ProcessorSet::Tick => &self.wants.tick_cpus,
            ProcessorSet::Work => &self.wants.work_cpus,
        };
        if let Err(refusal) = pin(cpus)
            && self.affinity.set(()).is_ok()
        {
            tracing::warn!("{refusal}");
        }
    }
}

/// Gives the calling thread a SCHED_FIFO priority.
///
/// # Errors
/// When the host does not allow it.
pub fn raise_priority(priority: u8) -> Result<(), HostRefusal> {
    let refused = |reason: String| HostRefusal::Priority(reason);
    let value = priority.try_into().map_err(|_| refused(format!("{priority} is not a priority")))?;
    set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|error| refused(error.to_string()))
}

/// Keeps every page of the process in memory once it has been touched.
///
/// # Errors
/// When the host does not allow it.
pub fn lock_memory() -> Result<(), HostRefusal> {
    // Not the whole stack of every thread of every library: what is never touched need not be there.
    let flags = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
    mlockall(flags).map_err(|error| HostRefusal::Memory(error.to_string()))
}

/// Keeps all processors from idle states that take longer than this to leave, as long as the file is held; a negative
/// number asks for nothing.
///
/// # Errors
/// When the host does not allow it.
pub fn limit_idle_latency(us: i64) -> Result<Option<File>, HostRefusal> {
    if us < 0 {
        return Ok(None);
    }
    let request = i32::try_from(us).unwrap_or(i32::MAX).to_ne_bytes();
    let ask = || {
        let mut file = OpenOptions::new().write(true).open(IDLE_LATENCY)?;
        file.write_all(&request)?;
        Ok(Some(file))
    };
    ask().map_err(|error: std::io::Error| HostRefusal::Idle(error.to_string()))
}

/// Keeps the calling thread on `cpus`; on any, if none is named.
///
/// # Errors
/// When one of them is not there.
pub fn pin(cpus: &[usize]) -> Result<(), HostRefusal> {
    let Some(first) = cpus.first() else { return Ok(()) };
    let mut set = CpuSet::new();
    for &cpu in cpus {
        if cpu >= CpuSet::MAX_CPU {
            return Err(HostRefusal::Affinity("this computer has fewer".into(), cpu));
        }
        set.set(cpu);
    }
    sched_setaffinity(None, &set).map_err(|error| HostRefusal::Affinity(error.to_string(), *first))
}

#[inline(never)]
fn prefault_stack() {
    let mut stack = [0u8; PREFAULTED_STACK];
    black_box(&mut stack);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_that_is_not_there_is_refused_with_its_number() {
        let refusal = pin(&[1_000_000]).unwrap_err();
        assert!(refusal.to_string().contains("1000000"), "{refusal}");
        assert!(pin(&[]).is_ok());
    }

    #[test]
    fn the_sleep_of_processors_is_limited_where_that_is_allowed() {
        assert!(limit_idle_latency(-1).unwrap().is_none());
        let is_allowed = OpenOptions::new().write(true).open(IDLE_LATENCY).is_ok();
        match limit_idle_latency(50) {
            Ok(file) => assert!(is_allowed && file.is_some()),
            Err(refusal) => assert!(!is_allowed && refusal.to_string().contains("idle_latency_us = -1")),
        }
    }

    #[test]
    fn a_refused_priority_says_what_to_do() {
        let refusal = raise_priority(200).unwrap_err();
        assert!(refusal.to_string().contains("LimitRTPRIO"), "{refusal}");
    }
}
