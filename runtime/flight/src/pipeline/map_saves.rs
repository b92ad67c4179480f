//! Requests to keep the map of a flight that goes on, and what became of them.

use parking_lot::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Result of the last request: keyframes that were written, or the reason why none were. `None` before the first.
pub type MapSaveResult = Option<Result<u32, String>>;

/// A request to keep the map: how often it had been kept before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapRequest(u64);

/// The desk between those who want the map kept and the one who writes it, from any thread.
#[derive(Debug, Default)]
pub struct MapSaves {
    is_open: AtomicBool,
    is_asked: AtomicBool,
    /// Number of requests that have ended, and the result of the last.
    saved: Mutex<(u64, MapSaveResult)>,
}

impl MapSaves {
    /// Accepts requests from now on: a thread that writes maps is running.
    pub fn open(&self) {
        self.is_open.store(true, Ordering::Relaxed);
    }

    /// Asks for the map; [`Self::outcome`] has what becomes of it. `None` when this flight keeps none.
    pub fn ask(&self) -> Option<MapRequest> {
        if !self.is_open.load(Ordering::Relaxed) {
            return None;
        }
        let request = MapRequest(self.saved.lock().0);
        self.is_asked.store(true, Ordering::Relaxed);
        Some(request)
    }

    /// Result of a request: `None` until it has ended. Does not wait.
    pub fn outcome(&self, request: MapRequest) -> MapSaveResult {
        let saved = self.saved.lock();
        if saved.0 == request.0 { None } else { saved.1.clone() }
    }

    /// True if the map was requested since the last call.
    pub fn take(&self) -> bool {
        self.is_asked.swap(false, Ordering::Relaxed)
    }

    /// Tells those who asked: how many keyframes were written, or why none were.
    pub fn tell(&self, outcome: Result<u32, String>) {
        let mut saved = self.saved.lock();
        *saved = (saved.0 + 1, Some(outcome));
    }
}
