//! The tick: every inertial reading becomes odometry, corrected by estimates at a fixed delay.

use super::effect::Effect;
use super::figures::StageTimes;
use super::instants::{self, InstantDesk, Instants, Standing};
use super::listener::{Listener, ListenerView};
use crate::alloc;
use crate::pipeline::clock::Stopwatch;
use crate::schedule::times::Times;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::ImuReading;
use plumbline_estimator::{Estimate, Instant, Odometry, Propagator, Stage, StageProbe, TrackingState};
use plumbline_record::digest::Digest;
use plumbline_record::{CorrectionOrder, InstantAnswer, InstantOrder, InstantOutcome, Said};
use std::collections::VecDeque;
use std::sync::Arc;

/// An estimate takes effect on the odometry this long after its measurement, in data time: longer than the
/// slowest frame may take, shorter than a frame period.
pub const CORRECTION_DELAY_NS: i64 = 40_000_000;
/// Allocations count from this much data time on: by then every buffer has seen use.
pub const WARM_UP_NS: i64 = 2_000_000_000;
/// Estimates that wait to take effect: at most the frames within the delay, at any rate a camera may have.
const MAX_PENDING: usize = 16;

/// An estimate that has to wait for longer is of another time: the clock was set, ns. Frames are at most half a second ahead
/// of the readings, or they are refused.
const MAX_WAIT_NS: i64 = 1_000_000_000;

/// Without a reading for so long, the odometry of a live flight is blind, ns: longer than a line or a host holds readings up.
const BLIND_NS: i64 = 200_000_000;
/// Agility assumed of a vehicle while nothing is measured: angular rate, rad/s, and acceleration, m/s².
const UNSEEN_RATE: f64 = 2.0;
const UNSEEN_ACCELERATION: f64 = 10.0;

/// Counts and times of the tick.
#[derive(Clone, Debug, Default)]
pub struct TickFigures {
    /// From being given a reading to its odometry, microseconds.
    pub handout_us: Times,
    /// Times of the tick as a stage of the computation.
    pub times: StageTimes,
    /// Allocations and frees after the warm-up.
    pub allocations: u64,
    /// Estimates that took effect later than the delay says.
    pub late_corrections: u64,
}

/// The stage of the tick: owns the odometry.
pub struct TickStage {
    propagator: Propagator,
    effect: Effect,
    pending: VecDeque<Estimate>,
    readings: u64,
    first: Option<Timestamp>,
    newest: Timestamp,
    digest: Digest,
    listener: Box<dyn Listener>,
    /// The last odometry.
    last: Option<Odometry>,
    /// Answers requests for states at instants, if there may be any.
    desk: Option<InstantDesk>,
    /// States at instants so far.
    answers: u64,
    /// Counts and times so far.
    pub figures: TickFigures,
}

impl TickStage {
    /// Stage with everything allocated for the configuration. With `instants` it answers requests for states of the last seconds.
    pub fn new(
        config: &ValidConfig,
        effect: Effect,
        listener: Box<dyn Listener>,
        instants: Option<Arc<Instants>>,
    ) -> Self {
        Self {
            listener,
            effect,
            propagator: Propagator::new(config.setup()),
            desk: instants.map(InstantDesk::new),
            answers: 0,
            pending: VecDeque::with_capacity(MAX_PENDING),
            readings: 0,
            first: None,
            newest: Timestamp::MIN,
            digest: Digest::default(),
            last: None,
            figures: TickFigures::default(),
        }
    }

    /// Keeps an estimate until it is to take effect; that of a refused frame has none.
    pub fn correct_later(&mut self, estimate: Estimate) {
        if estimate.is_refused() {
            return;
        }
        if self.newest >= due(&estimate) {
            self.figures.late_corrections += 1;
        }
        if self.pending.len() == MAX_PENDING {
            self.pending.pop_front();
        }
        self.pending.push_back(estimate);
    }

    /// Takes a reading, and tells the listener of the odometry at its time, once there has been a pose.
    pub fn take(&mut self, reading: &ImuReading) {
        let sample = &reading.sample;
        let first = *self.first.get_or_insert(sample.stamp);
        let counting = (sample.stamp.nanos_since(first) > WARM_UP_NS).then(alloc::Count::begin);
        let watch = Stopwatch::start();
        self.figures.times.begin(Stage::Propagate);
        let is_believed = self.propagator.expects(sample);
        if is_believed {
            if self.effect == Effect::ByRule {
                self.correct(sample.stamp);
            }
            self.newest = sample.stamp;
        }
        let odometry = self.propagator.tick(sample);
        self.figures.times.end(Stage::Propagate);
        self.readings += 1;
        if let Some(odometry) = odometry {
            self.figures.handout_us.record(watch.elapsed_ms() * 1e3);
            self.digest.add(&odometry);
            self.last = Some(odometry.clone());
            self.listener.said(&Said::Odometry(odometry));
        }
        self.listener.said(&Said::Imu(*reading));
        self.figures.allocations += counting.map_or(0, alloc::Count::end);
    }

