//! Listening to a run: every input, order and output as it passes.
//!
//! The order of the calls carries meaning where one thread makes them: the order of a frame comes after
//! the readings it counts and any reset before it, a correction before the reading that it precedes.
//! Between threads nothing follows from it: each call makes sense by its own numbers.

use super::orders::{CorrectionOrder, FrameOrder, ResetOrder};
use crate::log::Event;
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::window::Window;
use plumbline_estimator::{Estimate, Odometry, Tracked};

/// Takes what passes through a run: must not block in a live one, nor allocate. What a listener does not ask for
/// passes by.
pub trait Tap: Send {
    /// Another of the same listener, for another thread.
    fn another(&self) -> Box<dyn Tap>;
    /// An inertial sample, as the odometry is given it.
    fn reading(&mut self, _reading: &ImuReading) {}
    /// A frame that is done with, taken or refused. The tap may keep its buffers and leave others of the
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
    fn solved(&mut self, _window: &Window, _estimate: &Estimate) {}
    /// An estimate.
    fn estimate(&mut self, _estimate: &Estimate) {}
    /// Odometry.
    fn odometry(&mut self, _odometry: &Odometry) {}
    /// Something that people want to know.
    fn event(&mut self, _event: &Event) {}
}

/// Nobody listens.
impl Tap for () {
    fn another(&self) -> Box<dyn Tap> {
        Box::new(())
    }
}

/// Several listeners, told in order: one that leaves other buffers in a frame comes last.
pub struct Several(pub Vec<Box<dyn Tap>>);

impl Tap for Several {
    fn another(&self) -> Box<dyn Tap> {
        Box::new(Self(self.0.iter().map(|tap| tap.another()).collect()))
    }

    fn reading(&mut self, reading: &ImuReading) {
        self.0.iter_mut().for_each(|tap| tap.reading(reading));
    }

    fn frame(&mut self, frame: &mut StereoFrame) {
        self.0.iter_mut().for_each(|tap| tap.frame(frame));
    }

    fn order(&mut self, order: &FrameOrder) {
        self.0.iter_mut().for_each(|tap| tap.order(order));
    }

    fn tracked(&mut self, tracked: &Tracked) {
        self.0.iter_mut().for_each(|tap| tap.tracked(tracked));
    }

    fn correction(&mut self, order: &CorrectionOrder) {
        self.0.iter_mut().for_each(|tap| tap.correction(order));
    }

    fn reset(&mut self, order: &ResetOrder) {
        self.0.iter_mut().for_each(|tap| tap.reset(order));
    }

    fn solved(&mut self, window: &Window, estimate: &Estimate) {
        self.0.iter_mut().for_each(|tap| tap.solved(window, estimate));
    }

    fn estimate(&mut self, estimate: &Estimate) {
        self.0.iter_mut().for_each(|tap| tap.estimate(estimate));
    }

    fn odometry(&mut self, odometry: &Odometry) {
        self.0.iter_mut().for_each(|tap| tap.odometry(odometry));
    }

    fn event(&mut self, event: &Event) {
        self.0.iter_mut().for_each(|tap| tap.event(event));
    }
}
