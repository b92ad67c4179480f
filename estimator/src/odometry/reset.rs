//! Starts anew, and what they go by: the newest states that were believed.
//!
//! A divergence is seen late: when a speed passes its bound, the states of the last second are wrong as well. So a state
//! counts only once it has stood for a while, and the start after a divergence goes on from there.

use super::judgement::MIN_LANDMARKS_IN_VIEW;
use super::scale_watch::ScaleWatch;
use super::stilled_force::StilledForce;
use super::sudden_force::SuddenForce;
use super::{Odometer, Phase, ResetReason};
use crate::inertial::buffer::IMU_MEMORY_S;
use crate::input::ResetKind;
use crate::window::state::{NavState, Rig};
use nalgebra::Vector3;
use plumbline_config::Timestamp;

/// A state counts once it has stood for so long, s: an accelerometer that is wrong by its whole range drives the speed past
/// any bound within a fraction of that.
const PROOF_S: f64 = 1.0;

/// A state that was believed, and the calibration it rests on.
#[derive(Clone, Debug)]
struct Believed {
    stamp: Timestamp,
    nav: NavState,
    rig: Rig,
}

/// Two states that were believed, [`PROOF_S`] or more apart: with a frame each, the older one is one to two seconds old.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    older: Option<Believed>,
    newer: Option<Believed>,
}

impl Memory {
    /// Keeps a state that is believed, if the last one kept is old enough.
    fn remember(&mut self, stamp: Timestamp, nav: &NavState, rig: &Rig) {
        if self.newer.as_ref().is_none_or(|newer| stamp.seconds_since(newer.stamp) >= PROOF_S) {
            self.older = self.newer.replace(Believed { stamp, nav: nav.clone(), rig: rig.clone() });
        }
    }

    /// The state that has stood long enough; the only one there is, right after a start. The memory is empty afterwards.
    fn take(&mut self) -> Option<Believed> {
        let newer = self.newer.take();
        self.older.take().or(newer)
    }
}

impl Odometer {
    /// Starts anew. Soft: from the newest pose that can be right, with its biases and calibration. Hard: from the origin,
    /// with the calibration as configured.
    pub fn reset(&mut self, kind: ResetKind) {
        self.bequeath(kind);
        self.prepare_start(kind);
        self.phase = Phase::Gathering;
        self.window.clear();
        self.noise_scale.forget_state();
        self.gathering.clear();
        self.measurer.clear();
        self.zero_velocity.clear();
        self.rotation.forget_turns();
        self.forces.clear();
        self.sudden_force = SuddenForce::new();
        self.stilled_force = StilledForce::new();
        self.pair_time.wait_anew();
        self.imu.trust();
        self.reset_counter += 1;
        if kind == ResetKind::Hard {
            self.forget_time();
            self.pair_time.clear();
            self.pair_shift.clear();
            self.scale = ScaleWatch::default();
        }
    }

    /// Starts anew, and says why.
    pub(super) fn start_anew(&mut self, reason: ResetReason) {
        self.reset(reason.kind());
        self.reset_reason = Some(reason);
    }

    /// Forgets all stamps: those that come have nothing to do with them.
    pub(super) fn forget_time(&mut self) {
        self.imu.clear();
        self.rotation.clear();
        (self.last_stamp, self.last_seen, self.last_reset) = (None, None, None);
        self.carried = None;
    }

    /// Gives up a state that the inertial samples do not lead on from: they are kept for [`IMU_MEMORY_S`].
    pub(super) fn check_hole(&mut self, stamp: Timestamp) {
        let hole_s = self.last_stamp.map_or(0.0, |last| stamp.seconds_since(last));
        if hole_s > IMU_MEMORY_S && self.phase == Phase::Running {
            self.start_anew(ResetReason::Hole(hole_s));
            self.last_reset = Some(stamp);
        }
    }

    /// Keeps the newest state, which was solved for, if it rests on landmarks.
    pub(super) fn remember(&mut self, stamp: Timestamp) {
        if self.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW
            && let Some(newest) = self.window.frames.last()
        {
            self.memory.remember(stamp, &newest.nav, &self.window.rig);
        }
    }

    /// Sets what the start after a reset goes by: pose, biases and calibration. Softly they are those of the newest state; of
    /// the last one that had proved itself where the newest cannot be right; of the last start where there is none. A
    /// hard reset forgets them.
    fn prepare_start(&mut self, kind: ResetKind) {
        let proven = self.memory.take();
        if kind == ResetKind::Hard {
            (self.origin, self.carried) = (None, None);
            self.bias_memory = (Vector3::zeros(), Vector3::zeros());
            self.window.restore_rig();
            return;
        }
        let Some(newest) = self.window.frames.last() else { return };
        let is_plausible = self.is_plausible();
        self.carried = if is_plausible { self.carried_of_newest() } else { None };
        let nav = if is_plausible {
            let nav = newest.nav.clone();
            self.window.keep_rig();
            nav
        } else if let Some(believed) = proven {
            self.window.rig = believed.rig;
            believed.nav
        } else {
            self.window.restore_rig();
            return;
        };
        self.bias_memory = (nav.bias_gyro, nav.bias_accel);
        self.origin = Some(nav);
    }
}
