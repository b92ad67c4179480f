//! What the tick and the autopilot's thread share. Nobody waits for anybody.

use crate::schedule::ring::{Bell, Reader, Writer, ring};
use crate::schedule::ticker::Monotonic;
use nalgebra::UnitQuaternion;
use plumbline_estimator::Odometry;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

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

/// Stands for a reset counter before the first estimate.
const UNKNOWN: u64 = u64::MAX;

/// What is true right now.
#[derive(Debug)]
pub struct Signals {
    /// Reset counter of the newest estimate.
    resets: AtomicU64,
    /// Set once, at the end.
    pub stop: AtomicBool,
}

impl Default for Signals {
    fn default() -> Self {
        Self { resets: AtomicU64::new(UNKNOWN), stop: AtomicBool::new(false) }
    }
}

impl Signals {
    /// Notes the reset counter of the newest estimate.
    pub fn estimated(&self, reset_counter: u32) {
        self.resets.store(reset_counter.into(), Ordering::Relaxed);
    }

    /// Reset counter of the newest estimate; `None` before the first.
    #[must_use]
    pub fn resets(&self) -> Option<u32> {
        u32::try_from(self.resets.load(Ordering::Relaxed)).ok()
    }
}
