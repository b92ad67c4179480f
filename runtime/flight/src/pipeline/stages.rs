//! The two stages of a frame, with what they count and time. They are the same in every executor.

use super::clock::{CpuStopwatch, Stopwatch};
use super::effect::Effect;
use super::figures::{Cost, Figures, StageTimes};
use super::listener::{FrameKeeper, Listener, ListenerView, Producer, Solved, Subscriber};
use super::places::MapStage;
use super::team::Team;
use super::tick::{TickStage, WARM_UP_NS};
use crate::alloc;
use crate::schedule::ladder::Rung;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::odometry::Missing;
use plumbline_estimator::places::{MapUpdate, PlaceJob};
use plumbline_estimator::{Estimate, Feedback, Fork, FrameInput, FrontEnd, Odometer, ResetKind, Tracked};
use plumbline_record::digest::Digest;
use plumbline_record::said::FullEstimate;
use plumbline_record::{Event, FrameOrder, MapOrder, MapVerdict, ResetOrder, Said, Severity, Verdict};

/// A tracked frame on its way to the window.
#[derive(Clone, Debug)]
pub struct Job {
    /// Output of the front-end.
    pub tracked: Tracked,
    /// Cost of the front-end.
    pub cost: Cost,
    /// True if the window must be rebuilt before it: front-end or window ended by a fault of its own.
    pub is_after_fault: bool,
}

impl Job {
    /// An empty one, with room for any frame.
    pub fn new(config: &ValidConfig) -> Self {
        Self { tracked: Tracked::new(config.setup()), cost: Cost::default(), is_after_fault: false }
    }
}

/// Measures one piece of work on the calling thread.
fn measured<T>(count_allocations: bool, work: impl FnOnce() -> T) -> (T, Cost, u64) {
    let counting = count_allocations.then(alloc::Count::begin);
    let (watch, cpu) = (Stopwatch::start(), CpuStopwatch::start());
    let result = work();
    let cost = Cost { wall_ms: watch.elapsed_ms(), cpu_ms: cpu.elapsed_ms() };
    (result, cost, counting.map_or(0, alloc::Count::end))
}

/// The front-end with its figures.
pub struct FrontStage {
    config: ValidConfig,
    listener: Box<dyn Listener>,
    keeper: Option<Box<dyn FrameKeeper>>,
    front_end: FrontEnd,
    point_times: StageTimes,
    line_times: StageTimes,
    first: Option<Timestamp>,
    /// Inertial readings given so far.
    pub readings: u64,
    /// Inertial readings refused by the estimator.
    pub imu_refused: u64,
    /// Allocations and frees after the warm-up.
    pub allocations: u64,
}

impl FrontStage {
    /// Stage with everything allocated for the configuration.
    pub fn new(config: &ValidConfig, subscriber: &mut dyn Subscriber) -> Self {
        Self {
            config: config.clone(),
            listener: subscriber.listener(Producer::FrontEnd),
            keeper: subscriber.frame_keeper(),
            front_end: FrontEnd::new(config.setup()),
            point_times: StageTimes::default(),
            line_times: StageTimes::default(),
            first: None,
            readings: 0,
            imu_refused: 0,
            allocations: 0,
        }
    }

    /// Takes an inertial reading; whether it counts, and its stamp with it.
    pub fn add(&mut self, reading: &ImuReading) -> bool {
        self.readings += 1;
        let is_accepted = self.front_end.add_imu(&reading.sample).is_accepted();
        self.imu_refused += u64::from(!is_accepted);
        is_accepted
    }

    /// True if a frame of `image_stamp` is worth waiting for its readings.
    pub fn expects(&self, image_stamp: Timestamp) -> bool {
        self.front_end.expects(image_stamp)
    }

