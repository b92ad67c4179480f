//! Errors of a state against the truth, each with the covariance that the estimator claims for it.
//!
//! The covariance of a state is that of `(dp, dtheta, dv)`: position and velocity in `O`, attitude as right perturbation,
//! `true = (p + dp, R Exp(dtheta), v + dv)`. With `u = R' e_z` the vertical in the body, to first order:
//!
//! - tilt: the part of `R dtheta` across the vertical, found from the directions of gravity in the body alone. It needs
//!   no alignment.
//! - velocity: in the body, `R' v`; its error is `[R' v]x dtheta + R' dv`. It needs no alignment, and the yaw of `O`
//!   cancels.
//! - position and yaw (`dpsi = u' dtheta`): visual-inertial odometry observes neither, so both are counted from the first
//!   pose of `O` (Zhang and Scaramuzza 2018, section III: the four unobservable degrees of freedom). The truth is brought to
//!   that pose by position and yaw, and nothing later takes part in the alignment. What the estimator claims of that pose is
//!   not part of the error any more, so it is taken out of the claim: with `x = (dp, dpsi)`, `X` its covariance and
//!   `F = [I, e_z x (p_k - p_0); 0, 1]` the error of pose `k` is `x_k - F x_0`, and its covariance `X_k - F X_0 F'`. That
//!   holds because a window anchors position and yaw at the first pose that it gives out: what happens later is
//!   independent of the anchor. Neither a wide anchor nor what a restart inherits makes the figure small.
//! - step: the way and the turn about the vertical from pose `i` to pose `j`, about a second later, `x_j - F x_i` in the
//!   axes of `O` as pose `i` has them, each pose as it was published. With `Y_i`, `Y_j` the covariances of both poses in the
//!   window at the time of pose `j`, and `W` that of the way between them, its covariance is
//!   `W + F (X_i - Y_i)+ F' + (X_j - Y_j)+`. `X_i - Y_i` is the covariance of what pose `i` was corrected by since: it depends
//!   on the data alone, of which the errors that remain are independent. `X_j - Y_j` is what odometry adds to the estimate.
//!   `+` leaves out negative parts, where a later window claims to know less than an earlier one did.

use super::nees;
use nalgebra::{
    Isometry3, Matrix2, Matrix3, Matrix4, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
    Vector4,
};
use plumbline_estimator::odometry::StepCovariance;
use plumbline_flight::flight::{PublishedState, TrueState};

/// An error and the covariance that is claimed for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Claim<const N: usize> {
    /// Error: truth less estimate.
    pub error: SVector<f64, N>,
    /// Claimed covariance of the error.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Claim<N> {
    /// `e' P^-1 e`; `None` where the covariance is not positive definite.
    pub fn nees(&self) -> Option<f64> {
        nees(&self.error, &self.covariance)
    }
}

/// Tilt error in the horizontal axes of `O`, rad.
pub fn tilt(pose: &PublishedState, truth: &TrueState) -> Claim<2> {
    let rot_o_b = pose.pose_o_b.rotation;
    let (up, true_up) = (rot_o_b.inverse() * Vector3::z(), truth.pose_w_b.rotation.inverse() * Vector3::z());
    let cross = true_up.cross(&up);
    let sine = cross.norm();
    let turn_b = if sine > 0.0 { cross * (sine.atan2(true_up.dot(&up)) / sine) } else { Vector3::zeros() };
    let turn_o = rot_o_b * turn_b;
    let rot = rot_o_b.to_rotation_matrix().into_inner();
    let covariance: Matrix3<f64> = rot * pose.covariance.fixed_view::<3, 3>(3, 3) * rot.transpose();
    let across: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    Claim { error: Vector2::new(turn_o.x, turn_o.y), covariance: across }
}

