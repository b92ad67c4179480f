//! Trail of the last seconds: the states of the window as they are known now, with all that was seen since.

use super::Window;
use crate::estimate::Estimate;
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_fields::Record;

/// State of a frame of the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("TrailState")]
pub struct TrailState {
    /// Time of the frame, on the IMU's clock.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    #[field(2)]
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    #[field(3, wire = "velocity_o_b")]
    pub v_o_b: Vector3<f64>,
}

/// States of the window after one frame, oldest first. What was published of them then was not smoothed.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Trail")]
pub struct Trail {
    /// Time of the newest frame.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Resets so far.
    #[field(2)]
    pub reset_counter: u32,
    /// Keyframes and the newest frames.
    #[field(3, most = 64)]
    pub states: Vec<TrailState>,
}

impl Trail {
    /// An empty one, with room for any window.
    #[must_use]
    pub fn with_room() -> Self {
        Self { states: Vec::with_capacity(super::MAX_FRAMES), ..Self::default() }
    }
}

impl Window {
    /// Writes down the states of all frames; allocates nothing in a trail that has room.
    pub fn trail(&self, estimate: &Estimate, trail: &mut Trail) {
        trail.stamp = estimate.stamp;
        trail.reset_counter = estimate.reset_counter;
        trail.states.clear();
        trail.states.extend(self.frames.iter().map(|frame| TrailState {
            stamp: frame.stamp,
            pose_o_b: frame.pose_at_stamp(),
            v_o_b: frame.nav.v_o_b,
        }));
    }
}
