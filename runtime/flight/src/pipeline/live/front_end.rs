//! The task that tracks, and that decides: which frame is taken, and how much work it gets.

use super::super::stages::{FrontStage, Job};
use super::super::team::Team;
use super::NAP;
use super::drivers::Arrival;
use super::places::PlacesRings;
use super::shared::RunState;
use crate::schedule::ladder::{Ladder, Rung};
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::{TaskId, WATCH_PERIOD};
use crate::schedule::ticker::Monotonic;
use crate::schedule::times::Times;
use plumbline_config::{Portable, Timestamp};
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::Feedback;
use serde::{Serialize, Serializer};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Frames between front-end and window: one being tracked, one waiting, one being solved.
pub const JOB_POOL: usize = 3;
/// Frames after one that waited for samples in vain, whose successors were not refused for being slow.
const GRACE_FRAMES: u32 = 20;
/// Number of [`NAP`]s for which a frame waits for its samples: a tick or a line that is held up for a fifth of a second catches
/// up.
const SAMPLE_NAPS: u32 = 6;

/// Counts and times of the task.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FrontEndFigures {
    /// Frames refused because a newer one was there.
    pub frames_shed: u64,
    /// Frames that the rung did not admit.
    pub frames_passed_over: u64,
    /// Frames tracked before all their samples were there.
    pub frames_short_of_samples: u64,
    /// Frames that were lost by a fault.
    pub frames_lost: u64,
    /// Fresh starts of the estimator after a fault.
    pub renewals: u64,
    /// Frames not given to the map, which had fallen behind.
    #[serde(skip)]
    pub places_passed_over: u64,
    /// Frames on each rung.
    #[serde(serialize_with = "by_name")]
    pub on_rung: [u64; Rung::ALL.len()],
    /// Steps of the ladder.
    pub steps_down: u64,
    pub steps_up: u64,
    /// From the arrival of a frame to its being tracked, ms.
    pub frame_response_ms: Times,
    /// Most samples and frames that waited.
    #[serde(skip)]
    pub deepest_samples: usize,
    #[serde(skip)]
    pub deepest_frames: usize,
}

/// Counts of the rungs of the ladder by their names.
fn by_name<S: Serializer>(on_rung: &[u64; Rung::ALL.len()], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(Rung::ALL.iter().map(|rung| rung.name()).zip(on_rung))
}

impl FrontEndFigures {
    /// Frames that were not estimated.
    pub fn refused(&self) -> u64 {
        self.frames_shed + self.frames_passed_over + self.frames_lost
    }
}

/// Result of the task.
pub struct FrontEndEnd {
    pub stage: FrontStage,
    pub figures: FrontEndFigures,
}

/// Rings between the front-end and the other tasks.
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
    /// Rings of places; `None` while these are switched off.
    places: Option<PlacesRings>,
    rings: FrontEndRings,
    ladder: Ladder,
    newest_imu: Timestamp,
    is_imu_silent: bool,
    /// Frames whose lateness is the sensor's.
    grace: u32,
    /// Frames that came while an earlier one waited for its samples. The work did not take too long: they are taken in turn.
    came_meanwhile: usize,
    taken: u64,
    heard: u64,
    /// In hand, where a fault does not lose them.
    arrival: Option<Arrival>,
    job: Option<Job>,
    /// Frames that the window was given and has not answered for.
    unheard: VecDeque<u64>,
    /// The newest frame that it was given, or that was lost.
    newest_taken: Option<u64>,
    /// The estimator is to be made anew.
    is_down: bool,
    /// The window does not know of it yet.
    is_renewal_due: bool,
    figures: FrontEndFigures,
}

