//! Errors of the network.

use std::path::PathBuf;
use thiserror::Error;

/// Errors of the network.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetError {
    /// A session cannot be opened.
    #[error("{}: {message}", connect.iter().chain(listen).cloned().collect::<Vec<_>>().join(", "))]
    Open {
        /// Endpoints on which it was to listen.
        listen: Vec<String>,
        /// Endpoints to which it was to connect.
        connect: Vec<String>,
        /// Reason and cure.
        message: String,
    },
    /// An endpoint that cannot work.
    #[error("endpoint {endpoint}: {reason}")]
    Endpoint {
        /// The endpoint.
        endpoint: String,
        /// Reason and cure.
        reason: String,
    },
    /// The port is already in use.
    #[error("{endpoint}: port already in use; stop the other process, or choose another port")]
    Taken {
        /// The endpoint.
        endpoint: String,
    },
    /// A key cannot be declared.
    #[error("cannot declare '{key}': {message}")]
    Declare {
        /// The key.
        key: String,
        /// Zenoh's message.
        message: String,
    },
    /// A file of the configuration cannot be used.
    #[error("{path}: {message} ({key})")]
    File {
        /// The file.
        path: PathBuf,
        /// The key of the configuration, or the option, that names it.
        key: &'static str,
        /// Reason and cure.
        message: String,
    },
    /// The network's own thread cannot be started.
    #[error("cannot start the network thread: {0}")]
    Thread(#[from] std::io::Error),
}

impl NetError {
    /// True if another attempt with the same configuration cannot succeed.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Endpoint { .. } | Self::File { .. })
    }
}
