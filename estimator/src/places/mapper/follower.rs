//! The pose in the map, frame by frame: follows what the map says smoothly.
//!
//! The correction is taken up in the error of the *body*: its position and heading approach those of the target with a
//! time constant, so that a loop far from the origin of the odometry swings nothing about.

use super::MapUpdate;
use crate::estimate::Estimate;
use crate::places::graph::edge::{turn, wrapped, yaw_of};
use nalgebra::Isometry3;
use plumbline_config::{Portable, Timestamp};
use plumbline_fields::Record;

/// Time in which two thirds of a correction are taken up, s.
const TIME_CONSTANT_S: f64 = 1.0;

/// Pose of the odometry frame in the map, for one frame.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("MapEstimate")]
pub struct MapEstimate {
    /// Sequence number of the frame.
    #[field(1, digest = 2)]
    pub frame_sequence: u64,
    /// Time of the state on the IMU's time axis.
    #[field(2, wire = "stamp_ns", digest = 1)]
    pub stamp: Timestamp,
    /// Pose of the odometry frame in the map, smoothly followed: a turn about the vertical and a shift. Absent while it
    /// is not known.
    #[field(3, digest = 3)]
    pub pose_m_o: Option<Isometry3<f64>>,
    /// Resets of the odometry so far.
    #[field(4, digest = 4)]
    pub reset_counter: u32,
    /// Keyframes of the map.
    #[field(5, digest = 5)]
    pub keyframes: u32,
    /// Places seen again so far.
    #[field(6, digest = 6)]
    pub sightings: u32,
    /// Loops that count now.
    #[field(7, digest = 7)]
    pub loops_used: u32,
}

/// Follows the updates of the map.
#[derive(Clone, Debug, Default)]
pub struct MapFollower {
    target: Option<Isometry3<f64>>,
    present: Option<Isometry3<f64>>,
    reset_counter: u32,
    last: Option<Timestamp>,
    keyframes: u32,
    sightings: u32,
    loops_used: u32,
}

impl MapFollower {
    /// Takes an update.
    pub fn apply(&mut self, update: &MapUpdate) {
        (self.keyframes, self.sightings) = (update.keyframes, update.sightings);
        self.loops_used = update.loops_used;
        // One from before a reset is about another odometry frame.
        if update.reset_counter >= self.reset_counter {
            self.begin_odometry_frame(update.reset_counter);
            self.target = update.pose_m_o;
        }
    }

    /// The map as of an estimate.
    pub fn follow(&mut self, estimate: &Estimate) -> MapEstimate {
        self.begin_odometry_frame(estimate.reset_counter);
        let dt_s = self.last.map_or(0.0, |last| estimate.stamp.seconds_since(last)).at_least(0.0);
        self.last = Some(estimate.stamp);
        self.present = match (self.present, self.target) {
            (Some(present), Some(target)) => {
                let share = 1.0 - libm::exp(-dt_s / TIME_CONSTANT_S);
                Some(approached(&present, &target, &estimate.pose_o_b, share))
            }
            // What was not known before is told as it is.
            (_, target) => target,
        };
        MapEstimate {
            frame_sequence: estimate.frame_sequence,
            stamp: estimate.stamp,
            pose_m_o: self.present.filter(|_| estimate.has_pose()),
            reset_counter: estimate.reset_counter,
            keyframes: self.keyframes,
            sightings: self.sightings,
            loops_used: self.loops_used,
        }
    }

    fn begin_odometry_frame(&mut self, reset_counter: u32) {
        if reset_counter != self.reset_counter {
            self.reset_counter = reset_counter;
            (self.target, self.present) = (None, None);
        }
    }
}

/// The pose of `O` in `M` with which the body at `pose_o_b` is by `share` of the way at its target.
fn approached(
    present: &Isometry3<f64>,
    target: &Isometry3<f64>,
    pose_o_b: &Isometry3<f64>,
    share: f64,
) -> Isometry3<f64> {
    let (yaw, target_yaw) = (yaw_of(&present.rotation), yaw_of(&target.rotation));
    let rotation = turn(yaw + share * wrapped(target_yaw - yaw));
    let (here, there) = (present * pose_o_b, target * pose_o_b);
    let p_m_b = here.translation.vector.lerp(&there.translation.vector, share);
    let shift = p_m_b - rotation * pose_o_b.translation.vector;
    Isometry3::from_parts(shift.into(), rotation)
}
