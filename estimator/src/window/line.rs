//! The reprojection factor of a line.
//!
//! A landmark is the line's Pluecker coordinates `(n, v)` in the camera that hosts it: `v` along the line,
//! `n = p x v` the normal of the plane through the line and the camera (paper, equation 2 with the sign that
//! its equations 3 to 5 need). They are kept in the orthonormal representation (equations 7 and 8)
//!
//! ```text
//! n = cos(phi) u1    v = sin(phi) u2    U = [u1 u2 u1 x u2]    U <- U Exp(d[0..3])    phi <- phi + d[3]
//! ```
//!
//! which has four parameters and no constraint; `cot(phi)` is the line's distance from the camera. A motion
//! `x' = A x + b` takes a line to `n' = A n + b x (A v)`, `v' = A v` (equation 4). The observer sees the
//! line where the plane of its `n` cuts the image; the residual is the distance of the measured end points
//! `z` from there (equation 9), in standard deviations:
//!
//! ```text
//! r_i = w_i (z_i' n / |n.xy| + rate_i (td - td_frame))
//! ```
//!
//! Equations 10 and 11 give the derivatives by the camera's pose; here it is moved in `O` and on its mount ([`super::motions`]).

use super::camera_poses::{CameraMotion, CameraPose, CameraView};
use super::feature::{Estimated, Feature, Jacobians};
use super::quad::{Quad, QuadMatrix, cross, quad};
use super::seen_by_row::SeenByRow;
use crate::geometry::exp_so3;
use nalgebra::{Matrix2x3, Matrix3, Vector2, Vector3, Vector4};

/// Smallest share of `n` in the image plane. Below it the plane of the line meets the image a thousand units
/// out; a line through the camera has no plane at all.
const MIN_TRACE: f64 = 1e-3;

/// A line in its host camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostedLine {
    /// `U`: normal, direction and their product.
    pub axes: Matrix3<f64>,
    /// `phi`, rad.
    pub phi: f64,
}

/// Measurement of a line by a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineMeasurement {
    /// Normalized coordinates of the end points, in the order of the edge's orientation.
    pub ends_xy: [Vector2<f64>; 2],
    /// Rate of the distances of the end points from the moving line, 1/s.
    pub rates: [f64; 2],
    /// Root of the information of the end points across the line: standard deviations per unit.
    pub weights: [f64; 2],
    /// Observations of the end points by their rows; [`Self::ends_xy`] are corrected for the motion of the camera between row
    /// and frame.
    pub rows: [SeenByRow; 2],
}

impl LineMeasurement {
    /// Normal of the plane through the camera and the measured segment, not of unit length.
    pub fn normal(&self) -> Vector3<f64> {
        ray(&self.ends_xy[0]).cross(&ray(&self.ends_xy[1]))
    }

    /// The measurement with the rates of a far line in a camera that turns with `rate_c`, rad/s.
    pub fn turning(self, rate_c: &Vector3<f64>) -> Self {
        let n = self.normal();
        let rates = self.rates_of(&n, &-rate_c.cross(&n));
        Self { rates: rates.unwrap_or([0.0; 2]), ..self }
    }

    /// Rates of the distances from the line of `n` when that changes by `n_rate`.
    fn rates_of(&self, n: &Vector3<f64>, n_rate: &Vector3<f64>) -> Option<[f64; 2]> {
        let by_n = self.distances_by_normal(n)? * n_rate;
        Some([by_n[0], by_n[1]])
    }

    /// Where a global shutter would have measured the end points of a line of normal `n` at the time of the frame, which the way
    /// of the camera changes by `n_by_way` in a second: as far from the line as the rows saw them.
    fn ends_at_frame(&self, n: &Vector3<f64>, n_by_way: &Vector3<f64>) -> [Vector2<f64>; 2] {
        let mut ends_xy = self.ends_xy;
        for (end, SeenByRow { xy, late_s }) in ends_xy.iter_mut().zip(&self.rows) {
            let by_row = n + n_by_way * *late_s;
            let (trace, trace_by_row) = (n.xy().norm(), by_row.xy().norm());
            if *late_s != 0.0 && trace_by_row > MIN_TRACE * by_row.norm() && trace > MIN_TRACE * n.norm() {
                let off = ray(xy).dot(&by_row) / trace_by_row - ray(xy).dot(n) / trace;
                *end = xy + n.xy() * (off / trace);
            }
        }
        ends_xy
    }

    /// Distances of the end points from the trace of the plane of `n`.
    fn distances(&self, n: &Vector3<f64>) -> Option<[f64; 2]> {
        let trace = n.xy().norm();
        (trace > MIN_TRACE * n.norm()).then(|| self.ends_xy.map(|z| ray(&z).dot(n) / trace))
    }

