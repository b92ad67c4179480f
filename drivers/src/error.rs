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
    /// A file or directory is not what its format says; `message` says what is wrong and what to do.
    #[error("{}: {message}", path.display())]
    Malformed {
        /// The file or directory.
        path: PathBuf,
        /// Defect and cure.
        message: String,
    },
    /// A requested item is missing; `message` names it and the cure.
    #[error("{}: {message}", path.display())]
    Missing {
        /// The file or directory.
        path: PathBuf,
        /// Missing item and cure.
        message: String,
    },
    /// A file or directory is left alone on purpose; `message` says why and what to do.
    #[error("{}: {message}", path.display())]
    Refused {
        /// The file or directory.
        path: PathBuf,
        /// Reason and cure.
        message: String,
    },
    /// A device that is there does not do what it is asked to; `message` says what, with the key and the cure.
    #[error("{}: {message}", path.display())]
    Device {
        /// The device.
        path: PathBuf,
        /// Unsupported feature and cure.
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

    /// [`Self::Device`] at `path`.
    pub(crate) fn device(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Device { path: path.into(), message: message.into() }
    }

    /// [`Self::Missing`] at `path`.
    pub(crate) fn missing(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Missing { path: path.into(), message: message.into() }
    }

    /// [`Self::Refused`] at `path`.
    pub(crate) fn refused(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Refused { path: path.into(), message: message.into() }
    }

    /// [`Self::Malformed`] at `path`.
    pub fn malformed(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), message: message.into() }
    }
}
