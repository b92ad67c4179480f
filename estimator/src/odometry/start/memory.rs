//! The newest states that were believed, for starts anew.
//!
//! A divergence is seen late: when a speed passes its bound, the states of the last second are wrong as well. So a state
//! counts only once it has stood for a while, and the start after a divergence goes on from there.

use crate::window::state::{NavState, Rig};
use plumbline_config::Timestamp;

/// A state counts once it has stood for so long, s: an accelerometer that is wrong by its whole range drives the speed past
/// any bound within a fraction of that.
const PROOF_S: f64 = 1.0;

/// A state that was believed, and the calibration it rests on.
#[derive(Clone, Debug)]
pub(super) struct Believed {
    stamp: Timestamp,
    pub(super) nav: NavState,
    pub(super) rig: Rig,
}

/// Two states that were believed, [`PROOF_S`] or more apart: with a frame each, the older one is one to two seconds old.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    older: Option<Believed>,
    newer: Option<Believed>,
}

impl Memory {
    /// Keeps a state that is believed, if the last one kept is old enough.
    pub(super) fn remember(&mut self, stamp: Timestamp, nav: &NavState, rig: &Rig) {
        if self.newer.as_ref().is_none_or(|newer| stamp.seconds_since(newer.stamp) >= PROOF_S) {
            self.older = self.newer.replace(Believed { stamp, nav: nav.clone(), rig: rig.clone() });
        }
    }

    /// The state that has stood long enough; the only one there is, right after a start. The memory is empty afterwards.
    pub(super) fn take(&mut self) -> Option<Believed> {
        let newer = self.newer.take();
        self.older.take().or(newer)
    }
}
