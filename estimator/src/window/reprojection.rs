//! The reprojection factor of a point in inverse depth.
//!
//! A landmark is the bearing `b = (x, y, 1)` and the inverse depth `rho` in the camera that hosts it. With the
//! poses `(R, p)` of the cameras it lies, in the observing one, along (scaled by `rho`, so that points at infinity are no
//! exception)
//!
//! ```text
//! q_o = R_h b + rho p_h         odometry frame
//! q_c = R_t' (q_o - rho p_t)    observing camera
//! r   = W (q_c.xy / q_c.z - z + (td - td_frame) dz/dt)
//! ```
//!
//! A step `(t, theta)` of the host's camera moves `q_o` by `rho t + theta x q_o` ([`super::camera_poses`]).
//! `W` takes normalized coordinates to pixels over their standard deviation at the observed place, so
//! `r` is in standard deviations. Source: the landmark of VINS-Mono (Qin et
//! al. 2018, section V) with the bearing estimated as well, as in basalt (Usenko et al. 2019).

use super::camera_poses::CameraView;
use super::feature::{Estimated, Feature, Jacobians, View, ViewLinearization};
use super::state::NavState;
use nalgebra::{Matrix2, Vector2, Vector3};

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

/// The landmark on its way from host to observer.
struct Path {
    q_o: Vector3<f64>,
    q_c: Vector3<f64>,
}

fn path(view: CameraView<'_>, point: &InversePoint) -> Path {
    let CameraView { host, target } = view;
    let q_o = host.rot_o_c * Vector3::new(point.xy.x, point.xy.y, 1.0) + host.p_o_c * point.rho;
    let q_c = target.rot_o_c.tr_mul(&(q_o - target.p_o_c * point.rho));
    Path { q_o, q_c }
}

/// Its direction in the observer's body and camera.
fn seen(view: &View<'_>, point: &InversePoint) -> [Vector3<f64>; 2] {
    let b = Vector3::new(point.xy.x, point.xy.y, 1.0);
    let q_bh = view.host_mount.rot_b_c * b + view.host_mount.p_b_c * point.rho;
    let q_o = view.host.rot_o_b * q_bh + (view.host.p_o_b - view.target.p_o_b) * point.rho;
    let q_bt = view.target.rot_o_b.tr_mul(&q_o);
    [q_bt, view.target_mount.rot_b_c.tr_mul(&(q_bt - view.target_mount.p_b_c * point.rho))]
}

impl InversePoint {
    /// Where the observer sees the landmark, in normalized coordinates; `None` behind it.
    #[must_use]
    pub fn project(&self, view: CameraView<'_>) -> Option<Vector2<f64>> {
        let q = path(view, self).q_c;
        (q.z > MIN_FORWARD).then(|| Vector2::new(q.x / q.z, q.y / q.z))
    }

    /// Jacobians of the residual into `j`; `None` behind the observer.
    fn linearize(
        &self,
        view: CameraView<'_>,
        measured: &PointMeasurement,
        j: &mut Jacobians<3>,
    ) -> Option<()> {
        let Path { q_o, q_c } = path(view, self);
        if q_c.z <= MIN_FORWARD {
            return None;
        }
        let CameraView { host, target } = view;
        let iz = 1.0 / q_c.z;
        let arm = host.p_o_c - target.p_o_c;
        for d in 0..2 {
            let (wx, wy) = (measured.weight[(d, 0)] * iz, measured.weight[(d, 1)] * iz);
            let by_c = Vector3::new(wx, wy, -(wx * q_c.x + wy * q_c.y) * iz);
            let by_o = target.rot_o_c * by_c;
            let (by_p, by_rot, by_b) = (by_o * self.rho, q_o.cross(&by_o), host.rot_o_c.tr_mul(&by_o));
            for k in 0..3 {
                j.camera[(d, NavState::P + k)] = by_p[k];
                j.camera[(d, NavState::ROT + k)] = by_rot[k];
            }
            (j.landmark[(d, 0)], j.landmark[(d, 1)]) = (by_b.x, by_b.y);
            j.landmark[(d, 2)] = by_o.dot(&arm);
        }
        j.time_offset = measured.weight * measured.xy_rate;
        Some(())
    }
}

impl Feature for InversePoint {
    type Measurement = PointMeasurement;
    type Jacobians = Jacobians<3>;

    #[inline]
    fn residual(
        &self,
        view: CameraView<'_>,
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
        let [q_bt, q_ct] = seen(view, self);
        if q_ct.z <= MIN_FORWARD {
            return None;
        }
        let d = view.target_mount.rot_b_c.tr_mul(&-(rate_b.cross(&q_bt) + v_b * self.rho));
        Some(PointMeasurement { xy_rate: (d.xy() - q_ct.xy() * (d.z / q_ct.z)) / q_ct.z, ..*measured })
    }

    fn hosted_by_target(&self, view: &View<'_>) -> Option<Self> {
        let [_, q] = seen(view, self);
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