/// Next step of the task.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    /// With the next frame.
    On,
    /// From a fresh estimator: the window has ended by a fault of its own.
    Anew,
    /// Not at all: a neighbour is over.
    Over,
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
            grace: 0,
            came_meanwhile: 0,
            taken: 0,
            heard: 0,
            arrival: None,
            job: None,
            unheard: VecDeque::with_capacity(JOB_POOL + 1),
            newest_taken: None,
            is_down: false,
            is_renewal_due: false,
            figures: FrontEndFigures::default(),
        }
    }

    /// Tracks frames until the camera has ended. After a fault of its own, or of the window, it goes on from a fresh
    /// estimator.
    pub fn run(mut self, shared: &RunState<'_>, team: &Team) -> FrontEndEnd {
        self.rings.bell.listen();
        loop {
            match catch_unwind(AssertUnwindSafe(|| self.work(shared, team))) {
                Ok(Step::Over) => break,
                Ok(Step::On | Step::Anew) => {}
                Err(_) => {
                    shared.heartbeats.of(TaskId::FrontEnd).die();
                    // One fault after the other must not starve anybody.
                    std::thread::sleep(WATCH_PERIOD);
                }
            }
            if shared.is_stopped() {
                break;
            }
            self.is_down = true;
        }
        self.figures.deepest_samples = self.rings.samples.deepest();
        self.figures.deepest_frames = self.rings.arrivals.deepest();
        FrontEndEnd { stage: self.stage, figures: self.figures }
    }

    fn work(&mut self, shared: &RunState<'_>, team: &Team) -> Step {
        if self.is_down && self.start_anew(shared) == Step::Over {
            return Step::Over;
        }
        loop {
            let course = self.work_on_frame(shared, team);
            if course != Step::On {
                return course;
            }
        }
    }

    fn work_on_frame(&mut self, shared: &RunState<'_>, team: &Team) -> Step {
        let course = self.await_feedback(shared);
        if course != Step::On {
            return course;
        }
        let Some((arrival, shed)) = self.newest_frame() else { return Step::Over };
        let arrival = self.arrival.insert(arrival);
        let (sequence, stamp) = (arrival.frame.sequence, arrival.frame.stamp);
        let rung = self.ladder.rung();
        self.figures.on_rung[usize::from(rung.level())] += 1;
        shared.heartbeats.busy(TaskId::FrontEnd);
        let mut longest_ms = 0.0;
        if rung.admits(sequence) {
            let waiting = self.rings.arrivals.waiting();
            self.take_samples(shared, stamp);
            self.came_meanwhile += self.rings.arrivals.waiting().saturating_sub(waiting);
            // The work begins here: what was waited for is no time of its own.
            shared.heartbeats.busy(TaskId::FrontEnd);
            let Some(ms) = self.track(shared, team, rung) else {
                return if shared.is_window_down() { Step::Anew } else { Step::Over };
            };
            longest_ms = ms;
        } else if let Some(arrival) = &mut self.arrival {
            self.figures.frames_passed_over += 1;
            self.stage.refuse(&mut arrival.frame);
        }
        self.judge(shared, longest_ms, shed);
        if let Some(arrival) = self.arrival.take() {
            let _ = self.rings.empty.push(arrival.frame);
        }
        shared.heartbeats.idle(TaskId::FrontEnd);
        Step::On
    }

    /// Tracks the frame in hand and gives it to the window; the longest of the stages, ms. `None` when the window has gone.
    fn track(&mut self, shared: &RunState<'_>, team: &Team, rung: Rung) -> Option<f64> {
        if self.job.is_none() {
            self.job = self.rings.spare.pop();
        }
        let Self { stage, arrival: Some(arrival), job: Some(job), .. } = self else { return None };
        if let Some(kind) = shared.control.take_reset() {
            stage.reset(kind, arrival.frame.sequence);
        }
        job.is_after_fault = std::mem::take(&mut self.is_renewal_due);
        stage.track(&arrival.frame, rung, team, job);
        let longest_ms = job.cost.wall_ms.at_least(shared.window_ms());
        self.figures.frame_response_ms.record(Monotonic::now().ms_since(arrival.at));
        shared.heartbeats.give(TaskId::Window);
        self.rings.jobs.push(self.job.take()?).ok()?;
        self.taken += 1;
        self.unheard.push_back(arrival.frame.sequence);
        self.newest_taken = Some(arrival.frame.sequence);
        stage.release(&mut arrival.frame);
        Some(longest_ms)
    }

    /// Makes the estimator anew once the window has given back everything, and says which frames are lost.
    fn start_anew(&mut self, shared: &RunState<'_>) -> Step {
        let at_home = |spare: &Reader<Job>, job: &Option<Job>| spare.waiting() + usize::from(job.is_some());
        while at_home(&self.rings.spare, &self.job) < JOB_POOL {
            if shared.is_stopped() || self.rings.spare.is_closed() {
                return Step::Over;
            }
            shared.heartbeats.busy(TaskId::FrontEnd);
            let FrontEndRings { bell, spare, .. } = &self.rings;
            let _ = bell.wait(NAP, || (at_home(spare, &self.job) == JOB_POOL).then_some(()));
        }
        while let Some(feedback) = self.rings.feedback.pop() {
            self.unheard.retain(|frame| *frame != feedback.solved.sequence);
            let _ = self.rings.blank.push(feedback);
        }
        if let Some(mut arrival) = self.arrival.take() {
            let frame = arrival.frame.sequence;
            if self.newest_taken < Some(frame) {
                self.unheard.push_back(frame);
                self.newest_taken = Some(frame);
                // A log without it would lack an input.
                self.stage.release(&mut arrival.frame);
            }
            let _ = self.rings.empty.push(arrival.frame);
        }
        self.figures.frames_lost += self.unheard.len() as u64;
        self.figures.renewals += 1;
        let before_frame = self.newest_taken.map_or(0, |frame| frame + 1);
        self.stage.renew(self.unheard.drain(..), before_frame);
        (self.taken, self.heard, self.came_meanwhile) = (0, 0, 0);
        shared.forget_window_down();
        (self.is_down, self.is_renewal_due) = (false, true);
        shared.heartbeats.idle(TaskId::FrontEnd);
        Step::On
    }

    /// Takes what the window found out about the frame before the last, as the rule demands; waits for it.
    fn await_feedback(&mut self, shared: &RunState<'_>) -> Step {
        loop {
            if shared.is_window_down() {
                return Step::Anew;
            }
            if self.heard + 1 >= self.taken {
                return Step::On;
            }
            let FrontEndRings { bell, feedback, .. } = &mut self.rings;
            match bell.wait(NAP, || feedback.pop()) {
                Some(feedback) => {
                    self.unheard.pop_front();
                    self.stage.apply_feedback(&feedback);
                    if let Some(places) = &mut self.places {
                        let is_offered = places.offer(shared, &feedback, &mut self.stage);
                        self.figures.places_passed_over += u64::from(!is_offered);
                    }
                    self.heard += 1;
                    let _ = self.rings.blank.push(feedback);
                }
                None if self.rings.feedback.is_closed() => return Step::Over,
                // It is the window that is late.
                None => shared.heartbeats.busy(TaskId::FrontEnd),
            }
        }
    }

    /// Waits for a frame; of several the newest, unless they only wait because samples came late. Also, how many were
    /// refused for it.
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
        if self.came_meanwhile > 0 {
            self.came_meanwhile -= 1;
            return Some((newest, 0));
        }
        let mut shed = 0;
        while let Some(newer) = self.rings.arrivals.pop() {
            let mut older = std::mem::replace(&mut newest, newer);
            self.stage.refuse(&mut older.frame);
            let _ = self.rings.empty.push(older.frame);
            shed += 1;
        }
        self.figures.frames_shed += shed;
        Some((newest, shed))
    }

    /// Takes readings until one reaches the time that the frame needs; for one whose stamp is not believed, those there are.
    fn take_samples(&mut self, shared: &RunState<'_>, image_stamp: Timestamp) {
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
    fn next_reading(&mut self, shared: &RunState<'_>) -> Option<ImuReading> {
        for _ in 0..if self.is_imu_silent { 1 } else { SAMPLE_NAPS } {
            let FrontEndRings { bell, samples, .. } = &mut self.rings;
            let reading = bell.wait(NAP, || {
                let reading = samples.pop();
                (reading.is_some() || samples.is_closed()).then_some(reading)
            });
            // It is the tick that is late, or the sensor: several waits in a row are no stall of this task.
            shared.heartbeats.busy(TaskId::FrontEnd);
            if let Some(reading) = reading {
                return reading;
            }
            self.grace = GRACE_FRAMES;
        }
        self.is_imu_silent = true;
        self.figures.frames_short_of_samples += 1;
        None
    }

    /// Lets the ladder judge the frame.
    fn judge(&mut self, shared: &RunState<'_>, longest_ms: f64, shed: u64) {
        let period_ms = shared.table.row(TaskId::FrontEnd).period.as_secs_f64() * 1e3;
        let before = self.ladder.rung();
        // Frames that a silent sensor held up say nothing of the time that they take.
        let is_behind = shed > 0 && self.grace == 0;
        self.grace = self.grace.saturating_sub(1);
        if let Some(rung) = self.ladder.observe(longest_ms / period_ms, is_behind) {
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
