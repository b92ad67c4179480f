//! Frames of a program of the user's own, over a socket of this computer.

use serde::{Deserialize, Serialize};

/// Frames that a program sends which knows the cameras: one with a maker's SDK, or one that plays a recording. What it is
/// to send is in `docs/frame-socket.md`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FramesConfig {
    /// Path of the Unix socket that is made and listened on; empty for none.
    pub listen: String,
}

impl FramesConfig {
    /// The longest path of a socket, bytes: the kernel's address has room for 108 with the zero at its end.
    pub const MAX_PATH_BYTES: usize = 107;
}
