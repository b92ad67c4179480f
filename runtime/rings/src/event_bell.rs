//! Wakes a thread or task that waits for file descriptors.
//!
//! A counter of the kernel (`eventfd`): ringing is one system call that waits for no lock, so that a thread of high
//! priority may do it, and the counter is waited for beside sockets.

use rustix::event::{EventfdFlags, eventfd};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::io::Errno;
use std::io;

/// Both ends of the bell; it remembers that it was rung.
#[derive(Debug)]
pub struct EventBell(OwnedFd);

impl EventBell {
    /// Creates a bell that is silent.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new() -> io::Result<Self> {
        Ok(Self(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?))
    }

    /// Wakes the waiting end, from any thread. Neither waits nor allocates.
    pub fn ring(&self) {
        // Fails only when the count is at its limit: then the bell has been rung already.
        let _ = rustix::io::write(&self.0, &1u64.to_ne_bytes());
    }

    /// Silences the bell; returns whether it had been rung.
    pub fn silence(&self) -> bool {
        rustix::io::read(&self.0, &mut [0; 8]) != Err(Errno::AGAIN)
    }
}

impl AsFd for EventBell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bell_remembers_that_it_was_rung_until_it_is_silenced() {
        let bell = EventBell::new().unwrap();
        assert!(!bell.silence());
        bell.ring();
        bell.ring();
        assert!(bell.silence());
        assert!(!bell.silence());
    }
}
