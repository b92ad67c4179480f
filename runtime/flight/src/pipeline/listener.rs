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
use plumbline_drivers::StereoFrame;
use plumbline_estimator::odometry::StepCovariance;
use plumbline_estimator::places::{MapUpdate, Mapper};
use plumbline_estimator::window::Window;
use plumbline_estimator::{Estimate, MapSnapshot, Odometry, Tracked, Trail};
use plumbline_record::Said;
use std::sync::Arc;

/// A thread of a run that produces something. In virtual time one thread may be several of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Producer {
    /// Says readings, corrections and odometry; shows that it is blind.
    Tick,
    /// Says orders, resets and events; shows frames and what was tracked.
    FrontEnd,
    /// Says estimates, events, and where the odometry lies in the map; shows what was solved.
    Window,
    /// Shows the map. Not where places are switched off.
    Places,
    /// Says events. Not in virtual time.
    Watchdog,
}

/// Subscriber to a run.
pub trait Subscriber {
    /// The listener that moves to the thread of `producer`. A run asks once for each.
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener>;

    /// The one that takes the buffers of frames that are done with, if this subscriber has it. A run has one at most: the
    /// first that it finds.
    fn frame_keeper(&mut self) -> Option<Box<dyn FrameKeeper>> {
        None
    }

    /// Hands over the heartbeats of its own threads, for the watchdog of a live run to look after.
    fn pulses(&self, _adopt: &mut dyn FnMut(Arc<Pulse>)) {}
}

/// Takes what one thread of a run produces. What a listener does not ask for passes by.
pub trait Listener: Send {
    /// Requests [`Solved::step`], which costs the window a few percent of a frame. Asked once, before the run.
    fn keeps_steps(&self) -> bool {
        false
    }
    /// Something that the flight says: an input, an order, an output or an event.
    fn said(&mut self, _said: &Said) {}
    /// Shows the data of the thread, to be copied now or never.
    fn shown(&mut self, _view: ListenerView<'_>) {}
}

/// Takes frames that are done with, once every listener has been shown them.
pub trait FrameKeeper: Send {
    /// Takes the content of `frame` and leaves other buffers of the same sizes in its place, or leaves it as it is.
    fn keep(&mut self, frame: &mut StereoFrame);
}

/// Data of a thread.
#[derive(Clone, Copy)]
pub enum ListenerView<'a> {
    /// Tracks of a frame whose images are about to be released.
    Tracked(&'a Tracked),
    /// A frame that is done with, taken or refused.
    Frame(&'a StereoFrame),
    /// The window after an estimate, just before that is said.
    Solved(&'a Solved<'a>),
    /// The map after a frame was taken into it.
    Mapped(&'a Mapped<'a>),
    /// The last odometry, blind, while the inertial sensor brings nothing: no output of the estimator, and in no log.
    Blind(&'a Odometry),
}

/// Window after an estimate.
pub struct Solved<'a> {
    /// The estimate.
    pub estimate: &'a Estimate,
    /// Covariance of the step from the estimate about a second before, where a listener keeps steps.
    pub step: Option<&'a StepCovariance>,
    pub(super) window: &'a Window,
}

impl Solved<'_> {
    /// The window, to be looked at.
    pub fn window(&self) -> &Window {
        self.window
    }

    /// Copies the states of the window into `trail`, which has room for them.
    pub fn trail_to(&self, trail: &mut Trail) {
        self.window.trail(self.estimate, trail);
    }

    /// Copies keyframes and landmarks into `snapshot`, which has room for them.
    pub fn copy_to(&self, snapshot: &mut MapSnapshot) {
        self.window.snapshot(self.estimate, snapshot);
    }
}

/// The map after a frame.
#[derive(Clone, Copy)]
pub struct Mapped<'a> {
    /// Result of the mapper.
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

/// Several subscribers, whose listeners are told in order.
pub struct Several<'a>(pub Vec<&'a mut dyn Subscriber>);

impl Subscriber for Several<'_> {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        Box::new(Listeners(self.0.iter_mut().map(|subscriber| subscriber.listener(producer)).collect()))
    }

    fn frame_keeper(&mut self) -> Option<Box<dyn FrameKeeper>> {
        self.0.iter_mut().find_map(|subscriber| subscriber.frame_keeper())
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

    fn said(&mut self, said: &Said) {
        self.0.iter_mut().for_each(|listener| listener.said(said));
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        self.0.iter_mut().for_each(|listener| listener.shown(view));
    }
}
