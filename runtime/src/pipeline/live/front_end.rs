//! The task that tracks, and that decides: which frame is taken, and how much work it gets.

use super::super::stages::{FrontStage, Job};
use super::super::team::Team;
use super::NAP;
use super::drivers::Arrival;
use super::places::PlacesRings;
use super::shared::Shared;
use crate::schedule::ladder::{Ladder, Rung};
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::Monotonic;
use crate::schedule::times::Times;
use plumbline_config::Timestamp;
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::Feedback;

/// How often [`NAP`] a frame waits for its samples: a tick or a line that is held up for a fifth of a second catches up.
const SAMPLE_NAPS: u32 = 6;

/// What the task counts and times.
pub struct FrontEndFigures {
    /// Frames refused because a newer one was there.
    pub shed: u64,
    /// Frames that the rung did not admit.
    pub passed_over: u64,
    /// Frames tracked before all their samples were there.
    pub short_of_samples: u64,
    /// Frames not given to the map, which had fallen behind.
    pub places_passed_over: u64,
    /// Frames on each rung.
    pub on_rung: [u64; Rung::ALL.len()],
    /// Steps of the ladder.
    pub steps_down: u64,
    pub steps_up: u64,
    /// From the arrival of a frame to its being tracked, ms.
    pub response_ms: Times,
    /// Most samples and frames that waited.
    pub deepest_samples: usize,
    pub deepest_frames: usize,
}

impl FrontEndFigures {
    /// Frames that the estimator never saw.
    pub fn refused(&self) -> u64 {
        self.shed + self.passed_over
    }
}

/// What the task leaves.
pub struct FrontEndEnd {
    pub stage: FrontStage,
    pub figures: FrontEndFigures,
}

/// What joins the front-end to the other tasks.
pub struct FrontEndRings {
    pub arrivals: Reader<Arrival>,
    /// Frames that are done with, to the camera.
    pub empty: Writer<StereoFrame>,
    pub samples: Reader<ImuReading>,
    /// Jobs that are done with, from the window.
    pub spare: Reader<Job>,
    pub jobs: Writer<Job>,
    pub feedback: Reader<Feedback>,
    /// Feedback that has been heard, to the window.
    pub blank: Writer<Feedback>,
    pub bell: Bell,
}

/// The front-end as a task.
pub struct FrontEndTask {
    stage: FrontStage,
    /// Where places are switched on.
    places: Option<PlacesRings>,
    rings: FrontEndRings,
    ladder: Ladder,
    newest_imu: Timestamp,
    is_imu_silent: bool,
    taken: u64,
    heard: u64,
    figures: FrontEndFigures,
}

impl FrontEndTask {
    pub fn new(stage: FrontStage, places: Option<PlacesRings>, rings: FrontEndRings) -> Self {
        Self {
            stage,
            places,
            rings,
            ladder: Ladder::default(),
            newest_imu: Timestamp::MIN,
            is_imu_silent: false,
            taken: 0,
            heard: 0,
            figures: FrontEndFigures {
                shed: 0,
                passed_over: 0,
                short_of_samples: 0,
                places_passed_over: 0,
                on_rung: [0; Rung::ALL.len()],
                steps_down: 0,
                steps_up: 0,
                response_ms: Times::of_ms(),
                deepest_samples: 0,
                deepest_frames: 0,
            },
        }
    }

    /// Tracks frames until the camera has ended.
    pub fn run(mut self, shared: &Shared<'_>, team: &Team) -> FrontEndEnd {
        self.rings.bell.listen();
        while self.await_feedback(shared) {
            let Some((mut arrival, shed)) = self.newest_frame() else { break };
            shared.heartbeats.busy(TaskId::FrontEnd);
            let rung = self.ladder.rung();
            self.figures.on_rung[usize::from(rung.level())] += 1;
            if rung.admits(arrival.frame.sequence) {
                self.take_samples(shared, arrival.frame.stamp);
                let Some(mut job) = self.rings.spare.pop() else { break };
                if let Some(kind) = shared.control.take_reset() {
                    self.stage.reset(kind, arrival.frame.sequence);
                }
                self.stage.track(&arrival.frame, rung, team, &mut job);
                let longest_ms = job.cost.wall_ms.max(shared.window_ms());
                self.figures.response_ms.record(Monotonic::now().ms_since(arrival.at));
                self.taken += 1;
                shared.heartbeats.give(TaskId::Window);
                if self.rings.jobs.push(job).is_err() {
                    break;
                }
                self.stage.release(&mut arrival.frame);
                self.judge(shared, longest_ms, shed);
            } else {
                self.figures.passed_over += 1;
                self.stage.refuse(&mut arrival.frame);
                self.judge(shared, 0.0, shed);
            }
            let _ = self.rings.empty.push(arrival.frame);
            shared.heartbeats.idle(TaskId::FrontEnd);
        }
        self.figures.deepest_samples = self.rings.samples.deepest();
        self.figures.deepest_frames = self.rings.arrivals.deepest();
        FrontEndEnd { stage: self.stage, figures: self.figures }
    }

