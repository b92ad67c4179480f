//! The task table: everything that runs in a live flight, with its place and its promises.
//!
//! Higher priorities interrupt lower ones (SCHED_FIFO, where the host allows it). None ever lets a queue
//! grow: a late tick takes everything due at once, the front-end refuses the older of the frames that wait, the window has the
//! ladder take work away from the frames to come, and the map passes frames over.

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

    /// Name, also that of its thread.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Imu => "imu",
            Self::Tick => "tick",
            Self::Camera => "camera",
            Self::FrontEnd => "front-end",
            Self::Window => "window",
            Self::Places => "places",
            Self::Autopilot => "autopilot",
            Self::Local => "socket",
            Self::Watchdog => "watchdog",
        }
    }
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
    /// Time from release to completion that must not be exceeded.
    pub deadline: Duration,
    /// Silence after which the watchdog calls it stalled.
    pub stall: Duration,
    /// Silence after which the process ends: a thread cannot be stopped from outside. `None` for optional tasks.
    pub patience: Option<Duration>,
    /// Consequence of its death for a flight.
    pub loss: Loss,
}

/// Every task of a live run of `config` at `speed` times real time.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskTable([Task; TaskId::ALL.len()]);

impl TaskTable {
    /// The table for a configuration: periods are those of its sensors.
    pub fn new(config: &Config, speed: f64) -> Self {
        let period = |rate_hz: f64| Duration::from_secs_f64(1.0 / (rate_hz.max(SLOWEST_HZ) * speed));
        let (sample, frame) = (period(config.imu.rate_hz), period(config.camera[0].rate_hz));
        let task = |id: TaskId, priority, period: Duration| {
            let is_first = matches!(id, TaskId::Imu | TaskId::Tick);
            // A stalled stage is named within a tenth of a second of its silence: the watchdog looks every 10 ms.
            let stall = (period + period / 2).max(Duration::from_millis(80));
            Task {
                id,
                name: id.name(),
                priority,
                place: if is_first { ProcessorSet::Tick } else { ProcessorSet::Work },
                period,
                deadline: if id == TaskId::Tick { period / 5 } else { period },
                stall,
                patience: Some(if is_first { TICK_PATIENCE } else { PATIENCE }.max(3 * stall)),
                loss: match id {
                    TaskId::FrontEnd | TaskId::Window => Loss::Estimate,
                    _ => Loss::Process,
                },
            }
        };
        let yielding =
            |task: Task| Task { stall: YIELDING_STALL, patience: None, loss: Loss::Itself, ..task };
        let sent = Duration::from_secs_f64(1.0 / config.autopilot.rate_hz.max(SLOWEST_HZ));
        Self([
            task(TaskId::Imu, Some(85), sample),
            task(TaskId::Tick, Some(80), sample),
            task(TaskId::Camera, None, frame),
            task(TaskId::FrontEnd, Some(60), frame),
            task(TaskId::Window, Some(50), frame),
            yielding(task(TaskId::Places, Some(40), 5 * frame)),
            task(TaskId::Autopilot, Some(70), sent),
            yielding(task(TaskId::Local, None, sample)),
            // Above those whom it looks after: one that spins must not starve it. It looks, and is done.
            task(TaskId::Watchdog, Some(90), WATCH_PERIOD),
        ])
    }

    /// The row of a task.
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
            "{:<10} {:>8} {:>10} {:>10} {:>10}",
            "task", "priority", "period ms", "deadline", "stall"
        )?;
        for task in self.rows() {
            let priority = task.priority.map_or_else(|| "-".into(), |p| p.to_string());
            let ms = |d: Duration| format!("{:.1}", d.as_secs_f64() * 1e3);
            writeln!(
                f,
                "{:<10} {priority:>8} {:>10} {:>10} {:>10}",
                task.name,
                ms(task.period),
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
        assert!(table.rows().all(|t| t.deadline <= t.period.max(t.stall)));
        assert_eq!(table.to_string().lines().count(), 1 + TaskId::ALL.len());
        assert!(table.rows().all(|t| priority(TaskId::Watchdog) >= t.priority));
        assert!(table.rows().all(|t| t.patience.is_none_or(|patience| patience > 2 * t.stall)));
    }
}
