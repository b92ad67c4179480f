//! Sockets of this computer: a flight's records for programs, and frames of a program of the user's own.

use plumbline_keys::keys;

/// Unix socket on which programs of this computer read the flight; `docs/local-socket.md` is its interface.
#[keys]
pub struct LocalConfig {
    /// Unix socket, such as "/run/plumbline/local"; empty for none.
    #[key(default)]
    pub path: String,
    /// Permissions of the socket, octal. Every user who may connect may read. Only root, the user of the flight and the
    /// socket's group may give commands.
    #[key(default = "0660")]
    pub mode: String,
    /// Group of the socket, by name or number; empty for that of the process.
    #[key(default)]
    pub group: String,
}

impl LocalConfig {
    /// Longest path, bytes: the kernel's address has room for 108 with the zero at its end, and the socket is made under a
    /// temporary name.
    pub const MAX_PATH_BYTES: usize = 100;

    /// Permission bits of the socket; `None` where the text is no octal number of permissions.
    pub fn mode_bits(&self) -> Option<u32> {
        let digits = self.mode.strip_prefix("0o").unwrap_or(&self.mode);
        let is_octal = !digits.is_empty() && digits.bytes().all(|b| (b'0'..=b'7').contains(&b));
        u32::from_str_radix(digits, 8).ok().filter(|bits| is_octal && *bits <= 0o777)
    }
}

/// Frames that a program sends which knows the cameras: one with a maker's SDK, or one that plays a recording. What it is
/// to send is in `docs/own-sensors.md`.
#[keys]
pub struct FramesConfig {
    /// Unix socket to listen on, such as "/run/plumbline/frames"; empty for none.
    #[key(default)]
    pub listen: String,
}

impl FramesConfig {
    /// The longest path of a socket, bytes: the kernel's address has room for 108 with the zero at its end.
    pub const MAX_PATH_BYTES: usize = 107;
}
