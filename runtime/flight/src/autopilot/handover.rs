//! State that the tick and the autopilot's thread share. Nobody waits for anybody.

use super::flow::FlowMeasurement;
use crate::pipeline::Instants;
use crate::schedule::ring::{Bell, Reader, Writer, ring};
use crate::schedule::ticker::Monotonic;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_estimator::Odometry;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
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

/// Flow that waits for the autopilot's thread: a quarter of a second at 60 frames a second.
const FLOW_RING: usize = 16;

/// Flow on its way to the autopilot.
#[derive(Clone, Debug)]
pub struct FlowHandover {
    /// As the front-end's points gave it.
    pub flow: FlowMeasurement,
    /// Time of the later frame, on the host's clock.
    pub measured: Monotonic,
}

/// The ring from the front-end to the autopilot's thread.
pub fn flow_ring() -> (Writer<FlowHandover>, Reader<FlowHandover>) {
    ring(FLOW_RING, &Bell::default())
}

/// The ring from the tick to the autopilot's thread.
pub fn handover_ring() -> (Writer<Handover>, Reader<Handover>) {
    // Nobody is woken: the autopilot's thread keeps its own rate.
    ring(RING, &Bell::default())
}

/// State right now.
#[derive(Debug)]
pub struct Signals {
    /// Cleared when the estimate is given up, set by the next odometry.
    pub has_pose: AtomicBool,
    /// Set once, at the end.
    pub stop: AtomicBool,
    /// Entrance for requests of states at camera triggers; unset if the flight does not answer them.
    pub instants: OnceLock<Arc<Instants>>,
    /// Bits of the gyroscope's bias, rad/s. A component may be of the next frame.
    bias_gyro: [AtomicU64; 3],
}

impl Signals {
    /// Leaves the gyroscope's bias for the flow.
    pub fn set_bias_gyro(&self, bias: &Vector3<f64>) {
        self.bias_gyro.iter().zip(bias).for_each(|(to, x)| to.store(x.to_bits(), Ordering::Relaxed));
    }

    /// The gyroscope's bias as last estimated, rad/s.
    pub fn bias_gyro(&self) -> Vector3<f64> {
        Vector3::from_fn(|k, _| f64::from_bits(self.bias_gyro[k].load(Ordering::Relaxed)))
    }
}

impl Default for Signals {
    fn default() -> Self {
        Self {
            has_pose: AtomicBool::new(true),
            stop: AtomicBool::new(false),
            instants: OnceLock::new(),
            // The bits of 0.0.
            bias_gyro: [0; 3].map(AtomicU64::new),
        }
    }
}
