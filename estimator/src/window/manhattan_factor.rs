//! The factor of a structural line: a landmark line lies along a direction of the Manhattan world.
//!
//! It is what the direction `d` ([`super::manhattan`]) has across the line, `u1` and `u3` being the line's axes in
//! its host camera ([`super::line`]): out of the plane of line and camera, and across the line in that plane.
//!
//! ```text
//! r = [u1 u3]' R_CB R_BO d / sigma
//! ```
//!
//! It is a prior on the line's direction, not a measurement taken a second time; `sigma` is how truly edges are
//! built. Verticals hold roll and pitch. The heading is never known better than the yaw of the frames
//! that found it, but it does not drift: while structural lines are seen, neither does yaw. Turning `O` about
//! gravity turns the heading and all frames alike, so that yaw of the whole stays unobservable.

use super::feature::{BodyPose, Jacobians, StructuralJacobians, StructuralLinearization};
use super::manhattan::{Axis, Manhattan};
use super::state::{Mount, NavState};
use crate::geometry::skew;
use nalgebra::{Matrix2x3, Matrix2x4, Matrix3, SMatrix, Vector2, Vector3};

/// A landmark line along a direction of the Manhattan world.
#[derive(Clone, Copy, Debug)]
pub struct StructuralLine<'a> {
    /// Its axes `U` in its host camera.
    pub axes: &'a Matrix3<f64>,
    /// The direction to which it belongs.
    pub axis: Axis,
}

/// How far `line` is from its direction, in standard deviations, and on request its Jacobians. `None` while that
/// direction is unknown or not used.
#[must_use]
pub fn residual(
    manhattan: &Manhattan,
    line: StructuralLine<'_>,
    host: &BodyPose,
    mount: &Mount,
    linearization: Option<StructuralLinearization<'_, Jacobians<4>>>,
) -> Option<Vector2<f64>> {
    let d_o = manhattan.direction_o(line.axis)?;
    let sigma_rad = manhattan.options.sigma_rad;
    if let Some(request) = linearization {
        linearize(line, (&d_o, sigma_rad), request.at, mount, request.jacobians);
    }
    let d_u = along_axes(line.axes, mount, &host.rot_o_b.tr_mul(&d_o));
    Some(Vector2::new(d_u.x, d_u.z) / sigma_rad)
}

/// The direction `d_b` of the host's body along the three axes of a line.
fn along_axes(axes: &Matrix3<f64>, mount: &Mount, d_b: &Vector3<f64>) -> Vector3<f64> {
    axes.tr_mul(&mount.rot_b_c.tr_mul(d_b))
}

/// Jacobians of the residual against the direction `d_o` of standard deviation `sigma_rad`.
fn linearize(
    line: StructuralLine<'_>,
    (d_o, sigma_rad): (&Vector3<f64>, f64),
    host: &BodyPose,
    mount: &Mount,
    StructuralJacobians { feature: j, heading }: &mut StructuralJacobians<Jacobians<4>>,
) {
    let d_b = host.rot_o_b.tr_mul(d_o);
    let d_u = along_axes(line.axes, mount, &d_b);
    let (u1, u3) = (line.axes.column(0), line.axes.column(2));
    let by_c = Matrix2x3::from_rows(&[u1.transpose(), u3.transpose()]) / sigma_rad;
    let by_b = by_c * mount.rot_b_c.transpose();
    *j = Jacobians::zeros();
    j.host.fixed_view_mut::<2, 3>(0, NavState::ROT).copy_from(&(by_b * skew(&d_b)));
    let mut by_mount = SMatrix::<f64, 2, 6>::zeros();
    by_mount.fixed_view_mut::<2, 3>(0, NavState::ROT).copy_from(&(by_c * skew(&mount.rot_b_c.tr_mul(&d_b))));
    j.rig.fixed_view_mut::<2, 12>(0, 0).copy_from(&(by_mount * mount.by_rig));
    let (x, y, z) = (d_u.x, d_u.y, d_u.z);
    j.landmark = Matrix2x4::new(0.0, -z, y, 0.0, -y, x, 0.0, 0.0) / sigma_rad;
    // A horizontal direction turns with the heading; for verticals this is exactly zero.
    *heading = by_b * host.rot_o_b.tr_mul(&Vector3::z().cross(d_o));
}

#[cfg(test)]
#[path = "manhattan_tests.rs"]
mod tests;
