//! Board on which the thread of a sensor shows its state to other threads.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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

    /// Locked content: whole even after a panic elsewhere.
    fn locked(&self) -> MutexGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value that was shown last.
    pub(crate) fn read(&self) -> T {
        self.locked().clone()
    }

    /// Changes the value, even if it has to wait for a reader.
    pub(crate) fn change(&self, change: impl FnOnce(&mut T)) {
        change(&mut self.locked());
    }

    /// Shows a value unless somebody is reading at the moment; whether it did.
    pub(crate) fn show(&self, value: impl FnOnce() -> T) -> bool {
        let shown = self.0.try_lock().map(|mut shown| *shown = value());
        shown.is_ok()
    }
}