    /// Readings up to this time must have been added before the frame of `image_stamp` is.
    pub fn needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        self.front_end.imu_needed_until(image_stamp)
    }

    /// Tracks a frame with the work of a rung of the ladder.
    pub fn track(&mut self, frame: &StereoFrame, rung: Rung, fork: &dyn Fork, job: &mut Job) {
        let images = [frame.image(0), frame.image(1)];
        let input = FrameInput::new(frame.stamp, images).numbered(frame.sequence);
        let first = *self.first.get_or_insert(frame.stamp);
        let order = self.order(frame, Verdict::Taken { level: rung.level() });
        let Self { listener, front_end, point_times, line_times, .. } = self;
        let ((), cost, allocations) = measured(frame.stamp.nanos_since(first) > WARM_UP_NS, || {
            listener.said(&Said::Order(order));
            front_end.track(&input, &rung.budget(), fork, [point_times, line_times], &mut job.tracked);
            listener.shown(ListenerView::Tracked(&job.tracked));
        });
        job.cost = cost;
        self.allocations += allocations;
    }

    /// Starts anew before the frame of that sequence number.
    pub fn reset(&mut self, kind: ResetKind, before_frame: u64) {
        self.listener.said(&Said::Reset(ResetOrder { kind, before_frame, is_renewal: false }));
        self.front_end.reset(kind);
    }

    /// Goes on with a fresh front-end, after a fault of this one or of the window. Of `lost` frames, in order, there will be
    /// no estimate; `before_frame` is the first that there may be one of.
    pub fn renew(&mut self, lost: impl Iterator<Item = u64>, before_frame: u64) {
        for frame in lost {
            let order = FrameOrder { frame, readings_before: self.readings, verdict: Verdict::Lost };
            self.listener.said(&Said::Order(order));
        }
        let order = ResetOrder { kind: ResetKind::Soft, before_frame, is_renewal: true };
        self.listener.said(&Said::Reset(order));
        self.front_end = FrontEnd::new(self.config.setup());
    }

    /// Passes a frame over.
    pub fn refuse(&mut self, frame: &mut StereoFrame) {
        let order = self.order(frame, Verdict::Refused);
        self.listener.said(&Said::Order(order));
        self.release(frame);
    }

    /// A tracked frame is done with; other buffers may be left in its place.
    pub fn release(&mut self, frame: &mut StereoFrame) {
        self.listener.shown(ListenerView::Frame(frame));
        if let Some(keeper) = &mut self.keeper {
            keeper.keep(frame);
        }
    }

    fn order(&self, frame: &StereoFrame, verdict: Verdict) -> FrameOrder {
        FrameOrder { frame: frame.sequence, readings_before: self.readings, verdict }
    }

    /// Takes what the window found out.
    pub fn apply_feedback(&mut self, feedback: &Feedback) {
        self.front_end.apply_feedback(feedback);
    }

    /// Makes `job` of the frame that `feedback` is about, once that has been heard: its images are given away, for those
    /// of the job.
    pub fn fill_place_job(&mut self, job: &mut PlaceJob, feedback: &Feedback) {
        job.describe(feedback);
        self.front_end.exchange_images(feedback.solved.sequence, &mut job.images);
    }

    /// A frame is not given to the map, which is not done with the one before.
    pub fn pass_over_place(&mut self, sequence: u64) {
        self.listener.said(&Said::MapOrder(MapOrder { frame: sequence, verdict: MapVerdict::PassedOver }));
    }

    /// The time of each stage so far.
    pub fn times(&self) -> [&StageTimes; 2] {
        [&self.point_times, &self.line_times]
    }
}

/// The window with its figures.
pub struct WindowStage {
    config: ValidConfig,
    /// The newest estimate, and the newest that has a pose.
    newest: Option<Estimate>,
    newest_pose: Option<Estimate>,
    listener: Box<dyn Listener>,
    odometer: Odometer,
    digest: Digest,
    first: Option<Timestamp>,
    resets: u32,
    /// When it was last said what a start lacks.
    said_missing: Option<Timestamp>,
    map: Option<MapStage>,
    /// Counts and times of frames so far.
    pub figures: Figures,
    /// The time of each stage.
    pub times: StageTimes,
    /// Allocations and frees after the warm-up.
    pub allocations: u64,
}

impl WindowStage {
    /// Stage with everything allocated for the configuration.
    pub fn new(config: &ValidConfig, effect: Effect, listener: Box<dyn Listener>) -> Self {
        let mut odometer = Odometer::new(config.setup());
        odometer.keep_steps(listener.keeps_steps());
        Self {
            config: config.clone(),
            newest: None,
            newest_pose: None,
            listener,
            odometer,
            digest: Digest::default(),
            first: None,
            figures: Figures::default(),
            times: StageTimes::default(),
            allocations: 0,
            resets: 0,
            said_missing: None,
            map: config.estimator.places.enabled.then(|| MapStage::new(effect)),
        }
    }

    /// Keeps what the map found until it is to take effect.
    pub fn update_map_later(&mut self, update: MapUpdate) {
        if let Some(map) = &mut self.map {
            map.update_later(update);
        }
    }

    /// Orders the results of `frame` to take effect with the estimate of `at_frame`.
    pub fn apply_to_map(&mut self, frame: u64, at_frame: u64) {
        if let Some(map) = &mut self.map {
            map.apply_by(frame, at_frame);
        }
    }

