//! The executor of real time: one thread a task, rings between them, deadlines of the clock.
//!
//! ```text
//! imu ──> tick ─────────────────────────> listeners: readings, corrections, odometry
//!          │  ^ estimates
//!          v  └────────────┐
//! camera ─> front-end ─> window ────────> listeners: estimates
//!           │   ^ feedback  │
//!           │   └───────────┘
//!           └───────────────────────────> listeners: frames, orders
//! ```
//!
//! A recording is held back until its samples are due, and the tick is released on their grid. What live sensors bring is
//! due: the tick is woken by a reading. Everything that the clock decides is decided in two places: [`front_end`] takes the newest frame and
//! chooses its rung (and goes on without samples that do not come), [`tick`] corrects the odometry by what has
//! arrived. A watchdog beside them names who is silent. [`wiring`] joins the tasks; the caller's thread waits for
//! their end, and nothing passes through it.

mod drivers;
mod figures;
mod front_end;
mod places;
mod shared;
mod tick;
mod watchdog_thread;
mod window;
mod wiring;

pub use figures::LiveFigures;

use super::effect::Effect;
use super::instants::Instants;
use super::listener::{Listener, Producer, Subscriber};
use super::places::PlacesStage;
use super::stages::{self, FrontStage, WindowStage};
use super::team::Team;
use super::tick::TickStage;
use super::{Control, DriverFaults, PlacesEnd, RunError, RunOutcome, Stamps, Streams};
use crate::schedule::host::Host;
use crate::schedule::tasks::{TaskId, TaskTable};
use crate::schedule::watchdog::Heartbeats;
use drivers::CameraEnd;
use front_end::FrontEndEnd;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::Faults;
use plumbline_estimator::places::PlaceMap;
use shared::{Origin, RunPace, RunState};
use std::sync::Arc;
use std::thread::ScopedJoinHandle;
use std::time::Duration;
use tick::TickEnd;
use watchdog_thread::{WatchdogFigures, WatchdogThread};
use window::WindowEnd;
use wiring::{Sensors, Stages, Tasks};

/// Sleep of a thread between checks for a stop.
const NAP: Duration = Duration::from_millis(50);

/// A live run of one estimator, allocated and ready to start.
pub struct Live {
    config: ValidConfig,
    speed: f64,
    team: Team,
    host: Arc<Host>,
    stages: Stages,
    heartbeats: Heartbeats,
    /// Told by the watchdog.
    listener: Box<dyn Listener>,
}

impl Live {
    /// Stages with everything allocated for the configuration; `helpers` threads share the work on a frame. The map goes on with the
    /// keyframes of `known`; with `instants` the last seconds are kept.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new(
        config: &ValidConfig,
        speed: f64,
        (helpers, host): (usize, Arc<Host>),
        (known, instants): (Option<PlaceMap>, Option<Arc<Instants>>),
        subscriber: &mut dyn Subscriber,
    ) -> Result<Self, RunError> {
        let table = TaskTable::new(config, speed);
        let (theirs, task) = (Arc::clone(&host), *table.row(TaskId::FrontEnd));
        let team = Team::new(helpers, move || theirs.enter(&task))
            .map_err(|error| RunError::Thread(error.to_string()))?;
        let stages = Stages {
            front: FrontStage::new(config, subscriber),
            window: WindowStage::new(config, Effect::ByRule, subscriber.listener(Producer::Window)),
            tick: TickStage::new(config, Effect::ByRule, subscriber.listener(Producer::Tick), instants),
            places: PlacesStage::new(config, known, subscriber.listener(Producer::Places)),
        };
        let listener = subscriber.listener(Producer::Watchdog);
        let mut heartbeats = Heartbeats::default();
        subscriber.pulses(&mut |pulse| heartbeats.adopt(pulse));
        Ok(Self { config: config.clone(), speed, team, host, stages, heartbeats, listener })
    }

    /// Runs both streams to their end, or until `control` says so.
    ///
    /// # Errors
    /// When a driver cannot go on, a thread is refused, or a task ended by a fault.
    pub fn run(
        self,
        Streams { mut imu, stereo, stamps, first_reset_counter, .. }: Streams,
        control: &Control,
    ) -> Result<RunOutcome, RunError> {
        let Self { config, speed, team, host, mut stages, heartbeats, listener } = self;
        stages.window.count_resets_from(first_reset_counter);
        let (first, origin) = match stamps {
            // Sensors may be missing yet.
            Stamps::OfHost => (None, Origin::of_host()),
            Stamps::Replayed => {
                let first = imu.next_reading()?;
                let stamp = first.as_ref().map(|reading| reading.sample.stamp);
                (first, Origin::soon(stamp.unwrap_or(Timestamp::MIN)))
            }
        };
        let pace = RunPace { stamps, origin, speed };
        let shared = RunState::new(TaskTable::new(&config, speed), heartbeats, host, control, pace);
        let tasks = Tasks::new(&config, Sensors { imu, first, stereo }, stages);
        let ended = run_tasks(&shared, tasks, &team, listener);
        match shared.into_failure() {
            Some(error) => Err(error),
            None => Ok(ended?.outcome(&team)),
        }
    }
}

