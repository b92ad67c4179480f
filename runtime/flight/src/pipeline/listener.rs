//! Listening to a run: every input, order and output, on the thread that produces it.
//!
//! A run has five threads that produce ([`Producer`]). Who wants to listen is a [`Subscriber`]: before the run it
//! gives a [`Listener`] for each of them, which moves to that thread. What a listener is told is told there and
//! then, at that thread's priority: so it must not block in a live run, nor allocate, format or print. It copies what
//! it needs into memory that stands since before the run, and somebody else does the rest.
//!
//! The order of the calls carries meaning where one thread makes them: the order of a frame comes after the readings
//! it counts and any reset before it, a correction before the reading that it precedes. Between threads nothing
//! follows from it: each call makes sense by its own numbers.

use crate::schedule::watchdog::Pulse;
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::odometry::StepCovariance;
use plumbline_estimator::places::{MapEstimate, MapUpdate, Mapper};
use plumbline_estimator::window::Window;
use plumbline_estimator::{Estimate, MapSnapshot, Odometry, Tracked};
use plumbline_record::event::Event;
use plumbline_record::orders::{CorrectionOrder, FrameOrder, MapOrder, ResetOrder};
use std::sync::Arc;

/// A thread of a run that produces something. In virtual time one thread may be several of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Producer {
    /// Tells of readings, corrections and odometry.
    Tick,
    /// Tells of frames, orders, resets, what was tracked, and events.
    FrontEnd,
    /// Tells of what was solved, estimates, and where the odometry lies in the map.
    Window,
    /// Tells of the map. Not where places are switched off.
    Places,
    /// Tells of events. Not in virtual time.
    Watchdog,
}

/// Subscriber to a run.
pub trait Subscriber {
    /// The listener that moves to the thread of `producer`. A run asks once for each.
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener>;

    /// Hands over the heartbeats of its own threads, for the watchdog of a live run to look after.
    fn pulses(&self, _adopt: &mut dyn FnMut(Arc<Pulse>)) {}
}

/// Takes what one thread of a run produces. What a listener does not ask for passes by.
pub trait Listener: Send {
    /// Whether [`Solved::step`] is wanted, which costs the window a few percent of a frame. Asked once, before the run.
    fn keeps_steps(&self) -> bool {
        false
    }
    /// An inertial sample, as the odometry is given it.
    fn reading(&mut self, _reading: &ImuReading) {}
    /// A frame that is done with, taken or refused. The listener may keep its buffers and leave others of the
    /// same sizes.
    fn frame(&mut self, _frame: &mut StereoFrame) {}
    /// What became of a frame.
    fn order(&mut self, _order: &FrameOrder) {}
    /// What was tracked in a frame that is about to be done with.
    fn tracked(&mut self, _tracked: &Tracked) {}
    /// An estimate takes effect on the odometry.
    fn correction(&mut self, _order: &CorrectionOrder) {}
    /// A reset that somebody asked for takes effect.
    fn reset(&mut self, _order: &ResetOrder) {}
    /// The window after an estimate, just before that is handed on.
    fn solved(&mut self, _solved: &Solved<'_>) {}
    /// An estimate, once for each frame; `frame_ms` is the wall time of its computation.
    fn estimate(&mut self, _estimate: &Estimate, _frame_ms: f64) {}
    /// What became of a frame that was to be given to the map: by the front-end one that was passed over, by the window
    /// one that takes effect.
    fn map_order(&mut self, _order: &MapOrder) {}
    /// Where the odometry lies in the map, once for each estimate, just before that is handed on.
    fn map_estimate(&mut self, _estimate: &MapEstimate) {}
    /// A frame was taken into the map.
    fn mapped(&mut self, _mapped: &Mapped<'_>) {}
    /// Odometry, once for each inertial sample after the first pose.
    fn odometry(&mut self, _odometry: &Odometry) {}
    /// Something that people want to know.
    fn event(&mut self, _event: &Event) {}
}

/// What the window holds after an estimate.
pub struct Solved<'a> {
    /// The estimate.
    pub estimate: &'a Estimate,
    /// Covariance of the step from the estimate about a second before, where a listener keeps steps.
    pub step: Option<&'a StepCovariance>,
    pub(super) window: &'a Window,
}

impl Solved<'_> {
    /// Copies keyframes and landmarks into `snapshot`, which has room for them.
    pub fn copy_to(&self, snapshot: &mut MapSnapshot) {
        self.window.snapshot(self.estimate, snapshot);
    }
}

/// The map after a frame.
#[derive(Clone, Copy)]
pub struct Mapped<'a> {
    /// What was found.
    pub update: &'a MapUpdate,
    /// Keyframes, graph and loops.
    pub mapper: &'a Mapper,
}

/// Subscriber that ignores everything.
impl Subscriber for () {
    fn listener(&mut self, _producer: Producer) -> Box<dyn Listener> {
        Box::new(())
    }
}

impl Listener for () {}

/// Several subscribers, whose listeners are told in order: one that leaves other buffers in a frame comes last.
pub struct Several<'a>(pub Vec<&'a mut dyn Subscriber>);

impl Subscriber for Several<'_> {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        Box::new(Listeners(self.0.iter_mut().map(|subscriber| subscriber.listener(producer)).collect()))
    }

    fn pulses(&self, adopt: &mut dyn FnMut(Arc<Pulse>)) {
        self.0.iter().for_each(|subscriber| subscriber.pulses(adopt));
    }
}

struct Listeners(Vec<Box<dyn Listener>>);

impl Listener for Listeners {
    fn keeps_steps(&self) -> bool {
        self.0.iter().any(|listener| listener.keeps_steps())
    }

    fn reading(&mut self, reading: &ImuReading) {
        self.0.iter_mut().for_each(|listener| listener.reading(reading));
    }

    fn frame(&mut self, frame: &mut StereoFrame) {
        self.0.iter_mut().for_each(|listener| listener.frame(frame));
    }

    fn order(&mut self, order: &FrameOrder) {
        self.0.iter_mut().for_each(|listener| listener.order(order));
    }

    fn tracked(&mut self, tracked: &Tracked) {
        self.0.iter_mut().for_each(|listener| listener.tracked(tracked));
    }

    fn correction(&mut self, order: &CorrectionOrder) {
        self.0.iter_mut().for_each(|listener| listener.correction(order));
    }

    fn reset(&mut self, order: &ResetOrder) {
        self.0.iter_mut().for_each(|listener| listener.reset(order));
    }

    fn solved(&mut self, solved: &Solved<'_>) {
        self.0.iter_mut().for_each(|listener| listener.solved(solved));
    }

    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64) {
        self.0.iter_mut().for_each(|listener| listener.estimate(estimate, frame_ms));
    }

    fn map_order(&mut self, order: &MapOrder) {
        self.0.iter_mut().for_each(|listener| listener.map_order(order));
    }

    fn map_estimate(&mut self, estimate: &MapEstimate) {
        self.0.iter_mut().for_each(|listener| listener.map_estimate(estimate));
    }

    fn mapped(&mut self, mapped: &Mapped<'_>) {
        self.0.iter_mut().for_each(|listener| listener.mapped(mapped));
    }

    fn odometry(&mut self, odometry: &Odometry) {
        self.0.iter_mut().for_each(|listener| listener.odometry(odometry));
    }

    fn event(&mut self, event: &Event) {
        self.0.iter_mut().for_each(|listener| listener.event(event));
    }
}
