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

use super::feature::{Estimated, Feature, Jacobians, View, ViewLinearization};
use super::state::{NavState, Rig};
use crate::geometry::skew;
use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

/// Smallest forward component of `q_ct`: the landmark is in front of the observing camera.
const MIN_FORWARD: f64 = 0.02;
/// Landmarks stay within this inverse depth, 1/m.
const MAX_INVERSE_DEPTH: f64 = 10.0;
/// A little behind infinity is noise of a far point.
const MIN_INVERSE_DEPTH: f64 = -0.02;

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

/// Intermediate directions of a landmark on its way from host to observer.
struct Path {
    q_bh: Vector3<f64>,
    q_bt: Vector3<f64>,
    q_ct: Vector3<f64>,
}

/// The landmark on its way from host to observer.
fn path(view: &View<'_>, point: &InversePoint) -> Path {
    let b = Vector3::new(point.xy.x, point.xy.y, 1.0);
    let q_bh = view.host_mount.rot_b_c * b + view.host_mount.p_b_c * point.rho;
    let q_o = view.host.rot_o_b * q_bh + (view.host.p_o_b - view.target.p_o_b) * point.rho;
    let q_bt = view.target.rot_o_b.tr_mul(&q_o);
    let q_ct = view.target_mount.rot_b_c.tr_mul(&(q_bt - view.target_mount.p_b_c * point.rho));
    Path { q_bh, q_bt, q_ct }
}

impl InversePoint {
    /// Where the observer sees the landmark, in normalized coordinates; `None` behind it.
    #[must_use]
    pub fn project(&self, view: &View<'_>) -> Option<Vector2<f64>> {
        let q = path(view, self).q_ct;
        (q.z > MIN_FORWARD).then(|| Vector2::new(q.x / q.z, q.y / q.z))
    }

    /// Jacobians of the residual into `j`; `None` behind the observer.
    fn linearize(&self, view: &View<'_>, measured: &PointMeasurement, j: &mut Jacobians<3>) -> Option<()> {
        let Path { q_bh, q_bt, q_ct } = path(view, self);
        if q_ct.z <= MIN_FORWARD {
            return None;
        }
        let iz = 1.0 / q_ct.z;
        let projection = Matrix2x3::new(iz, 0.0, -q_ct.x * iz * iz, 0.0, iz, -q_ct.y * iz * iz);
        let by_ct = measured.weight * projection;
        let by_bt = by_ct * view.target_mount.rot_b_c.transpose();
        let by_o = by_bt * view.target.rot_o_b.transpose();
        let by_bh = by_o * view.host.rot_o_b;
        let b = Vector3::new(self.xy.x, self.xy.y, 1.0);
        let by_b = by_bh * view.host_mount.rot_b_c;

        j.host.fixed_view_mut::<2, 3>(0, NavState::P).copy_from(&(by_o * self.rho));
        j.host.fixed_view_mut::<2, 3>(0, NavState::ROT).copy_from(&-(by_bh * skew(&q_bh)));
        j.target.fixed_view_mut::<2, 3>(0, NavState::P).copy_from(&(by_o * -self.rho));
        j.target.fixed_view_mut::<2, 3>(0, NavState::ROT).copy_from(&(by_bt * skew(&q_bt)));

        let mut host_mount = SMatrix::<f64, 2, 6>::zeros();
        host_mount.fixed_view_mut::<2, 3>(0, NavState::P).copy_from(&(by_bh * self.rho));
        host_mount.fixed_view_mut::<2, 3>(0, NavState::ROT).copy_from(&-(by_b * skew(&b)));
        let mut target_mount = SMatrix::<f64, 2, 6>::zeros();
        target_mount.fixed_view_mut::<2, 3>(0, NavState::P).copy_from(&(by_bt * -self.rho));
        target_mount.fixed_view_mut::<2, 3>(0, NavState::ROT).copy_from(&(by_ct * skew(&q_ct)));
        j.rig
            .fixed_view_mut::<2, 12>(0, 0)
            .copy_from(&(host_mount * view.host_mount.by_rig + target_mount * view.target_mount.by_rig));
        j.rig.set_column(Rig::TIME_OFFSET, &(measured.weight * measured.xy_rate));

        let p_ho = view.host.rot_o_b * view.host_mount.p_b_c + view.host.p_o_b - view.target.p_o_b;
        let p_ct =
            view.target_mount.rot_b_c.tr_mul(&(view.target.rot_o_b.tr_mul(&p_ho) - view.target_mount.p_b_c));
        j.landmark.fixed_columns_mut::<2>(0).copy_from(&by_b.fixed_columns::<2>(0));
        j.landmark.set_column(2, &(by_ct * p_ct));
        Some(())
    }
}

impl Feature for InversePoint {
    type Measurement = PointMeasurement;
    type Jacobians = Jacobians<3>;

    #[inline]
    fn residual(
        &self,
        view: &View<'_>,
        measured: &PointMeasurement,
        time_offset_step_s: f64,
        linearization: Option<ViewLinearization<'_, Jacobians<3>>>,
    ) -> Option<Vector2<f64>> {
        let predicted = self.project(view)?;
        if let Some(request) = linearization {
            self.linearize(request.at, measured, request.jacobians)?;
        }
        Some(measured.weight * (predicted - measured.xy + measured.xy_rate * time_offset_step_s))
    }

    /// `q_ct' = R_bc_t' (-w x q_bt - rho v)`.
    fn with_rate(
        &self,
        view: &View<'_>,
        measured: &PointMeasurement,
        rate_b: &Vector3<f64>,
        v_b: &Vector3<f64>,
    ) -> Option<PointMeasurement> {
        let Path { q_bt, q_ct, .. } = path(view, self);
        if q_ct.z <= MIN_FORWARD {
            return None;
        }
        let d = view.target_mount.rot_b_c.tr_mul(&-(rate_b.cross(&q_bt) + v_b * self.rho));
        Some(PointMeasurement { xy_rate: (d.xy() - q_ct.xy() * (d.z / q_ct.z)) / q_ct.z, ..*measured })
    }

    fn hosted_by_target(&self, view: &View<'_>) -> Option<Self> {
        let q = path(view, self).q_ct;
        (q.z > MIN_FORWARD).then(|| Self { xy: Vector2::new(q.x / q.z, q.y / q.z), rho: self.rho / q.z })
    }
}

impl Estimated<3> for InversePoint {
    fn plus(&self, d: &Vector3<f64>) -> Self {
        Self { xy: self.xy + d.xy(), rho: (self.rho + d.z).clamp(MIN_INVERSE_DEPTH, MAX_INVERSE_DEPTH) }
    }
}

#[cfg(test)]
#[path = "reprojection_tests.rs"]
mod tests;
