//! What can stop a driver.

use std::path::PathBuf;
use thiserror::Error;

/// Why a source cannot be opened or cannot go on. Every message names the file and the cure.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DriverError {
    /// A file or directory could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// What was accessed.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file or directory is not what its format says; `message` says what is wrong and what to do.
    #[error("{}: {message}", path.display())]
    Malformed {
        /// The file or directory.
        path: PathBuf,
        /// What is wrong, and what to do.
        message: String,
    },
}
