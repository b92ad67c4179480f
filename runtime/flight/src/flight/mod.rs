//! A flight: what is flown, opened and ready to run ([`open`]), and the run of it with those who listen ([`run`]).
//!
//! The output is data: the outcome of the run and the published states. Reports are made of it further up. What a flight is
//! handed to while it goes on (recorder, autopilot, what the caller adds) is put together in [`outputs`].

pub(crate) mod cache;
pub mod capture;
pub mod error;
mod injected;
pub mod instants;
pub mod open;
pub mod outputs;
pub mod overrides;
pub mod plausibility;
pub mod published;
pub mod reset_count;
pub mod run;
pub mod sensor_watch;
pub mod sensors;
#[cfg(test)]
mod tests;
pub mod trajectory;
pub mod truth;

pub use error::FlightError;
pub use instants::{KeptInstants, StampsError, read_stamps};
pub use open::{
    Cut, RecordingKind, is_log, open_bag, open_dataset, open_log, open_recording, open_simulation,
    preset_for, recording_kind, scenario_config,
};
pub use outputs::Outputs;
pub use overrides::with_overrides;
pub use published::{FrameStatus, Published, PublishedState};
pub use reset_count::first_reset_counter;
pub use run::{Flown, fly};
pub use sensors::{LiveSensors, open_sensors};
pub use trajectory::{Kept, KeptOdometry, KeptStates, OdometryTrajectory};
pub use truth::{TrueState, Truth};

use crate::log::KnownMap;
use crate::log::source::LogEnd;
use crate::pipeline::Stamps;
use plumbline_config::ValidConfig;
use plumbline_drivers::euroc::FileDefects;
use plumbline_drivers::{ImuSource, StereoSource};
use plumbline_simulator::InjectedFault;

/// Streams, configuration and truth of one flight.
pub struct Flight {
    /// Configuration of the estimator.
    pub config: ValidConfig,
    /// Inertial samples.
    pub imu: Box<dyn ImuSource>,
    /// Frames.
    pub stereo: Box<dyn StereoSource>,
    /// Ground truth, where there is one.
    pub truth: Truth,
    /// Short name of the flight.
    pub name: String,
    /// Findings of the input check.
    pub findings: Vec<plausibility::Finding>,
    /// End of the log that is replayed; `None` for other inputs.
    pub log_end: Option<LogEnd>,
    /// Rows and images of the data set that cannot be read: grows while it is read.
    pub file_defects: FileDefects,
    /// Map that the flight continues; `None` if it starts without one.
    pub map: Option<KnownMap>,
    /// Clock domain of the sample timestamps.
    pub stamps: Stamps,
    /// First value of the reset counter: greater than 0 if this flight continues an earlier one.
    pub first_reset_counter: u32,
    /// Faults that are injected.
    pub injected: Vec<InjectedFault>,
}

impl Flight {
    /// A flight of these streams, without truth, map or earlier flight, whose samples are stamped already.
    pub fn new(
        config: ValidConfig,
        imu: Box<dyn ImuSource>,
        stereo: Box<dyn StereoSource>,
        name: String,
    ) -> Self {
        Self {
            config,
            imu,
            stereo,
            truth: Truth::None,
            name,
            findings: Vec::new(),
            log_end: None,
            file_defects: FileDefects::default(),
            map: None,
            stamps: Stamps::Replayed,
            first_reset_counter: 0,
            injected: Vec::new(),
        }
    }

    /// Number of inertial samples that the flight is expected to have; 0 if that is unknown.
    pub fn expected_readings(&self) -> usize {
        let frames = self.stereo.expected_frames().unwrap_or(0) as f64;
        (frames * self.config.imu.rate_hz / self.config.camera[0].rate_hz).ceil() as usize
    }
}
