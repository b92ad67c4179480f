//! Requests to keep the map of a flight that goes on, and what became of them.

use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;

/// What became of the requests up to now.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapSaved {
    /// Saves so far, those that failed too.
    pub count: u32,
    /// Keyframes that the last one wrote, or why it wrote none.
    pub outcome: Option<Result<u32, String>>,
}

/// The desk between those who want the map kept and the one who writes it, from any thread.
#[derive(Debug, Default)]
pub struct MapSaves {
    is_open: AtomicBool,
    is_asked: AtomicBool,
    saved: watch::Sender<MapSaved>,
}

impl MapSaves {
    /// Somebody writes maps from now on.
    pub fn open(&self) {
        self.is_open.store(true, Ordering::Relaxed);
    }

    /// Asks for the map; what becomes of it is told there. `None` when this flight keeps none.
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
        self.saved.send_modify(|saved| {
            *saved = MapSaved { count: saved.count.wrapping_add(1), outcome: Some(outcome) };
        });
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
        let mut told = saves.ask().unwrap();
        assert!(saves.take() && !saves.take());
        saves.tell(Ok(7));
        assert_eq!(*told.borrow_and_update(), MapSaved { count: 1, outcome: Some(Ok(7)) });
    }
}
