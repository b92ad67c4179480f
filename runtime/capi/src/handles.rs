//! Handles: numbers that stand for objects of the library. A handle is never an address, and a number is never given
//! twice, so that one that was freed, or is of another type, is recognized without touching memory.

use crate::status::{CallFailure, Status};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

/// The next number; those of all types are different.
static NEXT: AtomicUsize = AtomicUsize::new(1);

/// Live objects of a type by their handles.
pub struct Registry<T>(Mutex<BTreeMap<usize, Arc<Mutex<T>>>>);

impl<T> Registry<T> {
    /// Empty registry.
    #[allow(clippy::new_without_default)]
    pub const fn new() -> Self {
        Self(Mutex::new(BTreeMap::new()))
    }

    fn objects(&self) -> MutexGuard<'_, BTreeMap<usize, Arc<Mutex<T>>>> {
        // Nothing panics while it is held.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an object; its handle.
    pub(crate) fn add(&self, object: T) -> usize {
        let handle = NEXT.fetch_add(1, Ordering::Relaxed);
        self.objects().insert(handle, Arc::new(Mutex::new(object)));
        handle
    }

    fn find(&self, handle: usize) -> Result<Arc<Mutex<T>>, CallFailure> {
        if handle == 0 {
            return Err(CallFailure::null("the handle"));
        }
        let unknown = "the handle was freed, is of another type, or never was one";
        self.objects().get(&handle).cloned().ok_or_else(|| CallFailure::new(Status::BadHandle, unknown))
    }

    /// Does `work` on the object of a handle, which no other thread may use meanwhile. Where it panics, the handle is
    /// poisoned.
    pub(crate) fn with<R>(
        &self,
        handle: usize,
        work: impl FnOnce(&mut T) -> Result<R, CallFailure>,
    ) -> Result<R, CallFailure> {
        let object = self.find(handle)?;
        let mut object = match object.try_lock() {
            Ok(object) => object,
            Err(TryLockError::WouldBlock) => return Err(busy()),
            Err(TryLockError::Poisoned(_)) => {
                let text = "an earlier call failed within the library; free the handle, and make another";
                return Err(CallFailure::new(Status::Poisoned, text));
            }
        };
        work(&mut object)
    }

    /// Frees the object of a handle, poisoned or not.
    pub(crate) fn free(&self, handle: usize) -> Result<(), CallFailure> {
        let object = self.find(handle)?;
        if let Err(TryLockError::WouldBlock) = object.try_lock() {
            return Err(busy());
        }
        // Its memory is given back when the registry is no longer locked.
        let _object = self.objects().remove(&handle);
        Ok(())
    }
}

fn busy() -> CallFailure {
    CallFailure::new(Status::Busy, "another thread uses the handle; use one for each thread, or take turns")
}
