//! Frames of a program of the user's own, over a socket of this computer.

use plumbline_keys::keys;
use serde::{Deserialize, Serialize};

/// Frames that a program sends which knows the cameras: one with a maker's SDK, or one that plays a recording. What it is
/// to send is in `docs/own-sensors.md`.
#[keys]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FramesConfig {
    /// Unix socket to listen on, such as "/run/plumbline/frames"; empty for none.
    #[key(default)]
    pub listen: String,
}

impl FramesConfig {
    /// The longest path of a socket, bytes: the kernel's address has room for 108 with the zero at its end.
    pub const MAX_PATH_BYTES: usize = 107;
}