/// Velocity error in the body, m/s; `None` where the true velocity is unknown.
pub fn velocity(pose: &PublishedState, truth: &TrueState) -> Option<Claim<3>> {
    let rot_b_o = pose.pose_o_b.rotation.inverse();
    let v_b = rot_b_o * pose.v_o_b;
    let error = truth.pose_w_b.rotation.inverse() * truth.v_w_b? - v_b;
    let mut by_state = SMatrix::<f64, 3, 9>::zeros();
    by_state.fixed_view_mut::<3, 3>(0, 3).copy_from(&v_b.cross_matrix());
    by_state.fixed_view_mut::<3, 3>(0, 6).copy_from(&rot_b_o.to_rotation_matrix().into_inner());
    Some(Claim { error, covariance: by_state * pose.covariance * by_state.transpose() })
}

/// Covariance of position and yaw of a pose.
fn gauge_covariance(pose: &PublishedState) -> Matrix4<f64> {
    let mut by_state = SMatrix::<f64, 4, 9>::zeros();
    by_state.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    let up_b = pose.pose_o_b.rotation.inverse() * Vector3::z();
    by_state.fixed_view_mut::<1, 3>(3, 3).copy_from(&up_b.transpose());
    by_state * pose.covariance * by_state.transpose()
}

/// `F`: what an error of position and yaw of `from` makes of those of `to`.
fn carried(from: &PublishedState, to: &PublishedState) -> Matrix4<f64> {
    let way = to.pose_o_b.translation.vector - from.pose_o_b.translation.vector;
    let mut f = Matrix4::identity();
    f.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(&way));
    f
}

/// A published state and the true one.
pub type Known<'a> = (&'a PublishedState, &'a TrueState);

/// Error of position (m) and yaw (rad) of `pose` against the first pose of its odometry frame.
pub fn since_start(first: Known<'_>, pose: Known<'_>) -> Claim<4> {
    let f = carried(first.0, pose.0);
    let covariance = gauge_covariance(pose.0) - f * gauge_covariance(first.0) * f.transpose();
    Claim { error: motion_error(first, pose), covariance }
}

/// Error of the way (m) and of the turn about the vertical (rad) between two published poses.
pub fn step(from: Known<'_>, to: Known<'_>, known: &StepCovariance) -> Claim<4> {
    let f = carried(from.0, to.0);
    let of_from = positive_part(gauge_covariance(from.0) - known.of_from);
    let of_to = positive_part(gauge_covariance(to.0) - known.of_to);
    let covariance = known.covariance + f * of_from * f.transpose() + of_to;
    Claim { error: motion_error(from, to), covariance }
}

/// A symmetric matrix without its negative eigenvalues.
fn positive_part(matrix: Matrix4<f64>) -> Matrix4<f64> {
    let eigen = ((matrix + matrix.transpose()) * 0.5).symmetric_eigen();
    let kept = eigen.eigenvalues.map(|value| value.max(0.0));
    eigen.eigenvectors * Matrix4::from_diagonal(&kept) * eigen.eigenvectors.transpose()
}

/// `x_to - F x_from`, with the truth brought to `from` by position and yaw.
fn motion_error(from: Known<'_>, to: Known<'_>) -> Vector4<f64> {
    let true_o = frame_of(&from.0.pose_o_b, &from.1.pose_w_b) * to.1.pose_w_b;
    let way = true_o.translation.vector - to.0.pose_o_b.translation.vector;
    way.push(yaw_of(&(true_o.rotation * to.0.pose_o_b.rotation.inverse())))
}

/// The frame of `pose` in the world of `truth`: takes the truth to the odometry frame by position and yaw, so that the two
/// agree.
pub fn frame_of(pose: &Isometry3<f64>, truth: &Isometry3<f64>) -> Isometry3<f64> {
    let angle = yaw_of(&(pose.rotation * truth.rotation.inverse()));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
    let offset = pose.translation.vector - turn * truth.translation.vector;
    Isometry3::from_parts(Translation3::from(offset), turn)
}

/// The turn about z that brings the identity nearest to `rotation`, within half a turn, rad.
fn yaw_of(rotation: &UnitQuaternion<f64>) -> f64 {
    // Both signs of a quaternion are one rotation: the one with w above zero turns by less than half.
    let sign = if rotation.w < 0.0 { -1.0 } else { 1.0 };
    2.0 * (sign * rotation.k).atan2(sign * rotation.w)
}
