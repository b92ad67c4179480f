//! Failures between a program and a flight.

use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why a flight cannot be read, or be sent anything.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ClientError {
    /// No flight listens at the path.
    #[error("{}: cannot connect: {source}; check that plumbline runs, and that its configuration names this path", path.display())]
    Connect {
        /// Path of the socket.
        path: PathBuf,
        /// Reason given by the system.
        source: io::Error,
    },
    /// The other end has closed.
    #[error("plumbline has closed the connection; its log says why. Connect again")]
    Closed,
    /// The other end takes or gives no bytes in time.
    #[error("plumbline does not answer within {0} s; check that it runs. Connect again")]
    Silent(f64),
    /// The connection fails.
    #[error("the connection to plumbline failed: {0}. Connect again")]
    Io(#[from] io::Error),
    /// The other end is no flight of this version.
    #[error("{0}: this is not a socket of this version of plumbline; check the path")]
    Foreign(&'static str),
    /// There is no image in the frame.
    #[error("the frame has neither a left nor a right image; send at least one")]
    NoImage,
    /// The line of a sensor cannot be made.
    #[error("{}: the line of the inertial sensor cannot be made: {source}; name a path in a folder that may be written to", path.display())]
    Line {
        /// Name of the line.
        path: PathBuf,
        /// Reason given by the system.
        source: io::Error,
    },
    /// A value of an inertial sample is not a finite number.
    #[error("an inertial sample has a value that is not a finite number; drop it, and check the sensor")]
    NotFinite,
}

impl From<rustix::io::Errno> for ClientError {
    fn from(error: rustix::io::Errno) -> Self {
        match error {
            rustix::io::Errno::PIPE | rustix::io::Errno::CONNRESET => Self::Closed,
            error => Self::Io(error.into()),
        }
    }
}
