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
//! A motion `(t, theta)` of the host's camera moves `q_o` by `rho t + theta x q_o` ([`super::motions`]).
//! `W` takes normalized coordinates to pixels over their standard deviation at the observed place, so
//! `r` is in standard deviations. Source: the landmark of VINS-Mono (Qin et
//! al. 2018, section V) with the bearing estimated as well, as in basalt (Usenko et al. 2019).

use super::camera_poses::{CameraMotion, CameraPose, CameraView};
use super::feature::{Estimated, Feature, Jacobians};
use super::options::Options;
use super::quad::{Quad, cross, dot3, quad, scaled};
use super::seen_by_row::SeenByRow;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Smallest forward component of `q_ct`: the landmark is in front of the observing camera.
pub(super) const MIN_FORWARD: f64 = 0.02;
/// Landmarks stay within this inverse depth, 1/m.
const MAX_INVERSE_DEPTH: f64 = 10.0;
/// A little behind infinity is noise of a far point.
const MIN_INVERSE_DEPTH: f64 = -0.02;
/// Factor on the covariance of a patch's alignment, which assumes independent residuals of neighbouring pixels; they are not. Measured
/// likewise; with two cameras the window follows what it is in the flight.
pub const PATCH_VARIANCE: f64 = 16.0;

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
    /// Observation by its row; [`Self::xy`] is corrected for the motion of the camera between row and frame.
    pub row: SeenByRow,
}

/// A landmark in `O`, from the pivot.
#[derive(Clone, Copy, Debug)]
pub struct PlacedPoint {
    /// Its bearing in the host's camera.
    bearing: Quad,
    rho: f64,
    q_o: Quad,
}

impl PlacedPoint {
    #[inline(always)]
    fn seen_from(&self, target: &CameraPose) -> Quad {
        let p = quad(&target.p_o_c);
        let mut q = self.q_o;
        for k in 0..4 {
            q[k] -= p[k] * self.rho;
        }
        target.lanes.transpose_times(&q)
    }

    /// In the axes of a camera a motion `(t, theta)` moves the landmark there by `rho t + theta x q`, as in `O`. A function of its own,
    /// whose results lie in memory: among all that its caller holds in registers, the compiler takes values one by one.
    #[inline(never)]
    fn linearize(
        &self,
        CameraView { host, target }: CameraView<'_>,
        weight: &Matrix2<f64>,
        j: &mut Jacobians<3>,
    ) -> Option<()> {
        let Self { bearing, rho, q_o } = self;
        let q_c = self.seen_from(target);
        let [x, y, z, _] = q_c;
        if z <= MIN_FORWARD {
            return None;
        }
        let iz = 1.0 / z;
        let arm = quad(&(host.p_o_c - target.p_o_c));
        for d in 0..2 {
            let (wx, wy) = (weight[(d, 0)] * iz, weight[(d, 1)] * iz);
            let by_c = [wx, wy, -(wx * x + wy * y) * iz, 0.0];
            let by_o = target.lanes.times(&by_c);
            let by_h = host.lanes.transpose_times(&by_o);
            j.camera[d] = [scaled(&by_o, *rho), cross(q_o, &by_o)];
            j.host[d] = [scaled(&by_h, *rho), cross(bearing, &by_h)];
            j.target[d] = [scaled(&by_c, *rho), cross(&q_c, &by_c)];
            (j.landmark[(d, 0)], j.landmark[(d, 1)]) = (by_h[0], by_h[1]);
            j.landmark[(d, 2)] = dot3(&by_o, &arm);
        }
        Some(())
    }
}

impl InversePoint {
    /// Where a global shutter would have measured what a row saw of the point, whose direction in the observer is `q_c` at the
    /// time of the frame; `v_c` is the observer's velocity in its axes, m/s.
    fn at_frame(&self, measured: &PointMeasurement, q_c: &Vector3<f64>, v_c: &Vector3<f64>) -> Vector2<f64> {
        let SeenByRow { xy, late_s } = measured.row;
        if late_s == 0.0 {
            return measured.xy;
        }
        let by_row = q_c - v_c * (self.rho * late_s);
        match by_row.z > MIN_FORWARD {
            true => xy + (q_c.xy() / q_c.z - by_row.xy() / by_row.z),
            false => measured.xy,
        }
    }