/// Starts a thread for each task, and waits until all have ended.
fn run_tasks(
    shared: &RunState<'_>,
    tasks: Tasks,
    team: &Team,
    listener: Box<dyn Listener>,
) -> Result<Ended, RunError> {
    let Tasks { imu, tick, camera, front_end, window, places } = tasks;
    let watchdog = WatchdogThread::default();
    std::thread::scope(|scope| {
        let watching = watchdog.start(scope, shared, listener)?;
        // Also when a task could not be started, or ended by a fault.
        let until_the_end = watchdog.end_on_drop();
        let places = places.map(|places| shared.spawn(scope, TaskId::Places, move || places.run(shared)));
        let places = places.transpose()?;
        let window = shared.spawn(scope, TaskId::Window, move || window.run(shared))?;
        let front_end =
            shared.spawn(scope, TaskId::FrontEnd, || team.lead(|| front_end.run(shared, team)))?;
        let camera = shared.spawn(scope, TaskId::Camera, move || camera.run(shared))?;
        let imu = shared.spawn(scope, TaskId::Imu, move || imu.run(shared))?;
        let tick = shared.spawn(scope, TaskId::Tick, move || tick.run(shared))?;
        let tasks = (joined(tick, "tick"), joined(front_end, "front-end"), joined(window, "window"));
        let drivers = (joined(camera, "camera"), joined(imu, "imu"));
        let places = places.map(|places| joined(places, "places"));
        drop(until_the_end);
        let watchdog = watching.join().map_err(|_| RunError::Fault("watchdog"))?;
        Ok(Ended {
            tick: tasks.0?,
            front_end: tasks.1?,
            window: tasks.2?,
            camera: drivers.0?,
            imu: drivers.1?,
            places: places.transpose()?,
            watchdog,
        })
    })
}

/// Result of a task; a fault that ended the task has been reported already.
fn joined<T>(handle: ScopedJoinHandle<'_, Option<T>>, name: &'static str) -> Result<T, RunError> {
    handle.join().ok().flatten().ok_or(RunError::Fault(name))
}

/// Results of the tasks.
struct Ended {
    tick: TickEnd,
    front_end: FrontEndEnd,
    window: WindowEnd,
    camera: CameraEnd,
    imu: Faults,
    places: Option<PlacesStage>,
    watchdog: WatchdogFigures,
}

impl Ended {
    fn outcome(mut self, team: &Team) -> RunOutcome {
        let mut figures = stages::total(&self.front_end.stage, &self.window.stage, &self.tick.stage, team);
        figures.hot_path_allocations += self.watchdog.allocations;
        figures.frames_refused +=
            self.front_end.figures.refused() + self.camera.figures.frames_overdue_at_source;
        let passed_over = self.front_end.figures.places_passed_over;
        let places = self.places.take();
        RunOutcome {
            places: places.map(|places| PlacesEnd::new(places, &self.window.stage, passed_over)),
            estimate_digest: self.window.stage.digest(),
            odometry_digest: self.tick.stage.digest(),
            faults: DriverFaults { imu: self.imu, cameras: self.camera.faults },
            live: Some(LiveFigures::new(&self)),
            figures,
        }
    }
}
