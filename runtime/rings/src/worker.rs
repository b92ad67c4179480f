//! A thread that ends with its owner.

use std::fmt;
use std::io::Result;
use std::thread::{Builder, JoinHandle};

/// A thread that is told to stop, and waited for, when this is dropped.
pub struct Worker<T = ()> {
    thread: Option<JoinHandle<T>>,
    stop: Box<dyn Fn() + Send + Sync>,
}

impl<T: Send + 'static> Worker<T> {
    /// Starts a thread of this name that does `work`, and that `stop` tells to end.
    ///
    /// # Errors
    /// When the system refuses it.
    pub fn start(
        name: &str,
        stop: impl Fn() + Send + Sync + 'static,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<Self> {
        Ok(Self { thread: Some(Builder::new().name(name.into()).spawn(work)?), stop: Box::new(stop) })
    }
}

impl<T> Worker<T> {
    /// Ends the thread: its result, or `None` after a fault of its own. Once only.
    pub fn end(&mut self) -> Option<T> {
        let thread = self.thread.take()?;
        (self.stop)();
        thread.join().ok()
    }
}

impl<T> Drop for Worker<T> {
    fn drop(&mut self) {
        self.end();
    }
}

impl<T> fmt::Debug for Worker<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Worker").finish_non_exhaustive()
    }
}
