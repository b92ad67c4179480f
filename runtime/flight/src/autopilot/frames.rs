//! From the estimator's frames to the autopilot's, covariance included.
//!
//! `O` is the odometry frame (z up, heading arbitrary), `B` the IMU, `V` the vehicle (x forward, y left, z up). The
//! autopilot's are `L` = LOCAL_FRD (x along the vehicle's nose at the first pose, y right, z down; the origin is
//! that of `O`) and `F` = BODY_FRD (x forward, y right, z down; the origin is that of the IMU: the lever arm is a
//! parameter of the autopilot).

use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3};
use plumbline_estimator::Odometry;
use std::f64::consts::PI;

/// A nose whose horizontal part is shorter than this has no heading.
const MIN_HORIZONTAL: f64 = 0.1;

/// Mounting of the IMU in the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleFrames {
    rot_f_b: UnitQuaternion<f64>,
}

/// Odometry in the autopilot's frames.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleOdometry {
    /// Pose of the vehicle in LOCAL_FRD.
    pub pose_l_f: Isometry3<f64>,
    /// Velocity of the vehicle against LOCAL_FRD, in BODY_FRD, m/s.
    pub v_f: Vector3<f64>,
    /// Angular rate, in BODY_FRD, rad/s.
    pub angular_rate_f: Vector3<f64>,
    /// Covariance of position, m², and of a small rotation about the axes of LOCAL_FRD, rad² (the fixed-axis
    /// convention of ROS; level, they are roll, pitch and yaw for a vehicle that heads along x).
    pub pose_covariance: Matrix6<f64>,
    /// Covariance of [`Self::v_f`], (m/s)².
    pub velocity_covariance: Matrix3<f64>,
}

impl VehicleFrames {
    /// Frames of an IMU whose axes `rot_v_b` takes to those of the vehicle.
    pub fn new(rot_v_b: &UnitQuaternion<f64>) -> Self {
        Self { rot_f_b: half_turn_about_x() * rot_v_b }
    }

    /// The rotation from `O` to LOCAL_FRD that makes the nose of this pose point along x; one whose nose
    /// points straight up or down keeps the heading of `O`.
    pub fn local_frame(&self, first_pose_o_b: &Isometry3<f64>) -> UnitQuaternion<f64> {
        let nose_o = first_pose_o_b.rotation * (self.rot_f_b.inverse() * Vector3::x());
        let horizontal = nose_o.xy().norm();
        let heading = if horizontal < MIN_HORIZONTAL { 0.0 } else { nose_o.y.atan2(nose_o.x) };
        half_turn_about_x() * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -heading)
    }

    /// `odometry` in the frames of the autopilot. The covariance is that since the last reset: the autopilot is informed of
    /// resets, and takes the pose after one for its new reference.
    pub fn convert(&self, odometry: &Odometry, rot_l_o: &UnitQuaternion<f64>) -> VehicleOdometry {
        let rot_o_b = odometry.pose_o_b.rotation;
        let v_b = rot_o_b.inverse() * odometry.v_o_b;
        let pose_l_f = Isometry3::from_parts(
            Translation3::from(rot_l_o * odometry.pose_o_b.translation.vector),
            rot_l_o * rot_o_b * self.rot_f_b.inverse(),
        );
        // Position turns with the frame. The attitude error, Exp on the right of rot_o_b, becomes one on its
        // left. The velocity in the body depends on attitude and velocity, whose errors belong together.
        let mut pose = SMatrix::<f64, 6, 9>::zeros();
        pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&matrix(rot_l_o));
        pose.fixed_view_mut::<3, 3>(3, 3).copy_from(&matrix(&(rot_l_o * rot_o_b)));
        let covariance = odometry.covariance_since_reset();
        let rot_f_b = matrix(&self.rot_f_b);
        let mut velocity = SMatrix::<f64, 3, 9>::zeros();
        velocity.fixed_view_mut::<3, 3>(0, 3).copy_from(&(rot_f_b * v_b.cross_matrix()));
        velocity.fixed_view_mut::<3, 3>(0, 6).copy_from(&(rot_f_b * matrix(&rot_o_b.inverse())));
        VehicleOdometry {
            pose_l_f,
            v_f: self.rot_f_b * v_b,
            angular_rate_f: self.rot_f_b * odometry.angular_rate_b,
            pose_covariance: pose * covariance * pose.transpose(),
            velocity_covariance: velocity * covariance * velocity.transpose(),
        }
    }
}

