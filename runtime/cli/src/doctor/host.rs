//! Checks that this host and this configuration are fit for a flight.

use super::{Check, Verdict};
use plumbline_checkup::Fitness;
use plumbline_config::options::VehicleConfig;
use plumbline_config::{Config, ValidConfig};
use plumbline_flight::schedule::bare_timer;
use plumbline_flight::schedule::host::{HostRefusal, limit_idle_latency, lock_memory, pin, raise_priority};
use plumbline_flight::schedule::tasks::{TaskId, TaskTable};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// A bare timer later than this makes a tick late, ms.
const LATE_MS: f64 = 1.0;

/// Every check; the timer of the host is watched for so long.
pub(super) fn checks(config: &ValidConfig, table: &TaskTable, watch: Duration) -> Vec<Check> {
    // Held while the timer is watched, as in a flight.
    let awake = limit_idle_latency(config.runtime.idle_latency_us);
    vec![
        ("configuration", configuration(config)),
        ("processors", processors()),
        ("real-time priority", priority(table)),
        ("locked memory", tried(lock_memory, "granted")),
        ("pinning", pinning(config)),
        ("sleep", sleep(config, awake.as_ref().err())),
        ("timer", timer(config, table, watch)),
    ]
}

fn configuration(config: &ValidConfig) -> Verdict {
    let hash = plumbline_record::digest::config_hash(config);
    let cameras = config.camera.len();
    let words = format!("valid, {cameras} camera(s), IMU at {} Hz, hash {}", config.imu.rate_hz, &hash[..16]);
    if let Some(unset) = config.unset_keys().first() {
        return (Fitness::NotFit, format!("{words}; {unset}"));
    }
    if config.vehicle.rot_v_b().is_none() {
        let is_needed = !config.autopilot.connect.is_empty() || config.ros.enabled;
        let fitness = if is_needed { Fitness::NotFit } else { Fitness::Mind };
        return (fitness, format!("{}: {}", VehicleConfig::UNKNOWN, VehicleConfig::CURE));
    }
    if cameras == 2 {
        (Fitness::Good, words)
    } else {
        (Fitness::Mind, format!("{words}; one camera finds its scale late"))
    }
}

fn processors() -> Verdict {
    match std::thread::available_parallelism().map_or(1, usize::from) {
        1 => (Fitness::Mind, "one: front-end and window take turns; give the process two".into()),
        n => (Fitness::Good, format!("{n}")),
    }
}

/// What the host grants, tried on a thread of its own: it goes with it.
fn tried(
    asked: impl FnOnce() -> Result<(), HostRefusal> + Send + 'static,
    granted: impl Into<String>,
) -> Verdict {
    match std::thread::spawn(asked).join() {
        Ok(Ok(())) => (Fitness::Good, granted.into()),
        Ok(Err(refusal)) => (Fitness::Mind, refusal.to_string()),
        Err(_) => (Fitness::Mind, "cannot be tried".into()),
    }
}

fn priority(table: &TaskTable) -> Verdict {
    let priority = table.row(TaskId::Tick).priority.unwrap_or(1);
    tried(move || raise_priority(priority), format!("SCHED_FIFO {priority}"))
}

fn pinning(config: &Config) -> Verdict {
    let wanted = [&config.runtime.tick_cpus, &config.runtime.work_cpus].map(Clone::clone);
    let granted = match wanted[0].is_empty() {
        true => "none asked for".to_owned(),
        false => format!("tick on {:?}", wanted[0]),
    };
    tried(move || wanted.iter().try_for_each(|cpus| pin(cpus)), granted)
}

/// In a virtual machine even the shallowest sleep is left only when its host gets round to it.
fn sleep(config: &Config, refusal: Option<&HostRefusal>) -> Verdict {
    let us = config.runtime.idle_latency_us;
    let driver = std::fs::read_to_string("/sys/devices/system/cpu/cpuidle/current_driver");
    let is_virtual = driver.is_ok_and(|driver| driver.trim() == "haltpoll");
    match refusal {
        Some(refusal) => (Fitness::Mind, refusal.to_string()),
        None if is_virtual && us != 0 => (Fitness::Mind,
            "virtual machine: set runtime.idle_latency_us = 0, which keeps its processors awake; else ticks come late"
                .into(),
        ),
        None if us < 0 => (Fitness::Good, "left to the system".into()),
        None if us == 0 => (Fitness::Good, "processors stay awake in flight".into()),
        None => (Fitness::Good, format!("processors wake up within {us} us in flight")),
    }
}

fn timer(config: &Config, table: &TaskTable, watch: Duration) -> Verdict {
    let (task, cpus) = (*table.row(TaskId::Tick), config.runtime.tick_cpus.clone());
    let timed = std::thread::spawn(move || {
        bare_timer::run(task.period, task.priority, &cpus, watch, &AtomicBool::new(false))
    });
    let Ok(timer) = timed.join() else { return (Fitness::Mind, "cannot be tried".into()) };
    let late = timer.late_ms.percentiles();
    let words = format!(
        "{} releases of a bare timer: late by {:.3} ms at the median, p99 {:.3}, p99.9 {:.3}, largest {:.3}",
        timer.late_ms.count(),
        late.p50,
        late.p99,
        timer.late_ms.quantile(0.999),
        late.max
    );
    if late.max <= LATE_MS {
        return (Fitness::Good, words);
    }
    let cure = "the host itself makes ticks late: stop other load, keep the processors fast (cpupower frequency-set -g performance), boot \
                with preempt=full or a PREEMPT_RT kernel; a virtual machine may always be late";
    (Fitness::Mind, format!("{words}; {cure}"))
}
