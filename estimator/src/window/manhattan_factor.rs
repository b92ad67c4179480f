//! The factor of a structural line: a landmark line lies along a direction of the Manhattan world.
//!
//! It is what the direction `d` ([`super::manhattan`]) has across the line, `u1` and `u3` being the line's axes in
//! its host camera ([`super::line`]): out of the plane of line and camera, and across the line in that plane.
//!
//! ```text
//! r = [u1 u3]' R_CO d / sigma
//! ```
//!
//! It is a prior on the line's direction, not a measurement taken a second time; `sigma` is how truly edges are
//! built ([`Manhattan::sigma_rad`]). It acts while the line is in the window and never enters the prior of what has left.
//! Verticals hold roll and pitch. The heading is solved anew from the lines in the window, since nothing of it is remembered: it
//! holds the yaws of the window together, and drifts with them. Turning `O` about gravity turns the heading and all frames
//! alike, so that yaw of the whole stays unobservable.

use super::camera_poses::CameraPose;
use super::feature::{Jacobians, StructuralJacobians, StructuralLinearization};
use super::manhattan::{Axis, Manhattan};
use super::quad::quad;
use nalgebra::{Matrix2x4, Matrix3, Vector2, Vector3};

/// Residual of a landmark line against the direction `axis` to which it belongs, in standard deviations, and on request its
/// Jacobians; `axes` are its `U` in its host camera. `None` while that direction is unknown or not used.
pub fn residual(
    manhattan: &Manhattan,
    (axes, axis): (&Matrix3<f64>, Axis),
    host: &CameraPose,
    linearization: Option<StructuralLinearization<'_, Jacobians<4>>>,
) -> Option<Vector2<f64>> {
    let d_o = manhattan.direction_o(axis)?;
    let sigma_rad = manhattan.sigma_rad(axis);
    if let Some(request) = linearization {
        linearize(axes, (&d_o, sigma_rad), request.at, request.jacobians);
    }
    let d_u = axes.tr_mul(&host.rot_o_c.tr_mul(&d_o));
    Some(Vector2::new(d_u.x, d_u.z) / sigma_rad)
}

/// Jacobians of the residual against the direction `d_o` of standard deviation `sigma_rad`.
fn linearize(
    axes: &Matrix3<f64>,
    (d_o, sigma_rad): (&Vector3<f64>, f64),
    host: &CameraPose,
    StructuralJacobians { feature: j, heading }: &mut StructuralJacobians<Jacobians<4>>,
) {
    let d_h = host.rot_o_c.tr_mul(d_o);
    let d_u = axes.tr_mul(&d_h);
    *j = Jacobians::zeros();
    for (d, axis) in [0, 2].into_iter().enumerate() {
        // The axis in `O`: a motion of the host's camera turns it, and the position does not matter.
        let by_h = axes.column(axis) / sigma_rad;
        let by_o = host.rot_o_c * by_h;
        j.camera[d] = [[0.0; 4], quad(&by_o.cross(d_o))];
        j.host[d] = [[0.0; 4], quad(&by_h.cross(&d_h))];
        // A horizontal direction turns with the heading; for verticals this is exactly zero.
        heading[d] = by_o.dot(&Vector3::z().cross(d_o));
    }
    let (x, y, z) = (d_u.x, d_u.y, d_u.z);
    j.landmark = Matrix2x4::new(0.0, -z, y, 0.0, -y, x, 0.0, 0.0) / sigma_rad;
}

#[cfg(test)]
#[path = "manhattan_tests.rs"]
mod tests;
