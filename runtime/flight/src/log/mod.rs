//! The flight log: every input, every order and every output of a run in MCAP files, and the re-execution
//! that proves them.
//!
//! Writing: a [`recorder`] thread takes [`entry`]s from a bounded queue to a [`writer`], which cuts the log
//! into parts ([`part`], [`parts`]) that each say what they belong to ([`part_header`]). Reading: a [`reader`] goes through
//! the parts, a [`cursor`] hands out one kind at a time, and [`source`] makes sensor streams of it.
//! [`verify`] runs the estimator again ([`execute`]) and compares bit for bit ([`plumbline_record::compare`]). What the
//! bytes mean is in [`channel`], [`plumbline_record::fields`], [`image`] and [`rig`].

pub mod build_id;
pub mod channel;
mod comparison;
pub mod complete_parts;
pub mod cursor;
pub mod entry;
pub mod execute;
pub mod export;
mod frames;
pub mod image;
pub mod inventory;
mod known;
pub mod narrate;
pub mod part;
pub mod part_file;
pub mod part_header;
pub mod parts;
pub mod reader;
pub mod recorder;
pub mod rig;
pub mod seal;
pub mod source;
pub mod sync;
pub mod verify;
pub mod writer;

#[cfg(test)]
mod tests;

pub use entry::LogEntry;
pub use known::KnownMap;
pub use reader::LogReader;
pub use recorder::{Recorder, RecorderHandle, WhenFull};

use plumbline_config::ConfigError;
use plumbline_drivers::DriverError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Errors of a log that cannot be written or read. Every message names the file and the cure.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LogError {
    /// A file could not be read or written.
    #[error("{}: {source}; check the path and its permissions", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// There is a log of that name.
    #[error("{}: exists; a flight log is never overwritten: name another, or delete it", path.display())]
    Exists {
        /// The file that is in the way.
        path: PathBuf,
    },
    /// The file is no flight log, or of another version.
    #[error("{}: {reason}", path.display())]
    NotALog {
        /// The file.
        path: PathBuf,
        /// Missing item and cure.
        reason: String,
    },
    /// The bytes are not those that were written.
    #[error("{}: damaged after {offset} bytes: {reason}; what comes before is sound", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Bytes read so far.
        offset: u64,
        /// Mismatch.
        reason: String,
    },
    /// The files have reached the size that the configuration allows.
    #[error("{}: reached recorder.max_total_mb = {limit_mb} MB", path.display())]
    Full {
        /// The first file of the log.
        path: PathBuf,
        /// The limit, MB.
        limit_mb: u64,
    },
    /// The log holds what this build cannot execute, or not all that an execution needs.
    #[error("{}: {reason}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// Missing item and cure.
        reason: String,
    },
    /// The configuration cannot be written down so that it comes back.
    #[error("the configuration cannot be recorded: {0}")]
    Config(#[from] ConfigError),
    /// The data set that holds the images cannot be read.
    #[error(transparent)]
    Images(#[from] DriverError),
    /// The system would not start the recorder's thread.
    #[error("cannot start the recorder's thread: {0} (too many threads or too little memory on this host)")]
    Thread(std::io::Error),
}

impl LogError {
    fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }

    fn unusable(path: &Path, reason: impl Into<String>) -> Self {
        Self::Unusable { path: path.to_owned(), reason: reason.into() }
    }
}