    /// Takes what the window found out about the frame before the last, as the rule demands; waits for it.
    /// `false` when the window has gone.
    fn await_feedback(&mut self, shared: &Shared<'_>) -> bool {
        while self.heard + 1 < self.taken {
            let FrontEndRings { bell, feedback, .. } = &mut self.rings;
            match bell.wait(NAP, || feedback.pop()) {
                Some(feedback) => {
                    self.stage.apply_feedback(&feedback);
                    if let Some(places) = &mut self.places {
                        let is_offered = places.offer(shared, &feedback, &mut self.stage);
                        self.figures.places_passed_over += u64::from(!is_offered);
                    }
                    self.heard += 1;
                    let _ = self.rings.blank.push(feedback);
                }
                None if self.rings.feedback.is_closed() => return false,
                // It is the window that is late.
                None => shared.heartbeats.busy(TaskId::FrontEnd),
            }
        }
        true
    }

    /// Waits for a frame; of several the newest. Also, how many were refused for it.
    fn newest_frame(&mut self) -> Option<(Arrival, u64)> {
        let FrontEndRings { bell, arrivals, samples, .. } = &mut self.rings;
        let mut newest = loop {
            if let Some(arrival) = bell.wait(NAP, || arrivals.pop()) {
                break arrival;
            }
            if arrivals.is_closed() {
                return None;
            }
            keep_room(&mut self.stage, samples, &mut self.newest_imu);
        };
        let mut shed = 0;
        while let Some(newer) = self.rings.arrivals.pop() {
            let mut older = std::mem::replace(&mut newest, newer);
            self.stage.refuse(&mut older.frame);
            let _ = self.rings.empty.push(older.frame);
            shed += 1;
        }
        self.figures.shed += shed;
        Some((newest, shed))
    }

    /// Takes readings until one reaches the time that the frame needs; for one whose stamp is not believed, those there are.
    fn take_samples(&mut self, shared: &Shared<'_>, image_stamp: Timestamp) {
        if !self.stage.expects(image_stamp) {
            while let Some(reading) = self.rings.samples.pop() {
                self.add(&reading);
            }
            return;
        }
        let needed = self.stage.needed_until(image_stamp);
        while self.newest_imu < needed {
            let Some(reading) = self.next_reading(shared) else { return };
            self.add(&reading);
        }
        self.is_imu_silent = false;
    }

    fn add(&mut self, reading: &ImuReading) {
        if self.stage.add(reading) {
            self.newest_imu = reading.sample.stamp;
        }
    }

    /// The next reading. `None` when there are no more, or none came for long: one frame waits long for an IMU that
    /// has fallen silent, those after it do not.
    fn next_reading(&mut self, shared: &Shared<'_>) -> Option<ImuReading> {
        for _ in 0..if self.is_imu_silent { 1 } else { SAMPLE_NAPS } {
            let FrontEndRings { bell, samples, .. } = &mut self.rings;
            let reading = bell.wait(NAP, || {
                let reading = samples.pop();
                (reading.is_some() || samples.is_closed()).then_some(reading)
            });
            if let Some(reading) = reading {
                return reading;
            }
            // It is the tick that is late.
            shared.heartbeats.busy(TaskId::FrontEnd);
        }
        self.is_imu_silent = true;
        self.figures.short_of_samples += 1;
        None
    }

    /// Lets the ladder judge the frame.
    fn judge(&mut self, shared: &Shared<'_>, longest_ms: f64, shed: u64) {
        let period_ms = shared.table.row(TaskId::FrontEnd).period.as_secs_f64() * 1e3;
        let before = self.ladder.rung();
        if let Some(rung) = self.ladder.observe(longest_ms / period_ms, shed > 0) {
            *if rung > before { &mut self.figures.steps_down } else { &mut self.figures.steps_up } += 1;
            shared.set_rung(rung);
        }
    }
}

/// While no frame comes, the older half of the readings that wait is given to the estimator, which forgets what it has no
/// use for: a camera that comes after minutes finds the newest.
fn keep_room(stage: &mut FrontStage, samples: &mut Reader<ImuReading>, newest: &mut Timestamp) {
    let half = samples.capacity() / 2;
    while samples.waiting() > half
        && let Some(reading) = samples.pop()
    {
        if stage.add(&reading) {
            *newest = reading.sample.stamp;
        }
    }
}
