//! The machine of a flight: the stages on one thread, driven by orders.
//!
//! Virtual time makes the orders by rule ([`super::virtual_time`]), a re-execution follows those of a log
//! ([`crate::log::execute`]). A live run has the same stages on threads of their own ([`super::live`]), and records the
//! orders that the clock gave.
//!
//! Frame `k + 1` is tracked while the window solves frame `k`, on two threads or in turn: the front-end never sees what the
//! other finds until both are done. What was found with a frame that is solved by itself waits for the next: the front-end
//! hears it when it has tracked one more, always.

use super::effect::Effect;
use super::instants::Instants;
use super::listener::{Producer, Subscriber};
use super::places::{PlaceChoice, PlacesStage};
use super::stages::{FrontStage, Job, WindowStage};
use super::team::Team;
use super::tick::TickStage;
use super::{PlacesEnd, stages};
use crate::pipeline::figures::Figures;
use crate::schedule::ladder::Rung;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::places::{PlaceJob, PlaceMap};
use plumbline_estimator::{Estimate, Feedback, Fork};
use plumbline_record::{InstantOrder, MapOrder, MapVerdict, ResetOrder};
use std::collections::VecDeque;
use std::sync::Arc;

/// Next action of a machine.
pub enum Order<'f> {
    /// Give the estimator a reading.
    Feed(ImuReading),
    /// Give the odometry a reading.
    Tick(ImuReading),
    /// Track a frame at this level of work, while the one before it is solved.
    Track(&'f mut StereoFrame, Rung),
    /// Solve the frame that was tracked last, without waiting for another.
    Solve,
    /// Start anew before a frame, on request or after a fault.
    Reset(ResetOrder),
    /// Correct the odometry by the estimate of this frame, which waits.
    Correct(u64),
    /// Use of a frame for the map.
    Map(MapOrder),
    /// Answer what was asked for.
    Instant(InstantOrder),
}

/// Source of orders.
pub trait Orders {
    /// Error that ends the orders.
    type Error;

    /// The order that `machine` is given next; `None` after the last.
    ///
    /// # Errors
    /// When there can be no more.
    fn next<'f>(&'f mut self, machine: &Machine<'_>) -> Result<Option<Order<'f>>, Self::Error>;
}

/// One estimator, its odometry and its map.
pub struct Machine<'a> {
    front: FrontStage,
    window: WindowStage,
    tick: TickStage,
    places: Option<Places>,
    team: &'a Team,
    /// The frame that the window has yet to solve, if `is_in_flight`.
    in_flight: Job,
    is_in_flight: bool,
    /// Room for the frame after it.
    next: Job,
    /// Feedback of the frame that was solved last, if `is_feedback_due`: the front-end has yet to receive it.
    feedback: Feedback,
    is_feedback_due: bool,
    newest_imu: Timestamp,
}

/// The map, with room for a frame on its way there.
struct Places {
    stage: PlacesStage,
    choice: PlaceChoice,
    job: PlaceJob,
    /// Frames that the map is not to be given, by order.
    passed_over: VecDeque<u64>,
}

impl<'a> Machine<'a> {
    /// Machine with everything allocated for the configuration. The map goes on with the keyframes of `known`; with `instants` the last
    /// seconds are kept.
    pub fn new(
        config: &ValidConfig,
        (known, instants): (Option<PlaceMap>, Option<Arc<Instants>>),
        effect: Effect,
        team: &'a Team,
        subscriber: &mut dyn Subscriber,
    ) -> Self {
        let stage = PlacesStage::new(config, known, subscriber.listener(Producer::Places));
        Self {
            places: stage.map(|stage| Places {
                stage,
                choice: PlaceChoice::default(),
                job: PlaceJob::new(config.setup()),
                passed_over: VecDeque::new(),
            }),
            front: FrontStage::new(config, subscriber),
            window: WindowStage::new(config, effect, subscriber.listener(Producer::Window)),
            tick: TickStage::new(config, effect, subscriber.listener(Producer::Tick), instants),
            team,
            in_flight: Job::new(config),
            is_in_flight: false,
            next: Job::new(config),
            feedback: Feedback::new(config.setup()),
            is_feedback_due: false,
            newest_imu: Timestamp::MIN,
        }
    }

    /// Follows all orders, and counts resets from `first_reset_counter` on.
    ///
    /// # Errors
    /// When there can be no more orders.
    pub fn run<O: Orders>(&mut self, orders: &mut O, first_reset_counter: u32) -> Result<(), O::Error> {
        self.window.count_resets_from(first_reset_counter);
        self.window.figures.start();
        while let Some(order) = orders.next(self)? {
            self.follow(order);
        }
        Ok(())
    }

