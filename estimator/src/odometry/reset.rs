//! Starts anew, and odometers that go on where another ended: after a fault of the program, or of the whole process.

use super::{Odometer, Phase, ResetReason};
use crate::estimate::Estimate;
use crate::inertial::buffer::IMU_MEMORY_S;
use crate::input::ResetKind;
use crate::window::state::NavState;
use plumbline_config::{Timestamp, ValidSetup};

impl Odometer {
    /// Starts anew. Soft: from the newest pose that can be right, with its biases and calibration. Hard: from the origin,
    /// with the calibration as configured.
    pub fn reset(&mut self, kind: ResetKind) {
        let stated = self.judge.stated_covariance(&self.estimation);
        self.start.prepare(&mut self.estimation, stated, kind);
        self.phase = Phase::Gathering;
        self.estimation.window.clear();
        self.estimation.measurer.clear();
        self.estimation.imu.trust();
        self.zero_velocity.clear();
        self.judge.clear(&mut self.estimation, kind);
        if kind == ResetKind::Hard {
            self.forget_time();
        }
    }

    /// Starts anew, and says why.
    pub(super) fn start_anew(&mut self, reason: ResetReason) {
        self.reset(reason.kind());
        self.start.reset_reason = Some(reason);
    }

    /// Forgets all stamps: those that come have nothing to do with them.
    pub(super) fn forget_time(&mut self) {
        self.estimation.imu.clear();
        self.judge.forget_time();
        self.start.forget_time();
        self.last = None;
    }

    /// Gives up a state that the inertial samples do not lead on from: they are kept for [`IMU_MEMORY_S`].
    pub(super) fn check_hole(&mut self, stamp: Timestamp) {
        let hole_s = self.last.map_or(0.0, |last| stamp.seconds_since(last.stamp));
        if hole_s > IMU_MEMORY_S && self.phase == Phase::Running {
            self.start_anew(ResetReason::Hole(hole_s));
            self.judge.note_reset(stamp);
        }
    }

    /// Counts resets from `reset_counter` on. For an odometer that has seen no frame yet.
    pub fn count_resets_from(&mut self, reset_counter: u32) {
        (self.start.reset_counter, self.start.first_counter) = (reset_counter, reset_counter);
    }

    /// Begins anew with nothing of this odometer but its counts: what it holds cannot be trusted after a fault. A reset
    /// after the `newest` estimate, whose origin is the pose of `newest_pose`.
    pub fn renew(&mut self, setup: &ValidSetup, newest: Option<&Estimate>, newest_pose: Option<&Estimate>) {
        let before = newest.map_or(self.start.first_counter, |e| e.reset_counter);
        let mut fresh = Self::new(setup);
        fresh.frames = self.frames;
        fresh.keeps_steps = self.keeps_steps;
        fresh.count_resets_from(before.wrapping_add(1));
        fresh.start.go_on_from(newest_pose.map(NavState::of).filter(NavState::is_finite));
        fresh.start.reset_reason = Some(ResetReason::Fault);
        *self = fresh;
    }
}