    /// Ends the map before the flight.
    pub fn end_map(&mut self) {
        if let Some(map) = &mut self.map {
            map.end();
        }
    }

    /// The pose of the odometry in the map, with its figures; `None` where places are switched off.
    pub fn map(&self) -> Option<&MapStage> {
        self.map.as_ref()
    }

    /// Counts resets from here on. Before the first frame.
    pub fn count_resets_from(&mut self, first: u32) {
        self.odometer.count_resets_from(first);
        (self.resets, self.figures.first_reset_counter) = (first, first);
    }

    /// Goes on with a fresh window from the newest pose, after a fault of this one or of the front-end: a reset.
    pub fn renew(&mut self) {
        self.odometer.renew(self.config.setup(), self.newest.as_ref(), self.newest_pose.as_ref());
    }

    /// The estimate after a tracked frame, and what the window took for it; `feedback` is for the front-end.
    pub fn solve(&mut self, job: &Job, feedback: &mut Feedback) -> (Estimate, Cost) {
        let stamp = job.tracked.time.stamp;
        let is_warm = stamp.nanos_since(*self.first.get_or_insert(stamp)) > WARM_UP_NS;
        let Self { listener, odometer, times, .. } = self;
        let (estimate, cost, allocations) = measured(is_warm, || {
            let estimate = odometer.process(&job.tracked, times, feedback);
            listener.shown(ListenerView::Solved(&Solved {
                estimate: &estimate,
                step: odometer.step_covariance(),
                window: odometer.window(),
            }));
            estimate
        });
        let counting = is_warm.then(alloc::Count::begin);
        self.newest = Some(estimate.clone());
        if estimate.has_pose() {
            self.newest_pose.clone_from(&self.newest);
        }
        self.report_reset(&estimate);
        self.report_start(&estimate);
        self.hand_out(&estimate, cost.plus(job.cost));
        self.allocations += allocations + counting.map_or(0, alloc::Count::end);
        (estimate, cost)
    }

    /// Tells why the estimate was started anew, if it was.
    fn report_reset(&mut self, estimate: &Estimate) {
        if std::mem::replace(&mut self.resets, estimate.reset_counter) == estimate.reset_counter {
            return;
        }
        let Some(reason) = self.odometer.reset_reason() else { return };
        let severity = if reason.is_asked_for() { Severity::Warning } else { Severity::Error };
        let (frame, count) = (estimate.frame_sequence, estimate.reset_counter);
        let text = format_args!("frame {frame}: reset {count}: {reason}");
        let event = Event { cure: reason.cure(), ..Event::new(estimate.stamp, severity, text) };
        self.listener.said(&Said::Event(event));
    }

    /// Reports every second what a start with one camera still lacks, and at once which delay it has found.
    fn report_start(&mut self, estimate: &Estimate) {
        let Some(missing) = self.odometer.missing().copied() else { return };
        let is_due = self.said_missing.is_none_or(|last| estimate.stamp.seconds_since(last).abs() >= 1.0);
        let is_found = matches!(missing, Missing::Delay(..));
        if is_due || is_found {
            self.said_missing = Some(estimate.stamp);
            let why = if is_found { "" } else { "no start yet: " };
            let health = &mut self.figures.health;
            *(if is_found { &mut health.found } else { &mut health.missing }) = Some(missing);
            let text = format_args!("frame {}: {why}{missing}", estimate.frame_sequence);
            self.listener.said(&Said::Event(Event::new(estimate.stamp, Severity::Info, text)));
        }
    }

    fn hand_out(&mut self, estimate: &Estimate, cost: Cost) {
        self.digest.add(estimate);
        self.figures.frame(estimate, cost);
        if let Some(map) = &mut self.map {
            map.follow(estimate, &mut *self.listener);
        }
        let full = FullEstimate { estimate: estimate.clone(), frame_ms: cost.wall_ms };
        self.listener.said(&Said::Estimate(full));
    }

    /// SHA-256 over the bits of all estimates so far.
    pub fn digest(&self) -> String {
        self.digest.hex()
    }
}

/// Counts and times of all stages of a run, after their end.
pub fn total(front: &FrontStage, window: &WindowStage, tick: &TickStage, team: &Team) -> Figures {
    let mut figures = window.figures.clone();
    figures.finish();
    for times in front.times().into_iter().chain([&window.times, &tick.figures.times]) {
        figures.stages.add(times);
    }
    figures.handout_us = tick.figures.handout_us.clone();
    figures.imu_refused = front.imu_refused;
    figures.hot_path_allocations =
        front.allocations + window.allocations + tick.figures.allocations + team.allocations();
    figures
}
