//! The structure of a built scene: verticals along gravity, and horizontal edges along one heading and across
//! it ("Manhattan world", Coughlan and Yuille 1999).
//!
//! A landmark line that belongs to the structure has a known direction `d` in `O`:
//!
//! ```text
//! vertical (0, 0, 1)    along (cos psi, sin psi, 0)    across (-sin psi, cos psi, 0)
//! ```
//!
//! with the heading `psi` of the structure one more state of the window. Verticals hold roll and pitch. `psi` is
//! never known better than the yaw of the frames that found it, but it does not drift: while the structure is
//! seen, neither does yaw. Turning `O` about gravity turns `psi` and all frames alike, so that yaw of the whole
//! stays unobservable.
//!
//! The factor is what `d` has across the line, `u1` and `u3` being the line's axes in its host camera
//! ([`super::line`]): out of the plane of line and camera, and across the line in that plane.
//!
//! ```text
//! r = [u1 u3]' R_CB R_BO d / sigma
//! ```
//!
//! It tells the line what it does not measure itself, so that no measurement counts twice. `sigma` is how
//! truly edges are built.

use super::feature::{BodyPose, Jacobians};
use super::line::HostedLine;
use super::state::Mount;
use crate::geometry::skew;
use nalgebra::{Matrix2x3, Matrix2x4, Matrix3, SMatrix, Vector2, Vector3};
use plumbline_config::options::LinesConfig;

/// A direction of the structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Along gravity.
    Vertical,
    /// Horizontal, along the heading.
    Along,
    /// Horizontal, across the heading.
    Across,
}

impl Axis {
    /// All directions, in the order in which they are tried.
    pub const ALL: [Self; 3] = [Self::Vertical, Self::Along, Self::Across];
}

/// Which structure is used, and how truly it is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ManhattanOptions {
    /// Vertical edges are used.
    pub verticals: bool,
    /// Horizontal edges along and across the heading are used.
    pub vanishing_directions: bool,
    /// Standard deviation of an edge from its direction, rad.
    pub sigma_rad: f64,
}

impl ManhattanOptions {
    /// The options that a configuration asks for.
    #[must_use]
    pub fn of(lines: &LinesConfig) -> Self {
        Self {
            verticals: lines.use_verticals,
            vanishing_directions: lines.use_vanishing_directions,
            sigma_rad: lines.structure_sigma_deg.to_radians(),
        }
    }
}

/// The structure as known so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Manhattan {
    /// Options.
    pub options: ManhattanOptions,
    /// Heading of the structure in `O`, rad; `None` while no horizontal structure is known.
    pub heading_rad: Option<f64>,
}

impl Manhattan {
    /// No horizontal structure as yet.
    #[must_use]
    pub fn new(options: ManhattanOptions) -> Self {
        Self { options, heading_rad: None }
    }

    /// Unit vector of a direction in `O`; `None` where it is unknown or not used.
    #[must_use]
    pub fn direction_o(&self, axis: Axis) -> Option<Vector3<f64>> {
        if axis == Axis::Vertical {
            return self.options.verticals.then(Vector3::z);
        }
        let (sin, cos) = self.heading_rad.filter(|_| self.options.vanishing_directions)?.sin_cos();
        Some(match axis {
            Axis::Across => Vector3::new(-sin, cos, 0.0),
            _ => Vector3::new(cos, sin, 0.0),
        })
    }

    /// The heading after the step `d`, where there is one.
    pub fn turn(&mut self, d: f64) {
        if let Some(heading) = &mut self.heading_rad {
            *heading += d;
        }
    }

    /// The direction to which `line` belongs, in its host's body and along the three axes of the line.
    fn seen_by(&self, line: &HostedLine, host: &BodyPose, mount: &Mount) -> Option<[Vector3<f64>; 2]> {
        let d_b = host.rot_o_b.tr_mul(&self.direction_o(line.axis?)?);
        Some([d_b, line.axes.tr_mul(&mount.rot_b_c.tr_mul(&d_b))])
    }

