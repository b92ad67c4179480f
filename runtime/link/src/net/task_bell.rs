//! Wakes a task of Tokio from another thread.
//!
//! Tokio's own means take its locks; ringing an [`EventBell`] takes none, and the task waits for it as for any file.

use plumbline_rings::event_bell::EventBell;
use std::io;
use tokio::io::unix::AsyncFd;

/// The end that rings.
#[derive(Debug)]
pub struct TaskBell(EventBell);

impl TaskBell {
    /// Creates a bell; it remembers that it was rung.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new() -> io::Result<Self> {
        EventBell::new().map(Self)
    }

    /// Wakes the task, from any thread. Neither waits nor allocates.
    pub fn ring(&self) {
        self.0.ring();
    }

    /// The waiting end; to be made within the runtime of the task.
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

/// The waiting end of the bell.
#[derive(Debug)]
pub struct BellListener(AsyncFd<EventBell>);

impl BellListener {
    /// Waits until the bell has been rung since the last time. May be given up at any time.
    pub async fn rung(&self) {
        loop {
            // Fails only when the runtime ends, and the task with it.
            let Ok(mut ready) = self.0.readable().await else { return std::future::pending().await };
            let was_rung = self.0.get_ref().silence();
            ready.clear_ready();
            // The runtime may wake the task once more for a ring that was taken already.
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
