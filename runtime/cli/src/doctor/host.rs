//! Checks that this host and this configuration are fit for a flight.

use super::verdict::{Check, CheckVerdict};
use plumbline_config::options::VehicleConfig;
use plumbline_config::{Config, ValidConfig};
use plumbline_flight::schedule::bare_timer;
use plumbline_flight::schedule::host::{HostRefusal, limit_idle_latency, lock_memory, pin, raise_priority};
use plumbline_flight::schedule::tasks::{TaskId, TaskTable};
use std::path::Path;
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
        ("locked memory", memory()),
        ("pinning", pinning(config)),
        ("sleep", sleep(config, awake.as_ref().err())),
        ("frequency governor", governor()),
        ("clock source", clock_source()),
        ("kernel", kernel()),
        ("timer", timer(config, table, watch)),
    ]
}

fn configuration(config: &ValidConfig) -> CheckVerdict {
    let hash = plumbline_record::digest::config_hash(config);
    let cameras = config.camera.len();
    let words = format!("valid, {cameras} camera(s), IMU at {} Hz, hash {}", config.imu.rate_hz, &hash[..16]);
    if let Some(unset) = config.unset_keys().first() {
        return CheckVerdict::NotFit(format!("{words}; {unset}"));
    }
    let needs_mounting = !config.autopilot.connect.is_empty() || config.ros.enabled;
    if config.vehicle.rot_v_b().is_none() && needs_mounting {
        return CheckVerdict::NotFit(format!("{}: {}", VehicleConfig::UNKNOWN, VehicleConfig::CURE));
    }
    if config.vehicle.rot_v_b().is_none() {
        return CheckVerdict::Poor(format!("{}: {}", VehicleConfig::UNKNOWN, VehicleConfig::CURE));
    }
    if cameras == 2 {
        CheckVerdict::Fine(words)
    } else {
        CheckVerdict::Poor(format!("{words}; one camera finds its scale late"))
    }
}

fn processors() -> CheckVerdict {
    match std::thread::available_parallelism().map_or(1, usize::from) {
        1 => CheckVerdict::Poor("one: front-end and window take turns; give the process two".into()),
        n => CheckVerdict::Fine(format!("{n}")),
    }
}

/// On a thread of its own: the priority goes with it.
fn priority(table: &TaskTable) -> CheckVerdict {
    let priority = table.row(TaskId::Tick).priority.unwrap_or(1);
    match std::thread::spawn(move || raise_priority(priority)).join() {
        Ok(Ok(())) => CheckVerdict::Fine(format!("SCHED_FIFO {priority}")),
        Ok(Err(refusal)) => CheckVerdict::Poor(refusal.to_string()),
        Err(_) => CheckVerdict::Poor("cannot be tried".into()),
    }
}

fn memory() -> CheckVerdict {
    match lock_memory() {
        Ok(()) => CheckVerdict::Fine("granted".into()),
        Err(refusal) => CheckVerdict::Poor(refusal.to_string()),
    }
}

fn pinning(config: &Config) -> CheckVerdict {
    let wanted = [&config.runtime.tick_cpus, &config.runtime.work_cpus].map(Clone::clone);
    let outcome = std::thread::spawn(move || wanted.iter().try_for_each(|cpus| pin(cpus))).join();
    match outcome {
        Ok(Ok(())) if config.runtime.tick_cpus.is_empty() => CheckVerdict::Fine("none asked for".into()),
        Ok(Ok(())) => CheckVerdict::Fine(format!("tick on {:?}", config.runtime.tick_cpus)),
        Ok(Err(refusal)) => CheckVerdict::Poor(refusal.to_string()),
        Err(_) => CheckVerdict::Poor("cannot be tried".into()),
    }
}

/// The first line of a file of the system.
fn line_of(path: &str) -> Option<String> {
    Some(std::fs::read_to_string(Path::new(path)).ok()?.lines().next()?.trim().to_owned())
}

/// In a virtual machine even the shallowest sleep is left only when its host gets round to it.
fn sleep(config: &Config, refusal: Option<&HostRefusal>) -> CheckVerdict {
    let us = config.runtime.idle_latency_us;
    let is_virtual = line_of("/sys/devices/system/cpu/cpuidle/current_driver").as_deref() == Some("haltpoll");
    match refusal {
        Some(refusal) => CheckVerdict::Poor(refusal.to_string()),
        None if is_virtual && us != 0 => CheckVerdict::Poor(
            "virtual machine: set runtime.idle_latency_us = 0, which keeps its processors awake; else ticks come late"
                .into(),
        ),
        None if us < 0 => CheckVerdict::Fine("left to the system".into()),
        None if us == 0 => CheckVerdict::Fine("processors stay awake in flight".into()),
        None => CheckVerdict::Fine(format!("processors wake up within {us} us in flight")),
    }
}

fn governor() -> CheckVerdict {
    match line_of("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").as_deref() {
        None => CheckVerdict::Fine("not adjustable here".into()),
        Some("performance") => CheckVerdict::Fine("performance".into()),
        Some(other) => CheckVerdict::Poor(format!(
            "{other}: set it to performance (cpupower frequency-set -g performance)"
        )),
    }
}

fn clock_source() -> CheckVerdict {
    match line_of("/sys/devices/system/clocksource/clocksource0/current_clocksource") {
        Some(name) if name.contains("hpet") || name.contains("acpi") || name == "jiffies" => {
            CheckVerdict::Poor(format!("{name} is slow to read; tsc or the architecture's own is better"))
        }
        Some(name) => CheckVerdict::Fine(name),
        None => CheckVerdict::Fine("not told".into()),
    }
}

fn kernel() -> CheckVerdict {
    let release = line_of("/proc/sys/kernel/osrelease").unwrap_or_else(|| "unknown".into());
    if line_of("/sys/kernel/realtime").as_deref() == Some("1") {
        return CheckVerdict::Fine(format!("{release}, PREEMPT_RT"));
    }
    let has = |path: &str, word: &str| line_of(path).is_some_and(|line| line.contains(word));
    let hint = if has("/proc/sys/kernel/version", "PREEMPT_DYNAMIC") && !has("/proc/cmdline", "preempt=full")
    {
        "; the boot option preempt=full shortens delays by the kernel"
    } else {
        ""
    };
    CheckVerdict::Fine(format!(
        "{release}, without PREEMPT_RT: the line `timer` below measures the delays{hint}"
    ))
}

fn timer(config: &Config, table: &TaskTable, watch: Duration) -> CheckVerdict {
    let (task, cpus) = (*table.row(TaskId::Tick), config.runtime.tick_cpus.clone());
    let timed = std::thread::spawn(move || {
        bare_timer::run(task.period, task.priority, &cpus, watch, &AtomicBool::new(false))
    });
    let Ok(timer) = timed.join() else { return CheckVerdict::Poor("cannot be tried".into()) };
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
        CheckVerdict::Fine(words)
    } else {
        CheckVerdict::Poor(format!(
            "{words}; the host itself makes ticks late (other load, power saving, a virtual machine)"
        ))
    }
}
