//! A flight: what is flown, opened and ready to run ([`open`]), and the run of it with those who listen ([`run`]).
//!
//! What comes out is data: the outcome of the run and the causal trajectory. Reports are made of it further up. What a
//! flight is handed to while it goes on (recorder, autopilot, what the caller adds) is put together in [`outputs`].

mod cache;
pub mod capture;
pub mod error;
pub mod open;
pub mod outputs;
pub mod overrides;
pub mod plausibility;
pub mod published;
pub mod reset_count;
pub mod run;
pub mod sensor_watch;
pub mod sensors;
pub mod states;
#[cfg(test)]
mod tests;
pub mod trajectory;
pub mod truth;

pub use error::FlightError;
pub use open::{
    Cut, RecordingKind, inertial_samples, is_log, open_bag, open_dataset, open_log, open_recording,
    open_simulation, preset_for, recording_kind, scenario_config,
};
pub use outputs::{Output, Outputs};
pub use overrides::with_overrides;
pub use published::{Published, PublishedState};
pub use reset_count::ResetCount;
pub use run::{Flown, fly};
pub use sensors::{LiveSensors, open_cameras_alone, open_sensors};
pub use trajectory::{CausalPose, CausalTrajectory, KeptStates, OdometryTrajectory};
pub use truth::{TrueState, Truth};

use crate::log::KnownMap;
use crate::log::source::LogEnd;
use crate::pipeline::Stamps;
use plumbline_config::ValidConfig;
use plumbline_drivers::{FaultySource, FrameFaults, ImuSource, StereoSource};

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
