//! The executor of real time: one thread a task, rings between them, deadlines of the clock.
//!
//! ```text
//! imu ──> tick ──────────────> odometry ─┐
//!          │  ^ estimates                 ├─> the caller's thread ─> sink
//!          v  └────────────┐              │
//! camera ─> front-end ─> window ─> estimates
//!               ^ feedback  │
//!               └───────────┘
//! ```
//!
//! Everything that the clock decides is decided in two places: [`front_end`] takes the newest frame and
//! chooses its rung (and goes on without samples that do not come), [`tick`] corrects the odometry by what has
//! arrived. A watchdog beside them names who is silent.

mod drivers;
mod figures;
mod front_end;
mod tick;
mod watchdog_thread;
mod window;

pub use figures::LiveFigures;

use super::figures::Figures;
use super::stages::{Cost, FrontStage, Job, WindowStage};
use super::tap::Tap;
use super::team::Team;
use super::tick::TickStage;
use super::{Control, Outcome, RunError, Sink, Streams, sizes_of};
use crate::schedule::host::Host;
use crate::schedule::ring::{Bell, Reader, ring};
use crate::schedule::tasks::{TaskId, TaskTable};
use crate::schedule::ticker::Monotonic;
use crate::schedule::watchdog::Heartbeats;
use drivers::{Arrival, CameraFigures, CameraTask, ImuTask};
use front_end::{FrontEndFigures, FrontEndRings, FrontEndTask};
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::{Faults, StereoFrame};
use plumbline_estimator::{Estimate, Feedback, Odometry};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, Scope, ScopedJoinHandle};
use std::time::Duration;
use tick::{TickTask, TickTaskFigures};
use watchdog_thread::WatchdogThread;
use window::WindowTask;

/// Frames that are filled, wait or are tracked at a time.
const FRAME_POOL: usize = 4;
/// Frames between front-end and window: one being tracked, one waiting, one being solved.
const JOB_POOL: usize = 3;
/// Readings that a replay driver is ahead of the clock, or a tick behind it: a quarter of a second at 200 Hz.
const READING_RING: usize = 64;
/// Readings that wait for the front-end: a minute at 200 Hz.
const SAMPLE_RING: usize = 12_000;
/// Odometry and estimates that wait for the caller's thread.
const ODOMETRY_RING: usize = 512;
const ESTIMATE_RING: usize = 64;
/// From the start of the threads to the first release, ns.
const START_DELAY_NS: i64 = 50_000_000;
/// How long a thread sleeps before it looks whether the run has been stopped.
const NAP: Duration = Duration::from_millis(50);

/// What all tasks of a run share.
struct Shared<'a> {
    table: TaskTable,
    heartbeats: Heartbeats,
    host: Arc<Host>,
    control: &'a Control,
    /// When the sample of `origin.0` is due, on the machine's clock.
    origin: (Timestamp, Monotonic),
    speed: f64,
    /// What the window took for its last frame, ms, as the bits of an `f64`.
    window_ms: AtomicU64,
    failure: Mutex<Option<RunError>>,
}

impl Shared<'_> {
    /// When data of `stamp` are due.
    fn due(&self, stamp: Timestamp) -> Monotonic {
        let data_ns = stamp.nanos_since(self.origin.0) as f64;
        self.origin.1.plus_nanos((data_ns / self.speed) as i64)
    }

    /// The time of data that are due at `at`.
    fn data_time(&self, at: Monotonic) -> Timestamp {
        let wall_ns = (at.0 - self.origin.1.0) as f64;
        self.origin.0.plus_nanos((wall_ns * self.speed) as i64)
    }

    fn is_stopped(&self) -> bool {
        self.control.is_stopped()
    }

    fn set_window_ms(&self, ms: f64) {
        self.window_ms.store(ms.to_bits(), Ordering::Relaxed);
    }

    fn window_ms(&self) -> f64 {
        f64::from_bits(self.window_ms.load(Ordering::Relaxed))
    }

    /// Keeps the first failure of a run.
    fn fail(&self, error: RunError) {
        tracing::error!("{error}");
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Starts the thread of a task. Its fault ends the task, not the run: the odometry goes on.
    fn spawn<'scope, T: Send + 'scope>(
        &'scope self,
        scope: &'scope Scope<'scope, '_>,
        id: TaskId,
        work: impl FnOnce() -> T + Send + 'scope,
    ) -> Result<ScopedJoinHandle<'scope, Option<T>>, RunError> {
        let task = self.table.row(id);
        Builder::new()
            .name(task.name.into())
            .spawn_scoped(scope, move || {
                self.host.enter(task);
                let outcome = catch_unwind(AssertUnwindSafe(work));
                self.heartbeats.idle(id);
                outcome.map_err(|_| self.fail(RunError::Fault(task.name))).ok()
            })
            .map_err(|error| RunError::Thread(error.to_string()))
    }
}

