//! Covariances as ROS means them.
//!
//! A pose's is about the **axes of the header's frame** (`geometry_msgs/PoseWithCovariance`: "fixed axes"), ours of the
//! attitude is about those of the body. A twist's is in the child frame, our velocity is in the odometry frame.

use nalgebra::{Matrix3, Matrix6, SMatrix, UnitQuaternion, Vector3};
use plumbline_estimator::NavCovariance;

/// Covariance of position and of the rotation about the axes of `O`: `dtheta_o = R dtheta_b`.
pub(super) fn pose_covariance_o(rot_o_b: &UnitQuaternion<f64>, covariance: &NavCovariance) -> Matrix6<f64> {
    let mut jacobian = Matrix6::identity();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(rot_o_b.to_rotation_matrix().matrix());
    let own = covariance.fixed_view::<6, 6>(0, 0);
    jacobian * own * jacobian.transpose()
}

/// Covariance of the velocity in `B` and of the angular rate. `v_b = Rᵀ v_o` changes with velocity and attitude
/// by `Rᵀ dv_o + [v_b]x dtheta_b`; so an uncertain heading, which no velocity in the body depends on, drops out.
pub(super) fn twist_covariance_b(
    rot_o_b: &UnitQuaternion<f64>,
    v_b: &Vector3<f64>,
    covariance: &NavCovariance,
    angular_rate_sigma_rad_s: f64,
) -> Matrix6<f64> {
    let jacobian = velocity_jacobian(rot_o_b, v_b);
    let own = covariance.fixed_view::<6, 6>(3, 3);
    let linear = jacobian * own * jacobian.transpose();
    let mut twist = Matrix6::zeros();
    twist.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
    let angular = Matrix3::from_diagonal_element(angular_rate_sigma_rad_s.powi(2));
    twist.fixed_view_mut::<3, 3>(3, 3).copy_from(&angular);
    twist
}

/// The covariance of two vectors after both were rotated.
pub(super) fn rotated(rotation: &UnitQuaternion<f64>, covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let mut jacobian = Matrix6::zeros();
    for at in [0, 3] {
        jacobian.fixed_view_mut::<3, 3>(at, at).copy_from(rotation.to_rotation_matrix().matrix());
    }
    jacobian * covariance * jacobian.transpose()
}

/// Change of `v_b` with attitude (right perturbation) and `v_o`.
fn velocity_jacobian(rot_o_b: &UnitQuaternion<f64>, v_b: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&v_b.cross_matrix());
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(rot_o_b.inverse().to_rotation_matrix().matrix());
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn attitude() -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(0.1, 0.2, 3.0)
    }

    const V_O: Vector3<f64> = Vector3::new(1.1, 0.2, -0.3);

    #[test]
    fn the_velocity_of_the_body_changes_with_the_state_as_the_jacobian_says() {
        let rot = attitude();
        let v_b = |theta: Vector3<f64>, dv: Vector3<f64>| {
            (rot * UnitQuaternion::from_scaled_axis(theta)).inverse() * (V_O + dv)
        };
        let jacobian = velocity_jacobian(&rot, &v_b(Vector3::zeros(), Vector3::zeros()));
        let step = 1e-6;
        for k in 0..3 {
            let e = Vector3::ith(k, step);
            let by_attitude = (v_b(e, Vector3::zeros()) - v_b(-e, Vector3::zeros())) / (2.0 * step);
            let by_velocity = (v_b(Vector3::zeros(), e) - v_b(Vector3::zeros(), -e)) / (2.0 * step);
            assert!((by_attitude - jacobian.column(k)).norm() < 1e-8, "{by_attitude} {jacobian}");
            assert!((by_velocity - jacobian.column(k + 3)).norm() < 1e-8, "{by_velocity} {jacobian}");
        }
    }

    #[test]
    fn the_covariance_of_the_attitude_is_about_the_axes_of_the_odometry_frame() {
        // The body's x axis points along y of the odometry frame: what is uncertain about the one is
        // uncertain about the other.
        let rot = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        let mut covariance = NavCovariance::zeros();
        covariance[(3, 3)] = 0.04;
        covariance[(0, 3)] = 0.1;
        covariance[(3, 0)] = 0.1;
        let turned = pose_covariance_o(&rot, &covariance);
        assert!((turned[(4, 4)] - 0.04).abs() < 1e-15 && turned[(3, 3)].abs() < 1e-15);
        assert!((turned[(0, 4)] - 0.1).abs() < 1e-15 && (turned[(4, 0)] - 0.1).abs() < 1e-15);
    }

    #[test]
    fn an_uncertain_heading_makes_no_velocity_of_the_body_uncertain() {
        // The whole trajectory is turned about the vertical by an unknown angle, velocity and attitude alike.
        let rot = attitude();
        let mut direction = SMatrix::<f64, 9, 1>::zeros();
        direction.fixed_rows_mut::<3>(3).copy_from(&(rot.inverse() * Vector3::z()));
        direction.fixed_rows_mut::<3>(6).copy_from(&Vector3::z().cross(&V_O));
        let covariance = direction * direction.transpose();
        let twist = twist_covariance_b(&rot, &(rot.inverse() * V_O), &covariance, 0.01);
        assert!((0..3).all(|k| twist[(k, k)].abs() < 1e-14), "{twist}");
        assert!((twist[(5, 5)] - 1e-4).abs() < 1e-18);
    }
}
