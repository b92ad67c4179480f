//! The task table: everything that runs in a live flight, with its place and its promises.
//!
//! Higher priorities interrupt lower ones (SCHED_FIFO, where the host allows it). A task that cannot keep its
//! deadline follows its overrun rule; none ever lets a queue grow.

use plumbline_config::Config;
use std::fmt::{self, Display, Formatter};
use std::time::Duration;

/// Ticks without an inertial rate to go by would be pointless: a rate is always given, and at least this.
const SLOWEST_HZ: f64 = 1.0;

/// Silence of the map and of the local socket that is no stall: they yield to everything else.
const YIELDING_STALL: Duration = Duration::from_secs(2);
/// A task that is silent for this long is taken for hung: the process ends.
const PATIENCE: Duration = Duration::from_millis(1500);
/// Patience with sensor and tick: systemd is notified of their silence at once, and ends the process itself.
const TICK_PATIENCE: Duration = Duration::from_secs(2);
/// The watchdog looks this often.
pub const WATCH_PERIOD: Duration = Duration::from_millis(10);

/// A thread of a live run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskId {
    /// Reads the inertial driver.
    Imu,
    /// Propagates and hands out odometry.
    Tick,
    /// Reads the camera driver.
    Camera,
    /// Tracks points and lines.
    FrontEnd,
    /// Solves the window.
    Window,
    /// Recognizes places and makes the map.
    Places,
    /// Sends odometry to the autopilot.
    Autopilot,
    /// Serves the readers of the local socket.
    Local,
    /// Looks after the others.
    Watchdog,
}

impl TaskId {
    /// All tasks, in the order of the data flow.
    pub const ALL: [Self; 9] = [
        Self::Imu,
        Self::Tick,
        Self::Camera,
        Self::FrontEnd,
        Self::Window,
        Self::Places,
        Self::Autopilot,
        Self::Local,
        Self::Watchdog,
    ];
}

/// Policy for a late task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overrun {
    /// Runs everything due at once, one after the other; the ticks missed are counted.
    CatchUp,
    /// The newest frame is taken, older ones that wait are refused.
    Shed,
    /// The ladder takes work away from the frames to come.
    Degrade,
    /// A driver waits for its device.
    Wait,
    /// Frames are passed over until it is done.
    PassOver,
}

/// Consequence of a task's death for a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// The process ends, to be started again: nothing here can replace it.
    Process,
    /// Front-end and window go on from a fresh estimator, a reset; the odometry goes on by the IMU meanwhile.
    Estimate,
    /// It is told, and the flight goes on without it.
    Itself,
}

/// On which of the configured processors a task runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessorSet {
    /// On `runtime.tick_cpus`: what must not wait for frames.
    Tick,
    /// On `runtime.work_cpus`: what a frame needs.
    Work,
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    /// Identity of the task.
    pub id: TaskId,
    /// Name, also that of its thread.
    pub name: &'static str,
    /// SCHED_FIFO priority, 1 to 99; `None` for normal scheduling.
    pub priority: Option<u8>,
    /// Processors on which it runs.
    pub place: ProcessorSet,
    /// Time from one release to the next.
    pub period: Duration,
    /// Computation that one release should need at most.
    pub budget: Duration,
    /// Time from release to completion that must not be exceeded.
    pub deadline: Duration,
    /// Silence after which the watchdog calls it stalled.
    pub stall: Duration,
    /// Silence after which the process ends: a thread cannot be stopped from outside. `None` for optional tasks.
    pub patience: Option<Duration>,
    /// Consequence of its death for a flight.
    pub loss: Loss,
    /// Policy when it is late.
    pub overrun: Overrun,
}

/// Every task of a live run of `config` at `speed` times real time.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskTable([Task; TaskId::ALL.len()]);

