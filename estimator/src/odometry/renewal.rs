//! Odometers that go on where another ended: after a fault of the program, or of the whole process.

use super::{Odometer, ResetReason};
use crate::estimate::Estimate;
use crate::window::state::NavState;
use plumbline_config::ValidSetup;

impl Odometer {
    /// Counts resets from `reset_counter` on. For an odometer that has seen no frame yet.
    pub fn count_resets_from(&mut self, reset_counter: u32) {
        (self.reset_counter, self.first_counter) = (reset_counter, reset_counter);
    }

    /// Begins anew with nothing of this odometer but its counts: what it holds cannot be trusted after a fault. A reset
    /// after the `newest` estimate, whose origin is the pose of `newest_pose`.
    pub fn renew(&mut self, setup: &ValidSetup, newest: Option<&Estimate>, newest_pose: Option<&Estimate>) {
        let reset_counter = newest.map_or(self.first_counter, |e| e.reset_counter).wrapping_add(1);
        let mut fresh = Self::new(setup);
        fresh.count_resets_from(reset_counter);
        fresh.frames = self.frames;
        fresh.keeps_steps = self.keeps_steps;
        fresh.reset_reason = Some(ResetReason::Fault);
        fresh.origin = newest_pose.map(nav_of).filter(NavState::is_finite);
        if let Some(nav) = &fresh.origin {
            fresh.bias_memory = (nav.bias_gyro, nav.bias_accel);
        }
        *self = fresh;
    }
}

fn nav_of(estimate: &Estimate) -> NavState {
    NavState {
        p_o_b: estimate.pose_o_b.translation.vector,
        rot_o_b: estimate.pose_o_b.rotation,
        v_o_b: estimate.v_o_b,
        bias_gyro: estimate.bias_gyro,
        bias_accel: estimate.bias_accel,
    }
}