    fn follow(&mut self, order: Order<'_>) {
        match order {
            Order::Feed(reading) => {
                if self.front.add(&reading) {
                    self.newest_imu = reading.sample.stamp;
                }
            }
            Order::Tick(reading) => {
                self.tick.take(&reading);
                self.tick.serve_instants();
            }
            Order::Instant(order) => self.tick.answer(order),
            Order::Track(frame, rung) => {
                self.work(Some((frame, rung)));
                self.front.release(frame);
            }
            Order::Solve => self.work(None),
            Order::Reset(ResetOrder { is_renewal: true, before_frame, .. }) => self.renew(before_frame),
            Order::Reset(ResetOrder { kind, before_frame, .. }) => self.front.reset(kind, before_frame),
            Order::Correct(frame) => self.tick.correct_by(frame),
            Order::Map(order) => self.note(&order),
        }
    }

    /// Tracks a frame while the window solves the one before it.
    fn work(&mut self, frame: Option<(&StereoFrame, Rung)>) {
        let Self { front, window, feedback, in_flight, is_in_flight, next, team, .. } = self;
        let mut solved: Option<Estimate> = None;
        team.join(
            &mut || {
                if let Some((frame, rung)) = frame {
                    front.track(frame, rung, *team, next);
                }
            },
            &mut || solved = is_in_flight.then(|| window.solve(in_flight, feedback).0),
        );
        if let Some(estimate) = solved {
            self.tick.correct_later(estimate);
            (self.is_in_flight, self.is_feedback_due) = (false, true);
        }
        if frame.is_some() {
            self.hear();
            std::mem::swap(&mut self.in_flight, &mut self.next);
            self.is_in_flight = true;
        }
    }

    /// The front-end hears what the window found with the frame before the one it has just tracked, and that frame is
    /// given to the map.
    fn hear(&mut self) {
        if !std::mem::take(&mut self.is_feedback_due) {
            return;
        }
        let Self { front, window, feedback, places, .. } = self;
        front.apply_feedback(feedback);
        let Some(places) = places else { return };
        if places.choice.takes(feedback) && !places.is_passed_over(feedback.solved.sequence) {
            front.fill_place_job(&mut places.job, feedback);
            window.update_map_later(places.stage.work(&places.job));
        }
    }

    /// Goes on with a fresh front-end and a fresh window, as a flight did after a fault of one of them.
    fn renew(&mut self, before_frame: u64) {
        self.work(None);
        self.is_feedback_due = false;
        self.front.renew(std::iter::empty(), before_frame);
        self.window.renew();
        // What front-end and window had in hand when they died may have reached the map or not, and no order says so.
        self.window.end_map();
        self.places = None;
    }

    fn note(&mut self, order: &MapOrder) {
        match (order.verdict, &mut self.places) {
            (MapVerdict::PassedOver, Some(places)) => places.passed_over.push_back(order.frame),
            (MapVerdict::Applied { at_frame }, Some(_)) => self.window.apply_to_map(order.frame, at_frame),
            (_, None) => {}
        }
    }

    /// The front-end.
    pub fn front(&self) -> &FrontStage {
        &self.front
    }

    /// The window.
    pub fn window(&self) -> &WindowStage {
        &self.window
    }

    /// The odometry.
    pub fn tick(&self) -> &TickStage {
        &self.tick
    }

    /// The newest time that is believed of the readings fed so far.
    pub fn newest_imu(&self) -> Timestamp {
        self.newest_imu
    }

    /// The time of the frame that was tracked and is not solved yet.
    pub fn unsolved(&self) -> Option<Timestamp> {
        self.is_in_flight.then_some(self.in_flight.tracked.time.stamp)
    }

    /// Answers what is left.
    pub fn finish_instants(&mut self) {
        self.tick.finish_instants();
    }

    /// Counts and times of the whole run, and the map.
    #[must_use]
    pub fn into_end(self) -> (Figures, Option<PlacesEnd>) {
        let figures = stages::total(&self.front, &self.window, &self.tick, self.team);
        let places = self.places.map(|places| PlacesEnd::new(places.stage, &self.window, 0));
        (figures, places)
    }
}

impl Places {
    fn is_passed_over(&mut self, frame: u64) -> bool {
        self.passed_over.pop_front_if(|passed| *passed == frame).is_some()
    }
}
