//! Uncertainty that estimates inherit from those before the last reset, and the covariance without it.
//!
//! A soft reset goes on from the last pose. The new window knows where it is against its own start; how well that start is
//! known against the first pose of all is one covariance `C` of position and yaw (gravity gives the rest). A state at `p` with
//! attitude `R` and velocity `v` has from it the error `dp + dyaw z x (p - p0)`, `R' z dyaw` and `dyaw z x v`. Whoever is
//! informed of the reset takes the start as the new origin, and needs the covariance without that share.

use nalgebra::{Matrix3, Matrix4, SMatrix, UnitQuaternion, Vector3};

/// Covariance of a state in the order of [`crate::estimate::NavCovariance`].
type NavCovariance = SMatrix<f64, 9, 9>;
/// Indices at which position, attitude and velocity begin in it.
const P: usize = 0;
const ROT: usize = 3;
const V: usize = 6;

/// Covariance of position, m, and yaw, rad, of the last start against the first pose, and where that start was.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OriginUncertainty {
    /// Zero before the first reset.
    pub covariance: Matrix4<f64>,
    /// Position of the start in the odometry frame, m.
    pub p_o_b: Vector3<f64>,
}

impl OriginUncertainty {
    /// Share of the origin in the covariance of a state; `None` before the first reset.
    pub fn share(
        &self,
        p_o_b: &Vector3<f64>,
        rot_o_b: &UnitQuaternion<f64>,
        v_o_b: &Vector3<f64>,
    ) -> Option<NavCovariance> {
        if self.covariance == Matrix4::zeros() {
            return None;
        }
        let up = Vector3::z();
        let mut by_origin = SMatrix::<f64, 9, 4>::zeros();
        by_origin.fixed_view_mut::<3, 3>(P, 0).fill_with_identity();
        by_origin.fixed_view_mut::<3, 1>(P, 3).copy_from(&up.cross(&(p_o_b - self.p_o_b)));
        by_origin.fixed_view_mut::<3, 1>(ROT, 3).copy_from(&(rot_o_b.inverse() * up));
        by_origin.fixed_view_mut::<3, 1>(V, 3).copy_from(&up.cross(v_o_b));
        Some(by_origin * self.covariance * by_origin.transpose())
    }
}

/// Covariance of the velocity in the body's axes, (m/s)²: that in the odometry frame contains the speed times the uncertainty
/// of the yaw, which neither a controller nor a filter in the body suffers from.
pub fn body_velocity_covariance(
    covariance: &NavCovariance,
    rot_o_b: &UnitQuaternion<f64>,
    v_o_b: &Vector3<f64>,
) -> Matrix3<f64> {
    let rot_b_o = rot_o_b.inverse();
    let mut by_state = SMatrix::<f64, 3, 9>::zeros();
    by_state.fixed_view_mut::<3, 3>(0, ROT).copy_from(&(rot_b_o * v_o_b).cross_matrix());
    by_state.fixed_view_mut::<3, 3>(0, V).copy_from(&rot_b_o.to_rotation_matrix().into_inner());
    by_state * covariance * by_state.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;

    #[test]
    fn an_unknown_heading_leaves_the_velocity_in_the_body_known() {
        let (p, v) = (Vector3::new(3.0, -1.0, 2.0), Vector3::new(2.0, 1.0, -0.5));
        let rot = exp_so3(&Vector3::new(0.4, -1.2, 0.9));
        let known = NavCovariance::identity() * 1e-4;
        let origin = OriginUncertainty {
            covariance: Matrix4::from_diagonal(&nalgebra::Vector4::new(9.0, 9.0, 1.0, 6.0)),
            p_o_b: Vector3::new(-4.0, 0.0, 1.0),
        };
        let covariance = known + origin.share(&p, &rot, &v).expect("there was a reset");
        assert!(covariance[(6, 6)] > 4.0, "the velocity in O turns with the heading");
        let [told, best] = [&covariance, &known].map(|c| body_velocity_covariance(c, &rot, &v));
        assert!((told - best).norm() < 1e-9, "{told} against {best}");
    }

    #[test]
    fn the_first_start_has_no_share_of_it() {
        let at = Vector3::new(1.0, 2.0, 3.0);
        assert_eq!(OriginUncertainty::default().share(&at, &UnitQuaternion::identity(), &at), None);
    }
}
