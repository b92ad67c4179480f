//! One frame of the window: its state, and the inertial factor that leads to it.

use super::inertial_factor::InertialFactor;
use super::state::NavState;
use plumbline_config::Timestamp;

/// One frame of the window.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Time of the state on the IMU's axis.
    pub stamp: Timestamp,
    /// The time offset by which `stamp` was made from the image's stamp, s.
    pub time_offset_s: f64,
    /// Present estimate.
    pub nav: NavState,
    /// Where Jacobians are evaluated once the frame is in the prior (first estimates).
    pub linearization: NavState,
    /// True if the prior holds information about this frame.
    pub in_prior: bool,
    /// True if the frame is kept for its view.
    pub is_keyframe: bool,
    /// The vehicle was at rest here: its velocity gets a zero-velocity update.
    pub is_still: bool,
    /// Inertial factor from the frame before it in the window; `None` for the first, and where the prior holds it.
    pub inertial: Option<InertialFactor>,
}

impl Frame {
    /// The state at which Jacobians are evaluated, with or without first estimates.
    #[must_use]
    pub fn jacobian_state(&self, first_estimates: bool) -> &NavState {
        if self.in_prior && first_estimates { &self.linearization } else { &self.nav }
    }
}