impl TaskTable {
    /// The table for a configuration: periods are those of its sensors.
    #[must_use]
    pub fn new(config: &Config, speed: f64) -> Self {
        let period = |rate_hz: f64| Duration::from_secs_f64(1.0 / (rate_hz.max(SLOWEST_HZ) * speed));
        let (sample, frame) = (period(config.imu.rate_hz), period(config.camera[0].rate_hz));
        let ms = Duration::from_millis;
        // A stalled stage is named within a tenth of a second of its silence: the watchdog looks every 10 ms.
        let patience = |id| if matches!(id, TaskId::Imu | TaskId::Tick) { TICK_PATIENCE } else { PATIENCE };
        let stall = |usual: Duration| (usual + usual / 2).max(ms(80));
        let task = |id: TaskId, name, priority, period: Duration, budget, deadline, overrun| Task {
            id,
            name,
            priority,
            place: if matches!(id, TaskId::Imu | TaskId::Tick) {
                ProcessorSet::Tick
            } else {
                ProcessorSet::Work
            },
            period,
            budget,
            deadline,
            stall: stall(period),
            patience: Some(patience(id).max(3 * stall(period))),
            loss: if matches!(id, TaskId::FrontEnd | TaskId::Window) {
                Loss::Estimate
            } else {
                Loss::Process
            },
            overrun,
        };
        let yielding =
            |task: Task| Task { stall: YIELDING_STALL, patience: None, loss: Loss::Itself, ..task };
        let sent = Duration::from_secs_f64(1.0 / config.autopilot.rate_hz.max(SLOWEST_HZ));
        let look = WATCH_PERIOD;
        let map = 5 * frame;
        Self([
            task(TaskId::Imu, "imu", Some(85), sample, sample / 50, sample, Overrun::Wait),
            task(TaskId::Tick, "tick", Some(80), sample, sample / 10, sample / 5, Overrun::CatchUp),
            task(TaskId::Camera, "camera", None, frame, frame / 2, frame, Overrun::Wait),
            task(TaskId::FrontEnd, "front-end", Some(60), frame, frame / 2, frame, Overrun::Shed),
            task(TaskId::Window, "window", Some(50), frame, frame / 2, frame, Overrun::Degrade),
            yielding(task(TaskId::Places, "places", Some(40), map, frame, map, Overrun::PassOver)),
            task(TaskId::Autopilot, "autopilot", Some(70), sent, sent / 50, sent, Overrun::CatchUp),
            yielding(task(TaskId::Local, "socket", None, sample, sample / 10, sample, Overrun::PassOver)),
            // Above those whom it looks after: one that spins must not starve it. It looks, and is done.
            task(TaskId::Watchdog, "watchdog", Some(90), look, look / 50, look, Overrun::CatchUp),
        ])
    }

    /// The row of a task.
    #[must_use]
    pub fn row(&self, id: TaskId) -> &Task {
        &self.0[id as usize]
    }

    /// All rows.
    pub fn rows(&self) -> impl Iterator<Item = &Task> {
        self.0.iter()
    }
}

impl Display for TaskTable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<10} {:>8} {:>10} {:>10} {:>10} {:>10}  overrun",
            "task", "priority", "period ms", "budget ms", "deadline", "stall"
        )?;
        for task in self.rows() {
            let priority = task.priority.map_or_else(|| "-".into(), |p| p.to_string());
            let ms = |d: Duration| format!("{:.1}", d.as_secs_f64() * 1e3);
            let overrun = match task.overrun {
                Overrun::CatchUp => "catch up",
                Overrun::Shed => "shed older frames",
                Overrun::Degrade => "step down the ladder",
                Overrun::Wait => "wait for the device",
                Overrun::PassOver => "pass frames over",
            };
            writeln!(
                f,
                "{:<10} {priority:>8} {:>10} {:>10} {:>10} {:>10}  {overrun}",
                task.name,
                ms(task.period),
                ms(task.budget),
                ms(task.deadline),
                ms(task.stall)
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_has_its_row_and_the_tick_goes_first_among_the_estimators() {
        let table = TaskTable::new(&Config::preset("sim").unwrap(), 1.0);
        for id in TaskId::ALL {
            assert_eq!(table.row(id).id, id);
        }
        let priority = |id| table.row(id).priority;
        assert!(priority(TaskId::Tick) > priority(TaskId::FrontEnd));
        assert!(priority(TaskId::FrontEnd) > priority(TaskId::Window));
        assert_eq!(table.row(TaskId::Tick).period, Duration::from_millis(5));
        assert!(table.rows().all(|t| t.budget <= t.deadline && t.deadline <= t.period.max(t.stall)));
        assert_eq!(table.to_string().lines().count(), 1 + TaskId::ALL.len());
        assert!(table.rows().all(|t| priority(TaskId::Watchdog) >= t.priority));
        assert!(table.rows().all(|t| t.patience.is_none_or(|patience| patience > 2 * t.stall)));
    }
}
