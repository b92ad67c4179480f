//! Poses that continue the odometry frame before them, and those that begin another.

use nalgebra::Isometry3;

/// Distance from the origin at which a vehicle that was just reset hard may be, m, and the time that it has moved since, s.
const NEAR_ORIGIN_M: f64 = 0.5;
const SINCE_RESET_S: f64 = 0.5;
/// Step of the pose over a soft reset near the origin that counts as none, m and rad.
const CONTINUED_M: f64 = 0.25;
const CONTINUED_RAD: f64 = 0.2;
/// Step of the pose over any soft reset, beside the motion meanwhile, m; and how much faster it may have become, m/s².
const RESUMED_M: f64 = 0.5;
const UNSEEN_ACCELERATION_M_S2: f64 = 2.0;

/// A valid pose.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    pub stamp_ns: i64,
    pub pose_o_b: Isometry3<f64>,
    pub speed_m_s: f64,
}

impl Motion {
    /// True if this pose, after a reset or a restart, lies in another odometry frame than `last` before it. A
    /// hard reset starts at the origin; a soft one continues from the last pose, so that the map stays valid.
    pub fn is_in_another_frame(&self, last: &Self) -> bool {
        if self.stamp_ns < last.stamp_ns {
            return true;
        }
        let dt_s = self.stamp_ns.saturating_sub(last.stamp_ns) as f64 * 1e-9;
        let way_m = (self.speed_m_s.max(last.speed_m_s) + UNSEEN_ACCELERATION_M_S2 * dt_s) * dt_s;
        let step = last.pose_o_b.inverse() * self.pose_o_b;
        let step_m = step.translation.vector.norm();
        let from_origin_m = self.pose_o_b.translation.vector.norm();
        let is_near_origin = from_origin_m < NEAR_ORIGIN_M + SINCE_RESET_S * self.speed_m_s;
        let is_continued = step_m <= CONTINUED_M && step.rotation.angle() <= CONTINUED_RAD;
        step_m > RESUMED_M + way_m || (is_near_origin && !is_continued)
    }
}
