//! Errors of a flight that cannot be opened or flown.

use crate::autopilot::BridgeError;
use crate::log::LogError;
use crate::pipeline::RunError;
use plumbline_config::ConfigError;
use plumbline_drivers::DriverError;
use std::path::PathBuf;
use thiserror::Error;

/// Errors of a flight that cannot be opened or flown. Every message names the file, the key or the device.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FlightError {
    /// The request is invalid: a name, a path, a number; the message says what to give.
    #[error("{0}")]
    Invalid(String),
    /// The configuration is refused.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// The calibration of the data set is refused.
    #[error("calibration of the data set (camera[0] is cam0, camera[1] is cam1)")]
    Calibration(#[source] ConfigError),
    /// A data set cannot be read.
    #[error("{0}")]
    Driver(#[from] DriverError),
    /// The scenario is impossible, or its trajectory cannot be read.
    #[error("the flight cannot be simulated")]
    Simulation(#[source] DriverError),
    /// A flight log cannot be read or written.
    #[error("{0}")]
    Log(#[from] LogError),
    /// Rendered frames cannot be kept or taken from where they are kept.
    #[error("{}: {source}", path.display())]
    Cache {
        /// The file or folder.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A file of rendered frames does not hold all of them.
    #[error("{}: not a complete file of frames; delete it", path.display())]
    CacheIncomplete {
        /// The file.
        path: PathBuf,
    },
    /// The autopilot cannot be reached.
    #[error("{0}")]
    Autopilot(#[from] BridgeError),
    /// The run ended early.
    #[error("{0}")]
    Run(#[from] RunError),
}

impl FlightError {
    /// True if the request is wrong, rather than the flight.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Invalid(_) | Self::Autopilot(BridgeError::Mounting(_)))
    }
}
