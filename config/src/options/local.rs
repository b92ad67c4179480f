//! Local socket: a flight's records for programs of this computer.

use serde::{Deserialize, Serialize};

/// Unix socket on which programs of this computer read the flight; `docs/local-socket.md` is its interface.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LocalConfig {
    /// Path of the socket; empty for none. The network process has a private one in any case.
    pub path: String,
    /// Permissions of the socket, octal.
    pub mode: String,
    /// Group of the socket, by name or number; empty for the group of the flight's process.
    pub group: String,
}

impl LocalConfig {
    /// Longest path, bytes: the kernel's address has room for 108 with the zero at its end, and the socket is made under a
    /// temporary name.
    pub const MAX_PATH_BYTES: usize = 100;

    /// Permission bits of the socket; `None` where the text is no octal number of permissions.
    #[must_use]
    pub fn mode_bits(&self) -> Option<u32> {
        let digits = self.mode.strip_prefix("0o").unwrap_or(&self.mode);
        let is_octal = !digits.is_empty() && digits.bytes().all(|b| (b'0'..=b'7').contains(&b));
        u32::from_str_radix(digits, 8).ok().filter(|bits| is_octal && *bits <= 0o777)
    }
}

impl Default for LocalConfig {
    fn default() -> Self {
        Self { path: String::new(), mode: "0660".into(), group: String::new() }
    }
}
