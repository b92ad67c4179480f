//! The reprojection factor of a point in inverse depth.
//!
//! A landmark is the bearing `b = (x, y, 1)` and the inverse depth `rho` in the camera that hosts it. In
//! the observing camera it lies along (scaled by `rho`, so that points at infinity are no exception)
//!
//! ```text
//! q_bh = R_bc_h b + rho p_bc_h          host body
//! q_o  = R_h q_bh + rho p_h             odometry frame
//! q_bt = R_t' (q_o - rho p_t)           observing body
//! q_ct = R_bc_t' (q_bt - rho p_bc_t)    observing camera
//! r    = W (q_ct.xy / q_ct.z - z + (td - td_frame) dz/dt)
//! ```
//!
//! `W` takes normalized coordinates to pixels over their standard deviation at the observed place, so
//! `r` is in standard deviations. Perturbations are right ones. Source: the landmark of VINS-Mono (Qin et
//! al. 2018, section V) with the bearing estimated as well, as in basalt (Usenko et al. 2019).

use super::state::Mount;
use crate::geometry::skew;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};

/// Smallest forward component of `q_ct`: the landmark is in front of the observing camera.
const MIN_FORWARD: f64 = 0.02;

/// A body pose with its rotation as a matrix.
#[derive(Clone, Debug)]
pub struct BodyPose {
    /// Takes coordinates from `B` to `O`.
    pub rot_o_b: Matrix3<f64>,
    /// Position of `B` in `O`, m.
    pub p_o_b: Vector3<f64>,
}

/// A landmark's parameters in its host camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InversePoint {
    /// Normalized coordinates.
    pub xy: Vector2<f64>,
    /// Inverse depth, 1/m.
    pub rho: f64,
}

/// A measured place of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMeasurement {
    /// Normalized coordinates.
    pub xy: Vector2<f64>,
    /// Their rate of change, 1/s.
    pub xy_rate: Vector2<f64>,
    /// Square root of the information: from normalized coordinates to standard deviations.
    pub weight: Matrix2<f64>,
}

/// Derivatives of the residual.
#[derive(Clone, Debug)]
pub struct ReprojectionJacobians {
    /// By the host's pose (position, attitude).
    pub host: SMatrix<f64, 2, 6>,
    /// By the observer's pose.
    pub target: SMatrix<f64, 2, 6>,
    /// By the rig (12 of mounting, time offset).
    pub rig: SMatrix<f64, 2, 13>,
    /// By the landmark (x, y, rho).
    pub landmark: Matrix2x3<f64>,
}

/// Where the factor looks from and to.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Pose of the host's body, and of the observer's.
    pub host: &'a BodyPose,
    /// Mounting of the host's camera.
    pub host_mount: &'a Mount,
    /// Pose of the observer's body.
    pub target: &'a BodyPose,
    /// Mounting of the observer's camera.
    pub target_mount: &'a Mount,
}

/// Intermediate directions of a landmark on its way from host to observer.
struct Path {
    q_bh: Vector3<f64>,
    q_bt: Vector3<f64>,
    q_ct: Vector3<f64>,
}

