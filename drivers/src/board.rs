//! Board on which the thread of a sensor shows its state to other threads.

use parking_lot::Mutex;
use std::sync::Arc;

/// A value that one thread shows and any may read. Copies show the same.
#[derive(Debug, Default)]
pub(crate) struct Board<T>(Arc<Mutex<T>>);

impl<T> Clone for Board<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T: Clone> Board<T> {
    pub(crate) fn new(value: T) -> Self {
        Self(Arc::new(Mutex::new(value)))
    }

    /// The value that was shown last.
    pub(crate) fn read(&self) -> T {
        self.0.lock().clone()
    }

    /// Changes the value, even if it has to wait for a reader.
    pub(crate) fn change(&self, change: impl FnOnce(&mut T)) {
        change(&mut self.0.lock());
    }

    /// Shows a value unless somebody is reading at the moment; whether it did.
    pub(crate) fn show(&self, value: impl FnOnce() -> T) -> bool {
        self.0.try_lock().map(|mut shown| *shown = value()).is_some()
    }
}
