//! Supervisor of this process: systemd, or another program that speaks its protocol.
//!
//! A datagram that finds no room is dropped and sent again later: the thread that reports liveness must not block, and
//! the libraries for this do.

use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

/// Variable that names the supervisor's socket.
const SOCKET: &str = "NOTIFY_SOCKET";
/// After which silence it acts, us, and of which process.
const PATIENCE_US: &str = "WATCHDOG_USEC";
const PROCESS: &str = "WATCHDOG_PID";

/// Message to a supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// The start is over.
    Ready,
    /// Alive.
    Alive,
    /// The end has begun.
    Stopping,
}

impl Word {
    fn bytes(self) -> &'static [u8] {
        match self {
            Self::Ready => b"READY=1",
            Self::Alive => b"WATCHDOG=1",
            Self::Stopping => b"STOPPING=1",
        }
    }
}

/// The way to the supervisor, if there is one.
#[derive(Debug, Default)]
pub struct Supervisor {
    socket: Option<UnixDatagram>,
    patience: Option<Duration>,
}

impl Supervisor {
    /// The one that the environment of this process names.
    pub fn of_environment() -> Self {
        let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
        let is_for_us = number(PROCESS).is_none_or(|pid| pid == u64::from(std::process::id()));
        let patience = number(PATIENCE_US).filter(|us| *us > 0 && is_for_us).map(Duration::from_micros);
        let socket = std::env::var_os(SOCKET).filter(|name| !name.is_empty()).and_then(|name| {
            let connected = connect(&name);
            connected.inspect_err(|error| tracing::warn!("{SOCKET}: cannot notify systemd: {error}")).ok()
        });
        Self { socket, patience }
    }

    /// Timeout of the supervisor for a sign of life.
    pub fn patience(&self) -> Option<Duration> {
        self.patience
    }

    /// Tells it; neither waits nor allocates.
    pub fn tell(&self, word: Word) {
        if let Some(socket) = &self.socket {
            let _ = socket.send(word.bytes());
        }
    }
}

/// A name that begins with `@` is one of the abstract namespace.
fn connect(name: &OsStr) -> io::Result<UnixDatagram> {
    let address = match name.as_bytes() {
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
        path => SocketAddr::from_pathname(OsStr::from_bytes(path))?,
    };
    let socket = UnixDatagram::unbound()?;
    socket.connect_addr(&address)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_supervisor_is_told_and_one_that_does_not_listen_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let theirs = UnixDatagram::bind(&path).unwrap();
        let ours = Supervisor { socket: Some(connect(path.as_os_str()).unwrap()), patience: None };
        ours.tell(Word::Ready);
        let mut bytes = [0; 64];
        let count = theirs.recv(&mut bytes).unwrap();
        assert_eq!(&bytes[..count], b"READY=1");
        // Its queue holds some ten.
        (0..10_000).for_each(|_| ours.tell(Word::Alive));
    }

    #[test]
    fn names_of_the_abstract_namespace_are_understood() {
        let name = format!("plumbline-test-{}", std::process::id());
        let theirs = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        let ours = connect(OsStr::new(&format!("@{name}"))).unwrap();
        ours.send(b"WATCHDOG=1").unwrap();
        assert_eq!(theirs.recv(&mut [0; 64]).unwrap(), 10);
    }
}
