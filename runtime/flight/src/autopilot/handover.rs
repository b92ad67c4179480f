//! What the tick and the autopilot's thread share. Nobody waits for anybody.

use crate::pipeline::Instants;
use crate::schedule::ring::{Bell, Reader, Writer, ring};
use crate::schedule::ticker::Monotonic;
use nalgebra::UnitQuaternion;
use plumbline_estimator::Odometry;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

/// Odometry that waits for the autopilot's thread, which takes the newest: a third of a second at 200 Hz.
const RING: usize = 64;

/// Odometry on its way to the autopilot.
#[derive(Clone, Debug)]
pub struct Handover {
    /// As the run gave it.
    pub odometry: Odometry,
    /// When it was measured, by the host's clock.
    pub measured: Monotonic,
    /// From `O` to LOCAL_FRD.
    pub rot_l_o: UnitQuaternion<f64>,
}

/// The ring from the tick to the autopilot's thread.
#[must_use]
pub fn handover_ring() -> (Writer<Handover>, Reader<Handover>) {
    // Nobody is woken: the autopilot's thread keeps its own rate.
    ring(RING, &Bell::default())
}

/// What is true right now.
#[derive(Debug)]
pub struct Signals {
    /// Cleared when the estimate is given up, set by the next odometry.
    pub has_pose: AtomicBool,
    /// Set once, at the end.
    pub stop: AtomicBool,
    /// Where states at camera triggers are asked for, if the flight answers.
    pub instants: OnceLock<Arc<Instants>>,
}

impl Default for Signals {
    fn default() -> Self {
        Self { has_pose: AtomicBool::new(true), stop: AtomicBool::new(false), instants: OnceLock::new() }
    }
}
