//! Attitude of a vehicle as a pilot reads it: roll, pitch and heading.
//!
//! The angles are those of the vehicle frame `V` (x forward, y left, z up) relative to the odometry frame `O` (z up):
//! z-y-x Euler angles of the aerospace convention (forward, right, down), which MAVLink and every artificial horizon
//! use.

use nalgebra::{UnitQuaternion, Vector3};

/// Roll and heading are undefined for a nose this close to the vertical: sine of the angle.
const VERTICAL: f64 = 1e-6;

/// Roll, pitch and heading, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    /// Positive with the right wing down, -180 to 180.
    pub roll_deg: f64,
    /// Positive with the nose up, -90 to 90.
    pub pitch_deg: f64,
    /// Clockwise from above, 0 to 360; 0 where the nose points along x of `O`. It is not the bearing from north, which
    /// cameras and IMU cannot observe.
    pub heading_deg: f64,
}

impl Attitude {
    /// From the rotation that takes coordinates from `V` to `O`. A nose that points straight up or down has roll 0,
    /// and the heading that the wings have.
    pub fn of(rot_o_v: &UnitQuaternion<f64>) -> Self {
        let [forward_o, left_o, up_o] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| rot_o_v * axis);
        let horizontal = forward_o.xy().norm();
        let is_vertical = horizontal < VERTICAL;
        let (roll, heading) = if is_vertical {
            (0.0, left_o.x.atan2(left_o.y))
        } else {
            (left_o.z.atan2(up_o.z), (-forward_o.y).atan2(forward_o.x))
        };
        Self {
            roll_deg: roll.to_degrees(),
            // Near the vertical the arcsine of z alone would be inexact.
            pitch_deg: forward_o.z.atan2(horizontal).to_degrees(),
            // Rounding takes the smallest negative angles to 360; the sum takes the sign from a negative zero.
            heading_deg: heading.to_degrees().rem_euclid(360.0) % 360.0 + 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    /// The rotation of an attitude, from its definition: turn to the right, raise the nose, lower the right wing.
    fn rot_o_v(roll_deg: f64, pitch_deg: f64, heading_deg: f64) -> UnitQuaternion<f64> {
        let about = |axis, deg: f64| UnitQuaternion::from_axis_angle(&axis, deg.to_radians());
        about(Vector3::z_axis(), -heading_deg)
            * about(Vector3::y_axis(), -pitch_deg)
            * about(Vector3::x_axis(), roll_deg)
    }

    fn assert_near(a: Attitude, [roll_deg, pitch_deg, heading_deg]: [f64; 3]) {
        let turn = (a.heading_deg - heading_deg + 180.0).rem_euclid(360.0) - 180.0;
        let worst = [a.roll_deg - roll_deg, a.pitch_deg - pitch_deg, turn].map(f64::abs);
        assert!(worst.iter().all(|x| *x < 1e-6), "{a:?} against {roll_deg} {pitch_deg} {heading_deg}");
    }

    #[test]
    fn a_level_vehicle_that_looks_along_x_is_all_zero() {
        let level = Attitude::of(&UnitQuaternion::identity());
        assert_near(level, [0.0; 3]);
        assert!(level.heading_deg.is_sign_positive(), "it is shown as 000");
    }

    #[test]
    fn a_raised_nose_a_lowered_right_wing_and_a_turn_to_the_right_are_positive() {
        // By where the axes point, without any angle: columns are forward, left and up in O.
        let of = |forward: [f64; 3], left: [f64; 3], up: [f64; 3]| {
            let columns = [forward, left, up].map(Vector3::from);
            let axes = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&columns));
            Attitude::of(&UnitQuaternion::from_rotation_matrix(&axes))
        };
        let c = std::f64::consts::FRAC_1_SQRT_2;
        assert_near(of([c, 0.0, c], [0.0, 1.0, 0.0], [-c, 0.0, c]), [0.0, 45.0, 0.0]);
        assert_near(of([1.0, 0.0, 0.0], [0.0, c, c], [0.0, -c, c]), [45.0, 0.0, 0.0]);
        assert_near(of([0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]), [0.0, 0.0, 90.0]);
        assert_near(of([-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]), [0.0, 0.0, 180.0]);
        assert_near(of([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]), [180.0, 0.0, 0.0]);
    }

    #[test]
    fn a_nose_that_points_straight_up_or_down_has_the_heading_of_its_wings() {
        for pitch_deg in [90.0, -90.0] {
            assert_near(Attitude::of(&rot_o_v(0.0, pitch_deg, 70.0)), [0.0, pitch_deg, 70.0]);
        }
    }

    proptest! {
        #[test]
        fn every_attitude_is_read_as_it_was_made(
            roll in -179.9..179.9_f64, pitch in -89.9..89.9_f64, heading in 0.0..360.0_f64
        ) {
            let read = Attitude::of(&rot_o_v(roll, pitch, heading));
            prop_assert!((0.0..360.0).contains(&read.heading_deg));
            assert_near(read, [roll, pitch, heading]);
        }
    }
}