impl VehicleOdometry {
    /// True if every number is one.
    pub fn is_finite(&self) -> bool {
        let pose = self.pose_l_f.translation.vector.iter().chain(self.pose_l_f.rotation.coords.iter());
        let rates = self.v_f.iter().chain(self.angular_rate_f.iter());
        let covariances = self.pose_covariance.iter().chain(self.velocity_covariance.iter());
        pose.chain(rates).chain(covariances).all(|x| x.is_finite())
    }
}

/// Between x forward, y left, z up and x forward, y right, z down; its own inverse.
pub(super) fn half_turn_about_x() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI)
}

fn matrix(rotation: &UnitQuaternion<f64>) -> Matrix3<f64> {
    rotation.to_rotation_matrix().into_inner()
}

#[cfg(test)]
mod tests {
    use super::super::fixture::odometry;
    use super::*;
    use plumbline_config::options::VehicleConfig;
    use plumbline_estimator::NavCovariance;

    fn mounted(imu_to_vehicle_deg: [f64; 3]) -> VehicleFrames {
        VehicleFrames::new(&VehicleConfig::mounted(imu_to_vehicle_deg).rot_v_b().unwrap())
    }

    fn level_pose(heading: f64) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(1.0, 2.0, 3.0),
            UnitQuaternion::from_euler_angles(0.0, 0.0, heading),
        )
    }

    fn assert_near(a: &Vector3<f64>, b: [f64; 3]) {
        assert!((a - Vector3::from(b)).norm() < 1e-12, "{a} against {b:?}");
    }

    #[test]
    fn an_imu_with_x_forward_y_left_z_up_only_changes_signs() {
        let frames = mounted([0.0; 3]);
        let mut o = odometry();
        o.pose_o_b = level_pose(0.0);
        o.v_o_b = Vector3::new(0.1, 0.2, 0.3);
        o.angular_rate_b = Vector3::new(1.0, 2.0, 3.0);
        let v = frames.convert(&o, &frames.local_frame(&o.pose_o_b));
        assert_near(&v.pose_l_f.translation.vector, [1.0, -2.0, -3.0]);
        assert_near(&v.v_f, [0.1, -0.2, -0.3]);
        assert_near(&v.angular_rate_f, [1.0, -2.0, -3.0]);
        assert!(v.pose_l_f.rotation.angle() < 1e-12);
    }

    #[test]
    fn a_vehicle_that_turned_left_has_a_negative_yaw_and_its_velocity_in_its_own_axes() {
        let frames = mounted([0.0; 3]);
        let mut o = odometry();
        o.pose_o_b = level_pose(PI / 2.0);
        o.v_o_b = Vector3::new(0.0, 2.0, 0.0);
        let v = frames.convert(&o, &frames.local_frame(&Isometry3::identity()));
        assert!((v.pose_l_f.rotation.euler_angles().2 + PI / 2.0).abs() < 1e-12);
        assert_near(&v.v_f, [2.0, 0.0, 0.0]);
    }

    #[test]
    fn the_first_nose_is_the_x_of_the_local_frame() {
        let frames = mounted([0.0; 3]);
        let mut o = odometry();
        o.pose_o_b = level_pose(1.2);
        let rot_l_o = frames.local_frame(&o.pose_o_b);
        assert!(frames.convert(&o, &rot_l_o).pose_l_f.rotation.angle() < 1e-12);
        assert_near(&(rot_l_o * Vector3::z()), [0.0, 0.0, -1.0]);
        // A nose that points up has no heading.
        let up = Isometry3::rotation(Vector3::new(0.0, -PI / 2.0, 0.0));
        assert_near(&(frames.local_frame(&up) * Vector3::x()), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn the_imu_of_the_data_sets_has_x_up_y_right_z_forward() {
        let frames = mounted([180.0, -90.0, 0.0]);
        for (axis_b, axis_v) in [
            (Vector3::x(), [0.0, 0.0, -1.0]),
            (Vector3::y(), [0.0, 1.0, 0.0]),
            (Vector3::z(), [1.0, 0.0, 0.0]),
        ] {
            assert_near(&(frames.rot_f_b * axis_b), axis_v);
        }
    }

    #[test]
    fn signs_of_the_vehicle_mounting_are_those_of_the_right_hand_about_forward_left_up() {
        // Turned left by a right angle, the IMU's x points left.
        assert_near(&(mounted([0.0, 0.0, 90.0]).rot_f_b * Vector3::x()), [0.0, -1.0, 0.0]);
        // Pitched down by a right angle (right hand about left), the IMU's x points down.
        assert_near(&(mounted([0.0, 90.0, 0.0]).rot_f_b * Vector3::x()), [0.0, 0.0, 1.0]);
        // Rolled right by a right angle, the IMU's y points up.
        assert_near(&(mounted([90.0, 0.0, 0.0]).rot_f_b * Vector3::y()), [0.0, 0.0, -1.0]);
    }

    #[test]
    fn what_was_not_known_before_a_reset_does_not_count() {
        let frames = mounted([20.0, -35.0, 110.0]);
        let mut o = odometry();
        let rot_l_o = frames.local_frame(&level_pose(0.7));
        let known = frames.convert(&o, &rot_l_o);
        o.origin.covariance = nalgebra::Matrix4::from_diagonal(&nalgebra::Vector4::new(49.0, 49.0, 9.0, 6.0));
        let (rot, p) = (o.pose_o_b.rotation, o.pose_o_b.translation.vector);
        o.covariance += o.origin.share(&p, &rot, &o.v_o_b).unwrap();
        let told = frames.convert(&o, &rot_l_o);
        assert!((told.pose_covariance - known.pose_covariance).norm() < 1e-9);
        assert!((told.velocity_covariance - known.velocity_covariance).norm() < 1e-9);
    }

    /// The state moved by an error of position, attitude (right perturbation) and velocity.
    fn moved(o: &Odometry, error: &SMatrix<f64, 9, 1>) -> Odometry {
        let part = |k: usize| Vector3::new(error[k], error[k + 1], error[k + 2]);
        let mut moved = o.clone();
        moved.pose_o_b.translation.vector += part(0);
        moved.pose_o_b.rotation *= UnitQuaternion::from_scaled_axis(part(3));
        moved.v_o_b += part(6);
        moved
    }

    #[test]
    fn covariances_are_those_of_the_numeric_jacobian() {
        let frames = mounted([20.0, -35.0, 110.0]);
        let o = odometry();
        let rot_l_o = frames.local_frame(&level_pose(0.7));
        let at = frames.convert(&o, &rot_l_o);
        let h = 1e-6;
        let mut jacobian = SMatrix::<f64, 9, 9>::zeros();
        for k in 0..9 {
            let mut error = SMatrix::<f64, 9, 1>::zeros();
            error[k] = h;
            let (plus, minus) =
                (frames.convert(&moved(&o, &error), &rot_l_o), frames.convert(&moved(&o, &-error), &rot_l_o));
            let position = plus.pose_l_f.translation.vector - minus.pose_l_f.translation.vector;
            let rotation = plus.pose_l_f.rotation * minus.pose_l_f.rotation.inverse();
            jacobian.fixed_view_mut::<3, 1>(0, k).copy_from(&(position / (2.0 * h)));
            jacobian.fixed_view_mut::<3, 1>(3, k).copy_from(&(rotation.scaled_axis() / (2.0 * h)));
            jacobian.fixed_view_mut::<3, 1>(6, k).copy_from(&((plus.v_f - minus.v_f) / (2.0 * h)));
        }
        let expected: NavCovariance = jacobian * o.covariance * jacobian.transpose();
        let pose_error = at.pose_covariance - expected.fixed_view::<6, 6>(0, 0);
        let velocity_error = at.velocity_covariance - expected.fixed_view::<3, 3>(6, 6);
        assert!(pose_error.norm() < 1e-6 * at.pose_covariance.norm(), "{pose_error}");
        assert!(velocity_error.norm() < 1e-6 * at.velocity_covariance.norm(), "{velocity_error}");
    }
}
