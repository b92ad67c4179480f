//! One frame of the window: its state, and the inertial factor that leads to it.

use super::inertial_factor::InertialFactor;
use super::state::NavState;
use crate::geometry::exp_so3;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;

/// One frame of the window.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Stamp of the image on the IMU's axis.
    pub stamp: Timestamp,
    /// Time of the state: the stamp without the error that images show in it.
    pub taken: Timestamp,
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
    /// Reading of the gyroscope at the stamp, bias included, rad/s; where it did not measure, what it would have read.
    pub gyro_b: Vector3<f64>,
    /// Inertial factor from the frame before it in the window; `None` for the first, and where the prior holds it.
    pub inertial: Option<InertialFactor>,
}

impl Frame {
    /// The state at which Jacobians are evaluated, with or without first estimates.
    pub fn jacobian_state(&self, first_estimates: bool) -> &NavState {
        if self.in_prior && first_estimates { &self.linearization } else { &self.nav }
    }

    /// Angular rate of the body at the stamp, rad/s.
    pub fn rate_b(&self) -> Vector3<f64> {
        self.gyro_b - self.nav.bias_gyro
    }

    /// The pose at the stamp, where that is not the time of the state: some milliseconds away.
    pub fn pose_at_stamp(&self) -> Isometry3<f64> {
        if self.taken == self.stamp {
            return self.nav.pose_o_b();
        }
        let dt_s = self.stamp.seconds_since(self.taken);
        let rot_o_b = self.nav.rot_o_b * exp_so3(&(self.rate_b() * dt_s));
        let p_o_b = self.nav.p_o_b + self.nav.v_o_b * dt_s;
        Isometry3::from_parts(Translation3::from(p_o_b), UnitQuaternion::new_normalize(rot_o_b.into_inner()))
    }
}
