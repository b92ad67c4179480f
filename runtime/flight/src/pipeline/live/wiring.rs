//! The tasks of a live run and the rings that join them.
//!
//! A ring has one writer and one reader. Frames, jobs and feedback go round between two tasks: what is done with goes
//! back to be filled again, so that nothing is allocated in flight.

use super::super::places::{PlaceChoice, PlacesStage};
use super::super::stages::{FrontStage, Job, WindowStage};
use super::super::tick::TickStage;
use super::drivers::{CameraFigures, CameraTask, ImuTask};
use super::front_end::{FrontEndRings, FrontEndTask, JOB_POOL};
use super::places::{PlacesRings, PlacesTask};
use super::tick::{TickRings, TickTask};
use super::window::{WindowRings, WindowTask};
use crate::schedule::ring::{Bell, Reader, Writer, ring};
use plumbline_config::ValidConfig;
use plumbline_config::options::image_sizes;
use plumbline_drivers::{ImuReading, ImuSource, StereoFrame, StereoSource};
use plumbline_estimator::Feedback;
use plumbline_estimator::admission::StampGate;
use plumbline_estimator::places::{MapUpdate, PlaceJob};

/// Frames that are filled, wait or are tracked at a time.
const FRAME_POOL: usize = 4;
/// Readings that a replay driver is ahead of the clock, or a tick behind it, s of them, and never fewer than these.
const READING_RING_S: f64 = 0.3;
const READING_RING: usize = 64;
/// Readings that wait for the front-end, s of them.
const SAMPLE_RING_S: f64 = 60.0;
/// Estimates that wait to correct the odometry: three seconds at 20 Hz.
const CORRECTION_RING: usize = 64;

/// Frames on their way to the map: one that it works on, and one that waits.
const PLACE_POOL: usize = 2;
/// Length of the ring of map updates that the window has not taken yet.
const MAP_UPDATE_RING: usize = 16;

/// Sources of a run's data.
pub struct Sensors {
    pub imu: Box<dyn ImuSource>,
    /// The first reading, which has been taken from it.
    pub first: Option<ImuReading>,
    pub stereo: Box<dyn StereoSource>,
}

/// Stages of the computation.
pub struct Stages {
    pub front: FrontStage,
    pub window: WindowStage,
    pub tick: TickStage,
    /// Stage of places; `None` while these are switched off.
    pub places: Option<PlacesStage>,
}

/// Every task of a run, joined to the others and ready to start.
pub struct Tasks {
    pub imu: ImuTask,
    pub tick: TickTask,
    pub camera: CameraTask,
    pub front_end: FrontEndTask,
    pub window: WindowTask,
    pub places: Option<PlacesTask>,
}

/// The map's ends: that of the front-end, the task, and that of the window. Frames go from the front-end to the map, and back; updates
/// to the window.
fn join_places(
    config: &ValidConfig,
    stage: Option<PlacesStage>,
    [front_end, window]: [&Bell; 2],
) -> (Option<PlacesRings>, Option<PlacesTask>, Reader<MapUpdate>) {
    let bell = Bell::default();
    let buffers = if config.estimator.places.enabled { PLACE_POOL } else { 0 };
    let (jobs_writer, jobs) = ring(PLACE_POOL, &bell);
    let (spare, spare_reader) = filled(PLACE_POOL, front_end, buffers, || PlaceJob::new(config.setup()));
    let (updates, map_updates) = ring(MAP_UPDATE_RING, window);
    let rings = PlacesRings { jobs: jobs_writer, spare: spare_reader, choice: PlaceChoice::default() };
    let has_places = stage.is_some();
    let task = stage.map(|stage| PlacesTask { stage, jobs, spare, updates, bell });
    (has_places.then_some(rings), task, map_updates)
}

/// A ring with `count` entries in it.
fn filled<T>(capacity: usize, bell: &Bell, count: usize, make: impl Fn() -> T) -> (Writer<T>, Reader<T>) {
    let (mut writer, reader) = ring(capacity, bell);
    for _ in 0..count {
        let _ = writer.push(make());
    }
    (writer, reader)
}

impl Tasks {
    /// Joins the tasks of a run, with everything allocated for the configuration.
    pub fn new(config: &ValidConfig, sensors: Sensors, stages: Stages) -> Self {
        let [tick, camera, front_end, window] = std::array::from_fn(|_| Bell::default());
        let readings_in = |seconds: f64| (seconds * config.imu.rate_hz).ceil() as usize;
        let blank_frame = || StereoFrame::new(image_sizes(&config.camera));
        // From the inertial driver to the tick, and on to the front-end.
        let (readings_writer, readings) = ring(readings_in(READING_RING_S).max(READING_RING), &tick);
        let (samples_writer, samples) = ring(readings_in(SAMPLE_RING_S), &front_end);
        // From the camera to the front-end, and back when they are done with.
        let (arrivals_writer, arrivals) = ring(FRAME_POOL, &front_end);
        let (empty_writer, empty) = filled(FRAME_POOL, &camera, FRAME_POOL, blank_frame);
        // From the front-end to the window, and back.
        let (jobs_writer, jobs) = ring(JOB_POOL, &window);
        let (spare_writer, spare) = filled(JOB_POOL, &front_end, JOB_POOL, || Job::new(config));
        // From the window to the front-end, and back; and to the tick.
        let (feedback_writer, feedback) = ring(JOB_POOL, &front_end);
        let (blank_writer, blank) = filled(JOB_POOL, &window, JOB_POOL, || Feedback::new(config.setup()));
        let (corrections_writer, corrections) = ring(CORRECTION_RING, &tick);
        let (to_places, places, map_updates) = join_places(config, stages.places, [&front_end, &window]);
        let of_tick = TickRings { readings, corrections, samples: samples_writer, bell: tick };
        Self {
            imu: ImuTask { source: sensors.imu, first: sensors.first, readings: readings_writer },
            tick: TickTask::new(stages.tick, of_tick),
            camera: CameraTask {
                source: sensors.stereo,
                empty,
                arrivals: arrivals_writer,
                bell: camera,
                kept: CameraFigures::default(),
                stamps: StampGate::of_frames(),
            },
            front_end: FrontEndTask::new(
                stages.front,
                to_places,
                FrontEndRings {
                    arrivals,
                    empty: empty_writer,
                    samples,
                    spare,
                    jobs: jobs_writer,
                    feedback,
                    blank: blank_writer,
                    bell: front_end,
                },
            ),
            window: WindowTask::new(
                stages.window,
                WindowRings {
                    jobs,
                    spare: spare_writer,
                    blank,
                    feedback: feedback_writer,
                    corrections: corrections_writer,
                    map_updates,
                    bell: window,
                },
            ),
            places,
        }
    }
}