    /// Their derivatives by `n`.
    fn distances_by_normal(&self, n: &Vector3<f64>) -> Option<Matrix2x3<f64>> {
        let distances = self.distances(n)?;
        let trace = n.xy().norm();
        let mut by_n = Matrix2x3::zeros();
        for (k, (z, distance)) in self.ends_xy.iter().zip(distances).enumerate() {
            let row = (ray(z) - Vector3::new(n.x, n.y, 0.0) * (distance / trace)) / trace;
            by_n.set_row(k, &row.transpose());
        }
        Some(by_n)
    }
}

/// Direction of normalized coordinates.
fn ray(xy: &Vector2<f64>) -> Vector3<f64> {
    Vector3::new(xy.x, xy.y, 1.0)
}

/// Normal and direction of a line in one frame.
#[derive(Clone, Copy, Debug)]
struct Pluecker {
    n: Vector3<f64>,
    v: Vector3<f64>,
}

impl Pluecker {
    /// In a frame with `x' = rot x + p`.
    fn moved(&self, rot: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        let v = rot * self.v;
        Self { n: rot * self.n + p.cross(&v), v }
    }

    /// The normal in a frame with `x' = rot' (x - p)`.
    fn normal_from(&self, rot: &Matrix3<f64>, p: &Vector3<f64>) -> Vector3<f64> {
        rot.tr_mul(&(self.n - p.cross(&self.v)))
    }

    /// In a frame with `x' = rot' (x - p)`.
    fn moved_back(&self, rot: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        Self { n: self.normal_from(rot, p), v: rot.tr_mul(&self.v) }
    }
}

impl HostedLine {
    /// Stands for a line that waits for its triangulation.
    pub const UNKNOWN: Self =
        Self { axes: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), phi: 0.0 };

    /// The line with these Pluecker coordinates, of any scale; `None` through the camera.
    pub fn of(n: &Vector3<f64>, v: &Vector3<f64>) -> Option<Self> {
        let u1 = n.try_normalize(1e-12)?;
        // Errors may have left a part of `v` along `n`.
        let across = v - u1 * u1.dot(v);
        let u2 = across.try_normalize(1e-12)?;
        let axes = Matrix3::from_columns(&[u1, u2, u1.cross(&u2)]);
        Some(Self { axes, phi: libm::atan2(across.norm(), n.norm()) })
    }

    fn pluecker(&self) -> Pluecker {
        let (sin, cos) = libm::sincos(self.phi);
        Pluecker { n: self.axes.column(0) * cos, v: self.axes.column(1) * sin }
    }

    /// Distance of the point that the host sees at `xy`, along its optical axis, m; negative behind.
    /// Infinite for a line at infinity.
    pub fn depth_at(&self, xy: &Vector2<f64>) -> f64 {
        let Pluecker { n, v } = self.pluecker();
        // x = depth * ray lies on the line: depth (ray x v) = n.
        let side = ray(xy).cross(&v);
        n.dot(&side) / side.norm_squared()
    }
}

/// A landmark in its host's camera and in `O`, from the pivot.
#[derive(Clone, Copy, Debug)]
pub struct PlacedLine {
    axes: Matrix3<f64>,
    /// Sine and cosine of `phi`.
    sin_cos: (f64, f64),
    h: Pluecker,
    o: Pluecker,
}

impl PlacedLine {
    /// The line in the observer's camera.
    fn seen_from(&self, target: &CameraPose) -> Pluecker {
        self.o.moved_back(&target.rot_o_c, &target.p_o_c)
    }

    /// Derivative by the four parameters, where those by `n` and `v` in the host's camera are given.
    #[inline]
    fn by_parameters(&self, axes: &QuadMatrix, by_n: &Quad, by_v: &Quad) -> [f64; 4] {
        let (sin, cos) = self.sin_cos;
        // A turn of the axes by d moves u1 by d2 u3 - d3 u2 (with the other sign), u2 by d1 u3 - d3 u1.
        let (n, v) = (axes.transpose_times(by_n), axes.transpose_times(by_v));
        [v[2] * sin, -n[2] * cos, n[1] * cos - v[0] * sin, v[1] * cos - n[0] * sin]
    }
}

impl Feature for HostedLine {
    type Measurement = LineMeasurement;
    type Jacobians = Jacobians<4>;
    type Placed = PlacedLine;

    fn placed(&self, host: &CameraPose) -> PlacedLine {
        let (sin, cos) = libm::sincos(self.phi);
        let h = Pluecker { n: self.axes.column(0) * cos, v: self.axes.column(1) * sin };
        PlacedLine { axes: self.axes, sin_cos: (sin, cos), h, o: h.moved(&host.rot_o_c, &host.p_o_c) }
    }

    #[inline]
    fn residual_of(
        placed: &PlacedLine,
        target: &CameraPose,
        measured: &LineMeasurement,
        time_offset_step_s: f64,
    ) -> Option<Vector2<f64>> {
        let n = placed.o.normal_from(&target.rot_o_c, &target.p_o_c);
        // The edge has a sense: seen the other way round it lies behind the camera.
        if n.dot(&measured.normal()) <= 0.0 {
            return None;
        }
        let [a, b] = measured.distances(&n)?;
        let [wa, wb] = measured.weights;
        let [ra, rb] = measured.rates.map(|rate| rate * time_offset_step_s);
        Some(Vector2::new(wa * (a + ra), wb * (b + rb)))
    }

