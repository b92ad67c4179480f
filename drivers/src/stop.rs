//! Request to stop a source that waits for a device.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks live sources to end. A source that was given one at its construction ends its stream (`Ok(None)`, `Ok(false)`)
/// within [`StopFlag::PATIENCE_MS`] after [`StopFlag::stop`], whether its device is there, silent or gone.
///
/// Clones are one flag: the run keeps one, every source has another.
#[derive(Clone, Debug, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// The longest that a source waits without a look at its flag, ms.
    pub const PATIENCE_MS: u32 = 50;

    /// A flag that is not set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Wraps a flag that is set elsewhere, such as by a signal handler.
    pub fn of(flag: Arc<AtomicBool>) -> Self {
        Self(flag)
    }

    /// Asks every holder to end.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// True once a stop was requested.
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}
