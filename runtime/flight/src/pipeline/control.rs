//! Requests from outside of a run: stop it, reset the estimate, save the map.

use super::instants::Instants;
use super::map_saves::MapSaves;
use plumbline_estimator::ResetKind;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, OnceLock};

const NONE: u8 = 0;
const SOFT: u8 = 1;
const HARD: u8 = 2;

/// Requests to a run, from any thread; the newest of a kind counts.
#[derive(Debug, Default)]
pub struct Control {
    stop: Arc<AtomicBool>,
    reset: AtomicU8,
    map_saves: MapSaves,
    instants: OnceLock<Arc<Instants>>,
    has_given_up: AtomicBool,
    last_resort: Option<fn()>,
}

impl Control {
    /// A run that ends when `stop` is set.
    pub fn stopped_by(stop: Arc<AtomicBool>) -> Self {
        Self { stop, ..Self::default() }
    }

    /// Sets `last_resort`, which a run that cannot continue calls. It must end the process if the run does not end by
    /// itself: stalled threads cannot be joined.
    #[must_use]
    pub fn with_last_resort(self, last_resort: fn()) -> Self {
        Self { last_resort: Some(last_resort), ..self }
    }

    /// The run cannot go on: ends it, one way or the other.
    pub fn give_up(&self) {
        self.stop();
        if !self.has_given_up.swap(true, Ordering::Relaxed)
            && let Some(last_resort) = self.last_resort
        {
            last_resort();
        }
    }

    /// Asks the run to end.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// True if the run is to stop.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Requests to keep the map.
    pub fn map_saves(&self) -> &MapSaves {
        &self.map_saves
    }

    /// Makes a run that has not begun keep its last seconds, and returns where states at instants are asked for.
    pub fn keep_instants(&self) -> Arc<Instants> {
        Arc::clone(self.instants.get_or_init(Arc::default))
    }

    /// Entrance for requests of states at instants; `None` if the run does not keep its last seconds.
    pub fn instants(&self) -> Option<&Arc<Instants>> {
        self.instants.get()
    }

    /// Asks for a reset before the next frame.
    pub fn ask_reset(&self, kind: ResetKind) {
        let code = match kind {
            ResetKind::Soft => SOFT,
            ResetKind::Hard => HARD,
        };
        self.reset.store(code, Ordering::Relaxed);
    }

    /// The reset that was asked for since the last call.
    pub fn take_reset(&self) -> Option<ResetKind> {
        match self.reset.swap(NONE, Ordering::Relaxed) {
            SOFT => Some(ResetKind::Soft),
            HARD => Some(ResetKind::Hard),
            _ => None,
        }
    }
}