/// A live run of one estimator, allocated and ready to start.
pub struct Live {
    config: ValidConfig,
    speed: f64,
    team: Team,
    host: Arc<Host>,
    tap: Box<dyn Tap>,
    front: FrontStage,
    window: WindowStage,
    tick: TickStage,
}

impl Live {
    /// Everything allocated for the configuration; `helpers` threads share the work on a frame.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new(
        config: &ValidConfig,
        speed: f64,
        helpers: usize,
        host: Arc<Host>,
        tap: &dyn Tap,
    ) -> Result<Self, RunError> {
        let table = TaskTable::new(config, speed);
        let (theirs, task) = (Arc::clone(&host), *table.row(TaskId::FrontEnd));
        let team = Team::new(helpers, move || theirs.enter(&task))
            .map_err(|error| RunError::Thread(error.to_string()))?;
        Ok(Self {
            config: config.clone(),
            speed,
            team,
            host,
            tap: tap.another(),
            front: FrontStage::new(config, tap.another()),
            window: WindowStage::new(config, tap.another()),
            tick: TickStage::new(config, tap.another()),
        })
    }

    /// Runs both streams to their end, or until `control` says so.
    ///
    /// # Errors
    /// When a driver cannot go on, a thread is refused, or a task ended by a fault.
    pub fn run(
        self,
        Streams { mut imu, stereo }: Streams,
        control: &Control,
        sink: &mut dyn Sink,
    ) -> Result<Outcome, RunError> {
        let first = imu.next_reading()?;
        let start = Monotonic::now().plus_nanos(START_DELAY_NS);
        let shared = Shared {
            table: TaskTable::new(&self.config, self.speed),
            heartbeats: Heartbeats::default(),
            host: Arc::clone(&self.host),
            control,
            origin: (first.map_or(Timestamp::MIN, |r| r.sample.stamp), start),
            speed: self.speed,
            window_ms: AtomicU64::default(),
            failure: Mutex::default(),
        };
        let outcome = self.run_tasks(&shared, ImuTask { source: imu, first }, stereo, sink)?;
        match shared.failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => Ok(outcome),
        }
    }

    /// Joins the tasks by rings, starts them, and hands on what they produce until they have ended.
    fn run_tasks(
        self,
        shared: &Shared<'_>,
        imu: ImuTask,
        stereo: Box<dyn plumbline_drivers::StereoSource>,
        sink: &mut dyn Sink,
    ) -> Result<Outcome, RunError> {
        let Self { config, team, tap, front, window, tick, .. } = self;
        let [tick_bell, front_bell, window_bell, camera_bell, sink_bell] =
            std::array::from_fn(|_| Bell::default());
        let (readings_in, readings) = ring(READING_RING, &tick_bell);
        let (samples_in, samples) = ring(SAMPLE_RING, &front_bell);
        let (arrivals_in, arrivals) = ring::<Arrival>(FRAME_POOL, &front_bell);
        let (mut empty_in, empty) = ring::<StereoFrame>(FRAME_POOL, &camera_bell);
        let (jobs_in, jobs) = ring(JOB_POOL, &window_bell);
        let (mut spare_in, spare) = ring(JOB_POOL, &front_bell);
        let (feedback_in, feedback) = ring(JOB_POOL, &front_bell);
        let (mut blank_in, blank) = ring(JOB_POOL, &window_bell);
        let (corrections_in, corrections) = ring(ESTIMATE_RING, &tick_bell);
        let (estimates_in, estimates) = ring(ESTIMATE_RING, &sink_bell);
        let (odometry_in, odometry) = ring(ODOMETRY_RING, &sink_bell);
        for _ in 0..FRAME_POOL {
            let _ = empty_in.push(StereoFrame::new(sizes_of(&config)));
        }
        for _ in 0..JOB_POOL {
            let _ = spare_in.push(Job::new(&config));
            let _ = blank_in.push(Feedback::new(config.setup()));
        }
        let camera = CameraTask {
            source: stereo,
            empty,
            arrivals: arrivals_in,
            bell: camera_bell,
            kept: CameraFigures::default(),
        };
        let tick = TickTask::new(tick, readings, corrections, samples_in, odometry_in);
        let rings = FrontEndRings {
            arrivals,
            empty: empty_in,
            samples,
            spare,
            jobs: jobs_in,
            feedback,
            blank: blank_in,
            bell: front_bell,
        };
        let front = FrontEndTask::new(front, rings);
        let window = WindowTask {
            stage: window,
            jobs,
            spare: spare_in,
            blank,
            feedback: feedback_in,
            corrections: corrections_in,
            estimates: estimates_in,
            bell: window_bell,
        };
        sink_bell.listen();
        let mut collector = Collector { odometry, estimates, bell: sink_bell, figures: Figures::default() };
        collector.figures.start();
        let watchdog = WatchdogThread::default();
        std::thread::scope(|scope| {
            let watching = watchdog.start(scope, shared, tap)?;
            let window = shared.spawn(scope, TaskId::Window, move || window.run(shared))?;
            let front = shared.spawn(scope, TaskId::FrontEnd, || team.lead(|| front.run(shared, &team)))?;
            let camera = shared.spawn(scope, TaskId::Camera, move || camera.run(shared))?;
            let imu = shared.spawn(scope, TaskId::Imu, move || imu.run(shared, readings_in))?;
            let tick = shared.spawn(scope, TaskId::Tick, move || tick.run(shared))?;
            collector.run(sink);
            let ended = Ended {
                tick: joined(tick, "tick")?,
                front: joined(front, "front-end")?,
                window: joined(window, "window")?,
                camera: joined(camera, "camera")?,
                imu: joined(imu, "imu")?,
            };
            watchdog.end();
            let watched = watching.join().map_err(|_| RunError::Fault("watchdog"))?;
            Ok(ended.outcome(collector.figures, &team, watched))
        })
    }
}

