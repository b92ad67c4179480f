//! The local socket: a flight's odometry, estimates and more for programs of this computer, and commands from them.
//!
//! A Unix stream socket whose format is documented in `docs/local-socket.md`. Listeners on the threads of the run
//! ([`listener`]) copy into wait-free lanes and pools; a thread of normal priority ([`server`]) encodes each record once and
//! hands it to every reader that wants it. A reader has a bounded queue of its own ([`outbox`]): one that is slow loses the
//! oldest records and is told how many, and delays nobody.
//!
//! [`record`], [`request`] and [`plumbline_record::layout`] are the format, [`plumbline_record::messages`] the records that are
//! protobuf; the crate `plumbline-client` is the other end.

mod allowance;
mod asked;
mod commands;
mod door;
mod listener;
mod outbox;
mod reader;
mod server;
mod socket;
#[cfg(test)]
mod tests;
mod words;

pub use crate::sensor_board::{SensorBoard, SensorNews};
pub use plumbline_record::local::{picture, record, request};

pub use picture::Shot;
pub use request::Failure;
pub use socket::{LinkDoor, LocalSocket};
pub use words::LinkWord;

use std::path::PathBuf;
use thiserror::Error;

/// Why there can be no local socket.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LocalError {
    /// A path at which no socket can be opened.
    #[error("{}: {reason}", path.display())]
    Path {
        /// Path of the socket.
        path: PathBuf,
        /// Reason and cure.
        reason: String,
    },
    /// The thread cannot be started, or there are no more file descriptors.
    #[error("cannot start the thread of the local socket: {0}")]
    Thread(#[from] std::io::Error),
}
