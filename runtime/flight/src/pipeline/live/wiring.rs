//! The tasks of a live run and the rings that join them.
//!
//! A ring has one writer and one reader. Frames, jobs and feedback go round between two tasks: what is done with goes
//! back to be filled again, so that nothing is allocated in flight.

use super::super::places::{PlaceChoice, PlacesStage};
use super::super::stages::{FrontStage, Job, WindowStage};
use super::super::tick::TickStage;
use super::drivers::{Arrival, CameraFigures, CameraTask, ImuTask};
use super::front_end::{FrontEndRings, FrontEndTask, JOB_POOL};
use super::places::{PlacesRings, PlacesTask};
use super::tick::{TickRings, TickTask};
use super::window::{WindowRings, WindowTask};
use crate::schedule::ring::{Bell, Reader, Writer, ring};
use plumbline_config::ValidConfig;
use plumbline_config::options::image_sizes;
use plumbline_drivers::{ImuReading, ImuSource, StereoFrame, StereoSource};
use plumbline_estimator::admission::StampGate;
use plumbline_estimator::places::{MapUpdate, PlaceJob};
use plumbline_estimator::{Estimate, Feedback};

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

/// Bells on which the threads sleep.
#[derive(Default)]
struct Bells {
    tick: Bell,
    camera: Bell,
    front_end: Bell,
    window: Bell,
    places: Bell,
}

/// Both ends of a ring.
struct Ring<T> {
    writer: Writer<T>,
    reader: Reader<T>,
}

impl<T> Ring<T> {
    fn new(capacity: usize, reader_sleeps_on: &Bell) -> Self {
        let (writer, reader) = ring(capacity, reader_sleeps_on);
        Self { writer, reader }
    }

    /// Puts `count` entries in.
    fn filled(mut self, count: usize, make: impl Fn() -> T) -> Self {
        for _ in 0..count {
            let _ = self.writer.push(make());
        }
        self
    }
}

/// All rings, each after what it carries.
struct Rings {
    /// From the inertial driver to the tick.
    readings: Ring<ImuReading>,
    /// From the tick to the front-end.
    samples: Ring<ImuReading>,
    /// From the camera to the front-end, and back when they are done with.
    arrivals: Ring<Arrival>,
    empty: Ring<StereoFrame>,
    /// From the front-end to the window, and back.
    jobs: Ring<Job>,
    spare: Ring<Job>,
    /// From the window to the front-end, and back.
    feedback: Ring<Feedback>,
    blank: Ring<Feedback>,
    /// From the window to the tick.
    corrections: Ring<Estimate>,
    /// From the front-end to the map, and back.
    place_jobs: Ring<PlaceJob>,
    place_spare: Ring<PlaceJob>,
    /// From the map to the window.
    map_updates: Ring<MapUpdate>,
}

impl Rings {
    /// Rings with everything allocated for the configuration.
    fn new(config: &ValidConfig, bells: &Bells) -> Self {
        let readings_in = |seconds: f64| (seconds * config.imu.rate_hz).ceil() as usize;
        let place_jobs = if config.estimator.places.enabled { PLACE_POOL } else { 0 };
        Self {
            readings: Ring::new(readings_in(READING_RING_S).max(READING_RING), &bells.tick),
            samples: Ring::new(readings_in(SAMPLE_RING_S), &bells.front_end),
            arrivals: Ring::new(FRAME_POOL, &bells.front_end),
            empty: Ring::new(FRAME_POOL, &bells.camera)
                .filled(FRAME_POOL, || StereoFrame::new(image_sizes(&config.camera))),
            jobs: Ring::new(JOB_POOL, &bells.window),
            spare: Ring::new(JOB_POOL, &bells.front_end).filled(JOB_POOL, || Job::new(config)),
            feedback: Ring::new(JOB_POOL, &bells.front_end),
            blank: Ring::new(JOB_POOL, &bells.window).filled(JOB_POOL, || Feedback::new(config.setup())),
            corrections: Ring::new(CORRECTION_RING, &bells.tick),
            place_jobs: Ring::new(PLACE_POOL, &bells.places),
            place_spare: Ring::new(PLACE_POOL, &bells.front_end)
                .filled(place_jobs, || PlaceJob::new(config.setup())),
            map_updates: Ring::new(MAP_UPDATE_RING, &bells.window),
        }
    }
}

impl Tasks {
    /// Joins the tasks of a run.
    pub fn new(config: &ValidConfig, sensors: Sensors, stages: Stages) -> Self {
        let bells = Bells::default();
        let rings = Rings::new(config, &bells);
        let Sensors { imu, first, stereo } = sensors;
        Self {
            imu: ImuTask { source: imu, first, readings: rings.readings.writer },
            tick: TickTask::new(
                stages.tick,
                TickRings {
                    readings: rings.readings.reader,
                    corrections: rings.corrections.reader,
                    samples: rings.samples.writer,
                    bell: bells.tick,
                },
            ),
            camera: camera(stereo, rings.empty.reader, rings.arrivals.writer, bells.camera),
            front_end: FrontEndTask::new(
                stages.front,
                stages.places.is_some().then_some(PlacesRings {
                    jobs: rings.place_jobs.writer,
                    spare: rings.place_spare.reader,
                    choice: PlaceChoice::default(),
                }),
                FrontEndRings {
                    arrivals: rings.arrivals.reader,
                    empty: rings.empty.writer,
                    samples: rings.samples.reader,
                    spare: rings.spare.reader,
                    jobs: rings.jobs.writer,
                    feedback: rings.feedback.reader,
                    blank: rings.blank.writer,
                    bell: bells.front_end,
                },
            ),
            window: WindowTask::new(
                stages.window,
                WindowRings {
                    jobs: rings.jobs.reader,
                    spare: rings.spare.writer,
                    blank: rings.blank.reader,
                    feedback: rings.feedback.writer,
                    corrections: rings.corrections.writer,
                    map_updates: rings.map_updates.reader,
                    bell: bells.window,
                },
            ),
            places: stages.places.map(|stage| PlacesTask {
                stage,
                jobs: rings.place_jobs.reader,
                spare: rings.place_spare.writer,
                updates: rings.map_updates.writer,
                bell: bells.places,
            }),
        }
    }
}

fn camera(
    source: Box<dyn StereoSource>,
    empty: Reader<StereoFrame>,
    arrivals: Writer<Arrival>,
    bell: Bell,
) -> CameraTask {
    let (kept, stamps) = (CameraFigures::default(), StampGate::of_frames());
    CameraTask { source, empty, arrivals, bell, kept, stamps }
}