    /// How far `line` is from the direction to which it belongs, in standard deviations.
    #[must_use]
    pub fn residual(&self, line: &HostedLine, host: &BodyPose, mount: &Mount) -> Option<Vector2<f64>> {
        let [_, d_u] = self.seen_by(line, host, mount)?;
        Some(Vector2::new(d_u.x, d_u.z) / self.options.sigma_rad)
    }

    /// Derivatives of [`Self::residual`] by the host's pose, the rig and the line (no observer takes part), and
    /// by the heading.
    #[must_use]
    pub fn jacobians(
        &self,
        line: &HostedLine,
        host: &BodyPose,
        mount: &Mount,
    ) -> Option<(Jacobians<4>, Vector2<f64>)> {
        let [d_b, d_u] = self.seen_by(line, host, mount)?;
        let (u1, u3) = (line.axes.column(0), line.axes.column(2));
        let by_c = Matrix2x3::from_rows(&[u1.transpose(), u3.transpose()]) / self.options.sigma_rad;
        let by_b = by_c * mount.rot_b_c.transpose();
        let mut by_host = SMatrix::<f64, 2, 6>::zeros();
        by_host.fixed_view_mut::<2, 3>(0, 3).copy_from(&(by_b * skew(&d_b)));
        let mut by_mount = SMatrix::<f64, 2, 6>::zeros();
        by_mount.fixed_view_mut::<2, 3>(0, 3).copy_from(&(by_c * skew(&mount.rot_b_c.tr_mul(&d_b))));
        let mut rig = SMatrix::<f64, 2, 13>::zeros();
        rig.fixed_view_mut::<2, 12>(0, 0).copy_from(&(by_mount * mount.by_rig));
        let (x, y, z) = (d_u.x, d_u.y, d_u.z);
        let landmark = Matrix2x4::new(0.0, -z, y, 0.0, -y, x, 0.0, 0.0) / self.options.sigma_rad;
        // A horizontal direction turns with the heading; for verticals this is exactly zero.
        let d_o_by_heading = Vector3::z().cross(&self.direction_o(line.axis?)?);
        let by_heading = by_b * host.rot_o_b.tr_mul(&d_o_by_heading);
        Some((Jacobians { host: by_host, target: SMatrix::zeros(), rig, landmark }, by_heading))
    }

    /// The direction to which a line with a depth belongs, `rot_o_c` being the attitude of its host camera.
    /// One that it belonged to holds it within twice the gates.
    #[must_use]
    pub fn axis_of(&self, line: &HostedLine, rot_o_c: &Matrix3<f64>) -> Option<Axis> {
        let is_level = (rot_o_c * line.axes.column(0)).xy().norm() < MIN_TILT;
        let passes = |axis: &Axis, scale: f64| {
            self.direction_o(*axis).filter(|_| !is_level).is_some_and(|d| {
                let d = line.axes.tr_mul(&rot_o_c.tr_mul(&d));
                d.x.abs() < scale * PLANE_GATE && d.z.abs() < scale * SLOPE_GATE
            })
        };
        match &line.axis {
            Some(axis) if passes(axis, RELEASE) => Some(*axis),
            _ => Axis::ALL.into_iter().find(|axis| passes(axis, 1.0)),
        }
    }
}

/// A line belongs to a direction when that lies within this angle of the plane through line and camera, which
/// is measured well, rad ...
const PLANE_GATE: f64 = 0.006;
/// ... and within this one of the line in that plane, which only parallax tells, rad. It tells directions of the
/// structure apart; all are further from each other than twice this.
const SLOPE_GATE: f64 = 0.1;
/// The plane of an edge level with the camera holds horizontal directions of all headings: within this angle of
/// the horizontal it does not tell, rad.
const MIN_TILT: f64 = 0.25;
/// Gates are this much wider for a line that is taken to belong already.
const RELEASE: f64 = 2.0;

#[cfg(test)]
#[path = "manhattan_tests.rs"]
mod tests;
