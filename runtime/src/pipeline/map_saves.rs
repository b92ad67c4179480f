//! Requests to keep the map of a flight that goes on, and what became of them.

use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;

/// What became of the last request: keyframes that were written, or why none were. `None` before the first.
pub type MapSaved = Option<Result<u32, String>>;

/// The desk between those who want the map kept and the one who writes it, from any thread.
#[derive(Debug, Default)]
pub struct MapSaves {
    is_open: AtomicBool,
    is_asked: AtomicBool,
    saved: watch::Sender<MapSaved>,
}

impl MapSaves {
    /// Accepts requests from now on: a thread that writes maps is running.
    pub fn open(&self) {
        self.is_open.store(true, Ordering::Relaxed);
    }

    /// Asks for the map; what becomes of it is the next change there. `None` when this flight keeps none.
    pub fn ask(&self) -> Option<watch::Receiver<MapSaved>> {
        if !self.is_open.load(Ordering::Relaxed) {
            return None;
        }
        let saved = self.saved.subscribe();
        self.is_asked.store(true, Ordering::Relaxed);
        Some(saved)
    }

    /// Whether the map was asked for since the last call.
    pub fn take(&self) -> bool {
        self.is_asked.swap(false, Ordering::Relaxed)
    }

    /// Tells those who asked: how many keyframes were written, or why none were.
    pub fn tell(&self, outcome: Result<u32, String>) {
        self.saved.send_replace(Some(outcome));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_can_ask_where_no_map_is_kept() {
        let saves = MapSaves::default();
        assert!(saves.ask().is_none());
        assert!(!saves.take());
    }

    #[test]
    fn a_request_is_taken_once_and_its_outcome_told() {
        let saves = MapSaves::default();
        saves.open();
        let told = saves.ask().unwrap();
        assert!(saves.take() && !saves.take());
        assert!(!told.has_changed().unwrap());
        saves.tell(Ok(7));
        assert!(told.has_changed().unwrap());
        assert_eq!(*told.borrow(), Some(Ok(7)));
        // Who asks again waits for another.
        assert!(!saves.ask().unwrap().has_changed().unwrap());
    }
}