/// The tasks after their end.
struct Ended {
    tick: (TickStage, TickTaskFigures),
    front: (FrontStage, FrontEndFigures),
    window: (WindowStage, usize),
    camera: (Faults, CameraFigures),
    imu: Faults,
}

impl Ended {
    fn outcome(
        self,
        mut figures: Figures,
        team: &Team,
        watched: watchdog_thread::WatchdogFigures,
    ) -> Outcome {
        figures.finish();
        figures.add_stages(&self.front.0, &self.window.0, &self.tick.0);
        figures.hot_path_allocations += team.allocations();
        figures.frames_refused += self.front.1.refused() + self.camera.1.overdue;
        Outcome {
            estimate_digest: self.window.0.digest(),
            odometry_digest: self.tick.0.digest(),
            faults: (self.imu, self.camera.0),
            live: Some(LiveFigures::new(&self, watched)),
            figures,
        }
    }
}

/// What a task left; a task that ended by a fault has been told already.
fn joined<T>(handle: ScopedJoinHandle<'_, Option<T>>, name: &'static str) -> Result<T, RunError> {
    handle.join().ok().flatten().ok_or(RunError::Fault(name))
}

/// The caller's thread while the tasks run: hands on what they produce.
struct Collector {
    odometry: Reader<Odometry>,
    estimates: Reader<(Estimate, Cost)>,
    bell: Bell,
    figures: Figures,
}

impl Collector {
    fn run(&mut self, sink: &mut dyn Sink) {
        let Self { odometry, estimates, bell, figures } = self;
        loop {
            while let Some(odometry) = odometry.pop() {
                sink.odometry(&odometry);
            }
            while let Some((estimate, cost)) = estimates.pop() {
                figures.frame(&estimate, cost);
                sink.estimate(&estimate, cost.wall_ms);
            }
            if odometry.is_closed() && estimates.is_closed() {
                return;
            }
            bell.wait(NAP, || (odometry.peek().is_some() || estimates.peek().is_some()).then_some(()));
        }
    }
}
