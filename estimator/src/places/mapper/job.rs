//! Input and result of a call of the mapper.

use crate::exchange::{Feedback, SolvedFrame};
use crate::places::images::FrameImages;
use nalgebra::Isometry3;
use plumbline_config::{Timestamp, ValidSetup};

/// Input of a call: a solved frame and its images.
#[derive(Clone, Debug)]
pub struct PlaceJob {
    /// The frame.
    pub solved: SolvedFrame,
    /// Extrinsics of the cameras as they were known.
    pub pose_b_c: [Isometry3<f64>; 2],
    /// Images.
    pub images: FrameImages,
}

impl PlaceJob {
    /// An empty one, with room for the images of the setup.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        Self {
            solved: SolvedFrame::default(),
            pose_b_c: [Isometry3::identity(); 2],
            images: FrameImages::new(setup),
        }
    }

    /// Takes what the window said of the frame.
    pub fn describe(&mut self, feedback: &Feedback) {
        self.solved.clone_from(&feedback.solved);
        self.pose_b_c = feedback.pose_b_c;
    }
}

/// A place seen again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Time of the keyframe that was seen again.
    pub keyframe_stamp: Timestamp,
    /// Pose of the body in that of the keyframe.
    pub pose_k_b: Isometry3<f64>,
}

/// Result of a call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapUpdate {
    /// Number of the frame in the window, counted from 0.
    pub index: u64,
    /// Sequence number.
    pub sequence: u64,
    /// Time of the frame.
    pub stamp: Timestamp,
    /// Resets of the odometry up to it: the update is about the odometry frame of these.
    pub reset_counter: u32,
    /// Pose of the odometry frame in the map: a turn about the vertical and a shift. `None` while it is not known.
    pub pose_m_o: Option<Isometry3<f64>>,
    /// True if the frame was searched for; otherwise the result adds nothing to those before.
    pub is_searched: bool,
    /// The place that was seen again, if one was.
    pub sighting: Option<Sighting>,
    /// Keyframes of the map.
    pub keyframes: u32,
    /// Places seen again so far.
    pub sightings: u32,
    /// Loops that count now.
    pub loops_used: u32,
}
