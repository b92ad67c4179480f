//! Faults of tasks, done on purpose: what the tests of survival need, and no product has in it (feature `sabotage`).
//!
//! `PLUMBLINE_SABOTAGE="tick=panic@2.5 window=hang@3"`: the task panics, or spins for ever, at its first sign of life so many
//! seconds after that of the process. Several times are several faults: `window=panic@2,3,4`.

use super::tasks::TaskId;
use super::ticker::Monotonic;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Variable that holds the faults.
const VARIABLE: &str = "PLUMBLINE_SABOTAGE";

/// Faults of one task.
#[derive(Debug)]
struct Plan {
    id: TaskId,
    is_panic: bool,
    at_s: Vec<f64>,
    done: AtomicUsize,
}

/// Called at a sign of life of the task: ends it, if that is planned.
pub fn strike(id: TaskId) {
    static PLANS: OnceLock<(Monotonic, Vec<Plan>)> = OnceLock::new();
    let (start, plans) = PLANS.get_or_init(|| {
        let text = std::env::var(VARIABLE).unwrap_or_default();
        (Monotonic::now(), text.split_whitespace().map(plan).collect())
    });
    for plan in plans.iter().filter(|plan| plan.id == id) {
        let done = plan.done.load(Ordering::Relaxed);
        let is_due = |s: &f64| Monotonic::now().ms_since(*start) >= s * 1e3;
        if !plan.at_s.get(done).is_some_and(is_due) {
            continue;
        }
        plan.done.store(done + 1, Ordering::Relaxed);
        assert!(!plan.is_panic, "sabotage of {id:?}");
        loop {
            std::hint::spin_loop();
        }
    }
}

/// `TASK=panic@S,S` or `TASK=hang@S`.
fn plan(words: &str) -> Plan {
    let wrong = || -> ! { panic!("{VARIABLE}: '{words}' is not TASK=panic@S or TASK=hang@S") };
    let Some((task, fault)) = words.split_once('=') else { wrong() };
    let Some((kind, at)) = fault.split_once('@') else { wrong() };
    let id = TaskId::ALL.into_iter().find(|id| id.name() == task).unwrap_or_else(|| wrong());
    let at_s = at.split(',').map(|s| s.parse().unwrap_or_else(|_| wrong())).collect();
    Plan { id, is_panic: kind == "panic", at_s, done: AtomicUsize::new(0) }
}
