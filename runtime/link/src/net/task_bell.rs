//! Wakes a task of Tokio from a thread of a run.
//!
//! Tokio's own means take its locks, which a thread of normal priority may hold when a tick interrupts it. This is a
//! counter of the kernel (`eventfd`): ringing is one system call that waits for nobody, and the task waits for the
//! counter as for any file.

use rustix::event::{EventfdFlags, eventfd};
use rustix::io::Errno;
use std::io;
use std::os::fd::OwnedFd;
use tokio::io::unix::AsyncFd;

/// The end that rings.
#[derive(Debug)]
pub struct TaskBell(OwnedFd);

impl TaskBell {
    /// A bell that nobody hears yet; it remembers that it was rung.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new() -> io::Result<Self> {
        Ok(Self(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?))
    }

    /// Wakes the task, from any thread. Neither waits nor allocates.
    pub fn ring(&self) {
        // Fails only when the count is at its limit: then the task has not heard the rings before either.
        let _ = rustix::io::write(&self.0, &1u64.to_ne_bytes());
    }

    /// The end that hears it; to be made within the runtime of the task.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn listen(&self) -> io::Result<BellListener> {
        let ours = self.0.try_clone()?;
        // Deprecated for the sake of types that may give another descriptor from call to call; this one cannot.
        #[allow(deprecated)]
        AsyncFd::new(ours).map(BellListener)
    }
}

/// The end that hears the bell.
#[derive(Debug)]
pub struct BellListener(AsyncFd<OwnedFd>);

impl BellListener {
    /// Waits until the bell has been rung since the last time. May be given up at any time.
    pub async fn rung(&self) {
        loop {
            // Fails only when the runtime ends, and the task with it.
            let Ok(mut ready) = self.0.readable().await else { return std::future::pending().await };
            let was_rung = rustix::io::read(self.0.get_ref(), &mut [0; 8]) != Err(Errno::AGAIN);
            ready.clear_ready();
            // The runtime may tell of a ring once more that has been heard already.
            if was_rung {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_task_hears_what_was_rung_before_and_from_another_thread_and_then_waits() {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let bell = TaskBell::new().unwrap();
        bell.ring();
        bell.ring();
        runtime.unwrap().block_on(async {
            let patience = Duration::from_secs(10);
            let listener = bell.listen().unwrap();
            tokio::time::timeout(patience, listener.rung()).await.unwrap();
            assert!(tokio::time::timeout(Duration::from_millis(30), listener.rung()).await.is_err());
            std::thread::scope(|scope| scope.spawn(|| bell.ring()).join()).unwrap();
            tokio::time::timeout(patience, listener.rung()).await.unwrap();
        });
    }
}
