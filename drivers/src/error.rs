//! Errors that stop a driver.

use std::path::PathBuf;
use thiserror::Error;

/// Errors of a source that cannot be opened or cannot go on. Every message names the file and the cure.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DriverError {
    /// A file or directory could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// File or device accessed.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A file, directory or device cannot be used as it is asked for: it is missing, not what its format says, or cannot do
    /// it; `message` says what is wrong and what to do.
    #[error("{}: {message}", path.display())]
    Refused {
        /// File or device accessed.
        path: PathBuf,
        /// Reason and cure.
        message: String,
    },
    /// An inertial sensor's address says nothing; the message says what to write.
    #[error("driver.imu.connect: {0}")]
    ImuAddress(String),
    /// A simulated flight asks for what cannot be; the message says what to change.
    #[error("simulated flight: {0}")]
    Scenario(String),
    /// The system would not start a thread.
    #[error("cannot start a worker thread: {0} (too many threads or too little memory on this host)")]
    Thread(std::io::Error),
}

impl DriverError {
    /// [`Self::Io`] at `path`.
    pub(crate) fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }

    /// [`Self::Refused`] at `path`.
    pub fn refused(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Refused { path: path.into(), message: message.into() }
    }
}
