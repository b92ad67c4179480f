//! A start with two cameras: the tilt from the accelerometer, everything else from the window's solver.
//!
//! The baseline gives depth in the first frame, so the relative poses of a few frames follow from the
//! window's cost by itself; velocity, gravity and biases with them. The tilt taken from the mean specific
//! force is off by the vehicle's acceleration; the solver corrects it.

use crate::geometry::{rotation_between, yaw_of};
use nalgebra::{UnitQuaternion, Vector3};

/// The attitude with zero yaw in which the specific force `accel_b` points up.
#[must_use]
pub fn attitude_from_gravity(accel_b: &Vector3<f64>) -> UnitQuaternion<f64> {
    let tilt = rotation_between(accel_b, &Vector3::z());
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw_of(&tilt));
    yaw * tilt
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_rest_the_specific_force_points_up_and_yaw_is_zero() {
        let accel_b = Vector3::new(9.1, 0.2, -3.6);
        let rot_o_b = attitude_from_gravity(&accel_b);
        let up = rot_o_b * accel_b;
        assert!((up - Vector3::z() * accel_b.norm()).norm() < 1e-9);
        assert!(yaw_of(&rot_o_b).abs() < 1e-12);
    }
}