    #[inline]
    fn weighed(measured: &LineMeasurement, scale: f64) -> LineMeasurement {
        LineMeasurement { weights: measured.weights.map(|weight| weight * scale), ..*measured }
    }

    #[inline]
    fn places(measured: &LineMeasurement) -> [Vector2<f64>; 2] {
        measured.ends_xy
    }

    #[inline]
    fn by_places(
        placed: &PlacedLine,
        target: &CameraPose,
        measured: &LineMeasurement,
    ) -> Option<[Vector2<f64>; 2]> {
        let n = placed.o.normal_from(&target.rot_o_c, &target.p_o_c);
        let trace = n.xy().norm();
        (trace > MIN_TRACE * n.norm()).then(|| measured.weights.map(|weight| n.xy() * (weight / trace)))
    }

    #[inline]
    fn move_places(measured: &mut LineMeasurement, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>) {
        measured.ends_xy.iter_mut().for_each(|xy| *xy += shift(xy));
    }

    fn move_all_places(measured: &mut LineMeasurement, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>) {
        measured.rows.iter_mut().for_each(|row| row.shift(&shift));
        Self::move_places(measured, shift);
    }

    /// `None` where the observer's plane has no trace in its image. In the axes of a camera a motion `(t, theta)` moves the
    /// line's normal there by `theta x n + t x v`, its direction by `theta x v`, as in `O`.
    fn linearize(
        placed: &PlacedLine,
        CameraView { host, target }: CameraView<'_>,
        measured: &LineMeasurement,
        j: &mut Jacobians<4>,
    ) -> Option<()> {
        let PlacedLine { h, o, .. } = placed;
        let c = placed.seen_from(target);
        let by_n = measured.distances_by_normal(&c.n)?;
        let axes = QuadMatrix::of(&placed.axes);
        let [arm, p] = [host.p_o_c - target.p_o_c, target.p_o_c].map(|x| quad(&x));
        let [h, o, c] = [h, o, &c].map(|line| [quad(&line.n), quad(&line.v)]);
        let by_turn = |[n, v]: &[Quad; 2], by_n: &Quad, by_v: &Quad| {
            let (by_n, by_v) = (cross(n, by_n), cross(v, by_v));
            [0, 1, 2, 3].map(|k| by_n[k] + by_v[k])
        };
        for d in 0..2 {
            let by_c = [0, 1, 2, 3].map(|k| if k < 3 { by_n[(d, k)] * measured.weights[d] } else { 0.0 });
            let by_o = target.lanes.times(&by_c);
            let by_o_v = cross(&p, &by_o);
            let by_h = host.lanes.transpose_times(&by_o);
            let by_h_v = host.lanes.transpose_times(&cross(&by_o, &arm));
            j.camera[d] = [cross(&o[1], &by_o), by_turn(&o, &by_o, &by_o_v)];
            j.host[d] = [cross(&h[1], &by_h), by_turn(&h, &by_h, &by_h_v)];
            j.target[d] = [cross(&c[1], &by_c), cross(&c[0], &by_c)];
            for (k, by) in placed.by_parameters(&axes, &by_h, &by_h_v).into_iter().enumerate() {
                j.landmark[(d, k)] = by;
            }
            j.time_offset[d] = measured.weights[d] * measured.rates[d];
        }
        Some(())
    }

    /// In the axes of the camera `n' = -w x n - velocity x v`.
    fn with_rate(
        &self,
        view: CameraView<'_>,
        measured: &LineMeasurement,
        CameraMotion { rate_c, v_c }: &CameraMotion,
    ) -> Option<LineMeasurement> {
        let Pluecker { n, v } = self.placed(view.host).seen_from(view.target);
        let n_by_way = -v_c.cross(&v);
        let rates = measured.rates_of(&n, &(n_by_way - rate_c.cross(&n)))?;
        Some(LineMeasurement { rates, ends_xy: measured.ends_at_frame(&n, &n_by_way), ..*measured })
    }

    fn hosted_by_target(&self, view: CameraView<'_>) -> Option<Self> {
        let Pluecker { n, v } = self.placed(view.host).seen_from(view.target);
        Self::of(&n, &v)
    }
}

impl Estimated<4> for HostedLine {
    fn plus(&self, d: &Vector4<f64>) -> Self {
        let turned = self.axes * exp_so3(&d.xyz()).to_rotation_matrix().into_inner();
        // Rounding must not add up: the columns are made orthonormal again.
        let u1 = turned.column(0).normalize();
        let u2 = (turned.column(1) - u1 * u1.dot(&turned.column(1))).normalize();
        Self { axes: Matrix3::from_columns(&[u1, u2, u1.cross(&u2)]), phi: self.phi + d[3] }
    }
}

#[cfg(test)]
#[path = "line_tests.rs"]
mod tests;
