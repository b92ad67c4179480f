//! A flight: what is flown, opened and ready to run ([`open`]), and the run of it with those who listen ([`run`]).
//!
//! What comes out is data: the outcome of the run and the causal trajectory. Reports are made of it further up. What a
//! flight is handed to while it goes on (recorder, network, ROS 2, autopilot) is put together in [`outputs`].

mod cache;
pub mod capture;
pub mod error;
pub mod open;
pub mod outputs;
pub mod overrides;
pub mod plausibility;
pub mod reset_count;
pub mod run;
pub mod sensor_watch;
pub mod sensors;
pub mod states;
#[cfg(test)]
mod tests;
pub mod trajectory;

pub use error::FlightError;
pub use open::{
    Cut, RecordingKind, inertial_samples, is_log, open_bag, open_dataset, open_log, open_recording,
    open_simulation, preset_for, recording_kind, scenario_config,
};
pub use outputs::Outputs;
pub use overrides::with_overrides;
pub use reset_count::ResetCount;
pub use run::{Flown, fly};
pub use sensors::{LiveSensors, open_cameras_alone, open_sensors};
pub use trajectory::{CausalPose, CausalTrajectory, KeptStates, OdometryTrajectory};

use crate::log::KnownMap;
use crate::log::source::LogEnd;
use crate::pipeline::Stamps;
use nalgebra::Isometry3;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::simulator::Simulator;
use plumbline_drivers::{FaultySource, FrameFaults, ImuSource, StampedPose, StereoSource};

/// Ground truth further from a stamp than this is none, ns.
const TRUTH_TOLERANCE_NS: i64 = 5_000_000;

/// Streams, configuration and truth of one flight.
pub struct Flight {
    /// What the estimator believes of the rig.
    pub config: ValidConfig,
    /// Inertial samples.
    pub imu: Box<dyn ImuSource>,
    /// Frames.
    pub stereo: Box<dyn StereoSource>,
    /// Ground truth, where there is one.
    pub truth: Truth,
    /// What is flown, in a few words.
    pub name: String,
    /// What is wrong with it by its looks.
    pub findings: Vec<plausibility::Finding>,
    /// How the log that is flown ends, where one is.
    pub log_end: Option<LogEnd>,
    /// A map that the flight goes on with.
    pub map: Option<KnownMap>,
    /// Whose the stamps of its samples are.
    pub stamps: Stamps,
    /// Resets are counted from here on: there may have been a flight before that this one goes on with.
    pub first_reset_counter: u32,
}

impl Flight {
    /// The same flight with `faults` in its frames, whose draws are those of `seed`.
    #[must_use]
    pub fn with_faults(self, faults: FrameFaults, seed: u64) -> Self {
        if faults.is_none() {
            return self;
        }
        Self { stereo: Box::new(FaultySource::new(self.stereo, faults, seed)), ..self }
    }
}

/// Where the vehicle really was.
pub enum Truth {
    /// Nobody knows.
    None,
    /// Measured.
    Recorded(Vec<StampedPose>),
    /// Simulated: known at any time.
    Simulated(Simulator),
}

impl Truth {
    /// The true pose at `stamp`, if known.
    #[must_use]
    pub fn pose_at(&self, stamp: Timestamp) -> Option<Isometry3<f64>> {
        match self {
            Self::None => None,
            Self::Simulated(simulator) => Some(simulator.ground_truth(stamp).pose_w_b),
            Self::Recorded(states) => {
                let after = states.partition_point(|s| s.stamp < stamp);
                let near =
                    [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|k| states.get(k));
                near.min_by_key(|s| s.stamp.nanos_since(stamp).abs())
                    .filter(|s| s.stamp.nanos_since(stamp).abs() <= TRUTH_TOLERANCE_NS)
                    .map(|s| s.pose)
            }
        }
    }

    /// The true poses as they were measured, or at the `stamps` where they are known at any time; empty if nobody knows.
    #[must_use]
    pub fn poses(&self, stamps: impl IntoIterator<Item = Timestamp>) -> Vec<StampedPose> {
        match self {
            Self::None => Vec::new(),
            Self::Recorded(poses) => poses.clone(),
            Self::Simulated(_) => {
                let at = |stamp| Some(StampedPose { stamp, pose: self.pose_at(stamp)? });
                stamps.into_iter().filter_map(at).collect()
            }
        }
    }
}