    /// Answers requests of states at instants, as far as their time has come.
    pub fn serve_instants(&mut self) {
        let mut answered = 0;
        while let Some(desk) = &mut self.desk {
            let propagator = &self.propagator;
            let standing = |stamp| Standing {
                is_reached: propagator.has_reached(stamp),
                is_settled: propagator.is_settled(stamp),
            };
            let Some(request) = desk.next(&mut answered, standing) else { return };
            self.answer(instants::order(request, self.readings));
        }
    }

    /// Answers what is left, at the end of the run.
    pub fn finish_instants(&mut self) {
        while let Some(request) = self.desk.as_mut().and_then(InstantDesk::rest) {
            self.answer(instants::order(request, self.readings));
        }
    }

    /// Entrance for the requests that [`Self::serve_instants`] answers; `None` if the run answers none.
    pub fn instants(&self) -> Option<&Arc<Instants>> {
        self.desk.as_ref().map(InstantDesk::door)
    }

    /// Answers a request.
    pub fn answer(&mut self, order: InstantOrder) {
        let InstantOrder { number, stamp, source, .. } = order;
        let (outcome, instant) = match self.propagator.at(stamp) {
            Ok(instant) => (InstantOutcome::Answered, instant),
            Err(refusal) => (instants::outcome(refusal), Instant { stamp, ..Instant::default() }),
        };
        let answer = InstantAnswer { sequence: self.answers, number, source, outcome, instant };
        self.answers += 1;
        self.listener.said(&Said::InstantOrder(order));
        self.listener.said(&Said::Instant(answer));
    }

    /// Shows the last odometry, blind, if no reading has come for so long, ns: its pose, of which less and less is known, with
    /// quality 0. No log holds it, and no digest.
    pub fn show_blind(&mut self, silence_ns: i64) {
        if let Some(last) = self.last.as_ref().filter(|_| silence_ns >= BLIND_NS) {
            let blind = blind(last, last.stamp.plus_nanos(silence_ns));
            self.listener.shown(ListenerView::Blind(&blind));
        }
    }

    /// True if a reading follows those before it. One that does not is refused, whenever it comes.
    pub fn expects(&self, reading: &ImuReading) -> bool {
        self.propagator.expects(&reading.sample)
    }

    /// Corrects by the estimates that are due at `stamp`. Those of a time that the clock does not have any more are dropped.
    fn correct(&mut self, stamp: Timestamp) {
        while let Some(estimate) = self.pending.front() {
            let wait_ns = due(estimate).nanos_since(stamp);
            if (1..=MAX_WAIT_NS).contains(&wait_ns) {
                return;
            }
            let Some(estimate) = self.pending.pop_front().filter(|_| wait_ns <= 0) else { continue };
            self.apply(&estimate);
        }
    }

    /// Corrects by the estimate of `frame`, if it waits; earlier ones have no effect any more.
    pub fn correct_by(&mut self, frame: u64) {
        while self.pending.pop_front_if(|estimate| estimate.frame_sequence < frame).is_some() {}
        if let Some(estimate) = self.pending.pop_front_if(|estimate| estimate.frame_sequence == frame) {
            self.apply(&estimate);
        }
    }

    fn apply(&mut self, estimate: &Estimate) {
        self.propagator.correct(estimate);
        let order = CorrectionOrder { frame: estimate.frame_sequence, readings_before: self.readings };
        self.listener.said(&Said::Correction(order));
    }

    /// The first frame from `frame` on whose estimate waits to take effect.
    pub fn waiting_from(&self, frame: u64) -> Option<u64> {
        self.pending.iter().map(|estimate| estimate.frame_sequence).find(|waiting| *waiting >= frame)
    }

    /// True if the estimates of two more frames, one of them in flight, find room among those that wait.
    pub fn has_room(&self) -> bool {
        self.pending.len() + 2 <= MAX_PENDING
    }

    /// SHA-256 over the bits of all odometry so far.
    pub fn digest(&self) -> String {
        self.digest.hex()
    }
}

/// The first reading at or after this time is propagated from the estimate.
pub fn due(estimate: &Estimate) -> Timestamp {
    estimate.stamp.plus_nanos(CORRECTION_DELAY_NS)
}

/// The last odometry as of `now`: where it was, with the covariance of what the vehicle may have done since.
fn blind(last: &Odometry, now: Timestamp) -> Odometry {
    let since_s = now.seconds_since(last.stamp);
    let velocity = UNSEEN_ACCELERATION * since_s;
    let speed = last.v_o_b.norm();
    let sigmas = [UNSEEN_RATE * since_s, (speed + velocity / 2.0) * since_s, velocity];
    let mut odometry = Odometry { stamp: now, state: TrackingState::Blind, quality: 0, ..last.clone() };
    for k in 0..odometry.covariance.nrows() {
        odometry.covariance[(k, k)] += sigmas[k / 3] * sigmas[k / 3];
    }
    odometry
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::fixture::odometry;

    #[test]
    fn odometry_of_a_silent_sensor_is_blind_and_uncertain() {
        let last = odometry();
        let blind = blind(&last, last.stamp.plus_nanos(1_000_000_000));
        assert_eq!((blind.state, blind.quality, blind.sequence), (TrackingState::Blind, 0, last.sequence));
        assert_eq!(blind.pose_o_b, last.pose_o_b);
        assert!((0..9).all(|k| blind.covariance[(k, k)] > last.covariance[(k, k)] + 1.0));
    }
}