    /// Direction of the landmark in the observer; `None` behind it.
    fn direction(&self, view: CameraView<'_>) -> Option<Vector3<f64>> {
        let [x, y, z, _] = self.placed(view.host).seen_from(view.target);
        (z > MIN_FORWARD).then(|| Vector3::new(x, y, z))
    }

    /// Where the observer sees the landmark, in normalized coordinates; `None` behind it.
    pub fn project(&self, view: CameraView<'_>) -> Option<Vector2<f64>> {
        self.direction(view).map(|q_c| q_c.xy() / q_c.z)
    }
}

impl Feature for InversePoint {
    type Measurement = PointMeasurement;
    type Jacobians = Jacobians<3>;
    type Placed = PlacedPoint;

    fn outlier_sigmas(options: &Options) -> f64 {
        options.point_outlier_sigmas
    }

    #[inline]
    fn sigma(options: &Options) -> f64 {
        options.point_sigma
    }

    #[inline]
    fn placed(&self, host: &CameraPose) -> PlacedPoint {
        let bearing = Vector3::new(self.xy.x, self.xy.y, 1.0);
        let q_o = host.rot_o_c * bearing + host.p_o_c * self.rho;
        PlacedPoint { bearing: quad(&bearing), rho: self.rho, q_o: quad(&q_o) }
    }

    #[inline]
    fn residual_of(
        placed: &PlacedPoint,
        target: &CameraPose,
        measured: &PointMeasurement,
        time_offset_step_s: f64,
    ) -> Option<Vector2<f64>> {
        let [x, y, z, _] = placed.seen_from(target);
        if z <= MIN_FORWARD {
            return None;
        }
        let predicted = Vector2::new(x, y) * (1.0 / z);
        let off = predicted - measured.xy + measured.xy_rate * time_offset_step_s;
        let weight = &measured.weight;
        // Written out: the general product is a loop that keeps its sums in memory.
        Some(Vector2::new(weight.m11 * off.x + weight.m12 * off.y, weight.m21 * off.x + weight.m22 * off.y))
    }

    #[inline]
    fn weighed(measured: &PointMeasurement, scale: f64) -> PointMeasurement {
        PointMeasurement { weight: measured.weight * scale, ..*measured }
    }

    #[inline]
    fn places(measured: &PointMeasurement) -> [Vector2<f64>; 2] {
        [measured.xy; 2]
    }

    #[inline]
    fn by_places(_: &PlacedPoint, _: &CameraPose, measured: &PointMeasurement) -> Option<[Vector2<f64>; 2]> {
        let w = &measured.weight;
        Some([-Vector2::new(w.m11, w.m12), -Vector2::new(w.m21, w.m22)])
    }

    #[inline]
    fn move_places(measured: &mut PointMeasurement, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>) {
        measured.xy += shift(&measured.xy);
    }

    fn move_all_places(measured: &mut PointMeasurement, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>) {
        measured.row.shift(&shift);
        Self::move_places(measured, shift);
    }

    #[inline]
    fn linearize(
        placed: &PlacedPoint,
        view: CameraView<'_>,
        measured: &PointMeasurement,
        j: &mut Jacobians<3>,
    ) -> Option<()> {
        j.time_offset = measured.weight * measured.xy_rate;
        placed.linearize(view, &measured.weight, j)
    }

    /// `q_c' = -w x q_c - rho v`.
    fn with_rate(
        &self,
        view: CameraView<'_>,
        measured: &PointMeasurement,
        CameraMotion { rate_c, v_c }: &CameraMotion,
    ) -> Option<PointMeasurement> {
        let q_c = self.direction(view)?;
        let d = -(rate_c.cross(&q_c) + v_c * self.rho);
        let xy_rate = (d.xy() - q_c.xy() * (d.z / q_c.z)) / q_c.z;
        Some(PointMeasurement { xy_rate, xy: self.at_frame(measured, &q_c, v_c), ..*measured })
    }

    fn hosted_by_target(&self, view: CameraView<'_>) -> Option<Self> {
        self.direction(view).map(|q_c| Self { xy: q_c.xy() / q_c.z, rho: self.rho / q_c.z })
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