impl View<'_> {
    fn path(&self, point: &InversePoint) -> Path {
        let b = Vector3::new(point.xy.x, point.xy.y, 1.0);
        let q_bh = self.host_mount.rot_b_c * b + self.host_mount.p_b_c * point.rho;
        let q_o = self.host.rot_o_b * q_bh + (self.host.p_o_b - self.target.p_o_b) * point.rho;
        let q_bt = self.target.rot_o_b.tr_mul(&q_o);
        let q_ct = self.target_mount.rot_b_c.tr_mul(&(q_bt - self.target_mount.p_b_c * point.rho));
        Path { q_bh, q_bt, q_ct }
    }

    /// Where the observer sees the landmark, in normalized coordinates; `None` behind it.
    #[must_use]
    pub fn project(&self, point: &InversePoint) -> Option<Vector2<f64>> {
        let q = self.path(point).q_ct;
        (q.z > MIN_FORWARD).then(|| Vector2::new(q.x / q.z, q.y / q.z))
    }

    /// The landmark as the observer would host it; `None` behind it.
    #[must_use]
    pub fn seen_from_target(&self, point: &InversePoint) -> Option<InversePoint> {
        let q = self.path(point).q_ct;
        (q.z > MIN_FORWARD)
            .then(|| InversePoint { xy: Vector2::new(q.x / q.z, q.y / q.z), rho: point.rho / q.z })
    }

    /// Rate of the normalized coordinates, 1/s, in an observer with angular rate `rate_b` (rad/s) and
    /// velocity `v_b` (m/s), both in its body frame: `q_ct' = R_bc_t' (-w x q_bt - rho v)`.
    #[must_use]
    pub fn image_rate(
        &self,
        point: &InversePoint,
        rate_b: &Vector3<f64>,
        v_b: &Vector3<f64>,
    ) -> Option<Vector2<f64>> {
        let Path { q_bt, q_ct, .. } = self.path(point);
        if q_ct.z <= MIN_FORWARD {
            return None;
        }
        let d = self.target_mount.rot_b_c.tr_mul(&-(rate_b.cross(&q_bt) + v_b * point.rho));
        Some((d.xy() - q_ct.xy() * (d.z / q_ct.z)) / q_ct.z)
    }

    /// The residual in standard deviations; `time_offset_step_s` is `td - td_frame`. `None` behind.
    #[must_use]
    pub fn residual(
        &self,
        point: &InversePoint,
        measured: &PointMeasurement,
        time_offset_step_s: f64,
    ) -> Option<Vector2<f64>> {
        let predicted = self.project(point)?;
        Some(measured.weight * (predicted - measured.xy + measured.xy_rate * time_offset_step_s))
    }

    /// Derivatives of [`Self::residual`]; `None` behind the observer.
    #[must_use]
    pub fn jacobians(
        &self,
        point: &InversePoint,
        measured: &PointMeasurement,
    ) -> Option<ReprojectionJacobians> {
        let Path { q_bh, q_bt, q_ct } = self.path(point);
        if q_ct.z <= MIN_FORWARD {
            return None;
        }
        let iz = 1.0 / q_ct.z;
        let projection = Matrix2x3::new(iz, 0.0, -q_ct.x * iz * iz, 0.0, iz, -q_ct.y * iz * iz);
        let by_ct = measured.weight * projection;
        let by_bt = by_ct * self.target_mount.rot_b_c.transpose();
        let by_o = by_bt * self.target.rot_o_b.transpose();
        let by_bh = by_o * self.host.rot_o_b;
        let b = Vector3::new(point.xy.x, point.xy.y, 1.0);
        let by_b = by_bh * self.host_mount.rot_b_c;

        let mut host = SMatrix::<f64, 2, 6>::zeros();
        host.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_o * point.rho));
        host.fixed_view_mut::<2, 3>(0, 3).copy_from(&-(by_bh * skew(&q_bh)));
        let mut target = SMatrix::<f64, 2, 6>::zeros();
        target.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_o * -point.rho));
        target.fixed_view_mut::<2, 3>(0, 3).copy_from(&(by_bt * skew(&q_bt)));

        let mut host_mount = SMatrix::<f64, 2, 6>::zeros();
        host_mount.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_bh * point.rho));
        host_mount.fixed_view_mut::<2, 3>(0, 3).copy_from(&-(by_b * skew(&b)));
        let mut target_mount = SMatrix::<f64, 2, 6>::zeros();
        target_mount.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_bt * -point.rho));
        target_mount.fixed_view_mut::<2, 3>(0, 3).copy_from(&(by_ct * skew(&q_ct)));
        let mut rig = SMatrix::<f64, 2, 13>::zeros();
        rig.fixed_view_mut::<2, 12>(0, 0)
            .copy_from(&(host_mount * self.host_mount.by_rig + target_mount * self.target_mount.by_rig));
        rig.set_column(12, &(measured.weight * measured.xy_rate));

        let p_ho = self.host.rot_o_b * self.host_mount.p_b_c + self.host.p_o_b - self.target.p_o_b;
        let p_ct =
            self.target_mount.rot_b_c.tr_mul(&(self.target.rot_o_b.tr_mul(&p_ho) - self.target_mount.p_b_c));
        let mut landmark = Matrix2x3::zeros();
        landmark.fixed_columns_mut::<2>(0).copy_from(&by_b.fixed_columns::<2>(0));
        landmark.set_column(2, &(by_ct * p_ct));
        Some(ReprojectionJacobians { host, target, rig, landmark })
    }
}

#[cfg(test)]
#[path = "reprojection_tests.rs"]
mod tests;
