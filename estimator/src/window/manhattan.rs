//! The Manhattan world: verticals along gravity, and horizontal edges along one heading and across it (Coughlan
//! and Yuille, "Manhattan World: Compass Direction from a Single Image by Bayesian Inference", 1999).
//!
//! A landmark line that belongs to it (a structural line) has a known direction `d` in `O`:
//!
//! ```text
//! vertical (0, 0, 1)    along (cos psi, sin psi, 0)    across (-sin psi, cos psi, 0)
//! ```
//!
//! with the heading `psi` one more state of the window. Its factor is [`super::manhattan_factor`].

use nalgebra::{Matrix3, Vector3};
use plumbline_config::options::LinesConfig;

/// A direction of the Manhattan world.
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

/// Which directions are used, and how truly buildings follow them.
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
    pub fn of(lines: &LinesConfig) -> Self {
        Self {
            verticals: lines.use_verticals,
            vanishing_directions: lines.use_vanishing_directions,
            sigma_rad: lines.structure_sigma_deg.to_radians(),
        }
    }
}

/// The Manhattan world as known so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Manhattan {
    /// Options.
    pub options: ManhattanOptions,
    /// Heading in `O` modulo 90 degrees, rad; `None` while no horizontal direction is known.
    pub heading_rad: Option<f64>,
    /// Number of vertical landmark lines in the window.
    pub verticals: usize,
}

impl Manhattan {
    /// No horizontal direction as yet.
    pub fn new(options: ManhattanOptions) -> Self {
        Self { options, heading_rad: None, verticals: 0 }
    }

    /// Unit vector of a direction in `O`; `None` where it is unknown or not used.
    pub fn direction_o(&self, axis: Axis) -> Option<Vector3<f64>> {
        if axis == Axis::Vertical {
            return self.options.verticals.then(Vector3::z);
        }
        let (sin, cos) = libm::sincos(self.heading_rad.filter(|_| self.options.vanishing_directions)?);
        Some(match axis {
            Axis::Across => Vector3::new(-sin, cos, 0.0),
            _ => Vector3::new(cos, sin, 0.0),
        })
    }

    /// Standard deviation of a line from the direction `axis`, rad. Walls lean together: all verticals weigh as much as one
    /// edge. The heading takes up what horizontal edges have in common.
    pub fn sigma_rad(&self, axis: Axis) -> f64 {
        let sharing = if axis == Axis::Vertical { self.verticals.max(1) } else { 1 };
        self.options.sigma_rad * (sharing as f64).sqrt()
    }

    /// The heading after the step `d`, rad, where there is one.
    pub fn turn(&mut self, d: f64) {
        if let Some(heading) = &mut self.heading_rad {
            *heading += d;
        }
    }

    /// The direction to which a line with a depth belongs, given its axes `U` ([`super::line`]) in its host camera,
    /// the attitude `rot_o_c` of that camera in `O`, and the direction `held` to which it has belonged. That one
    /// holds it within twice the gates.
    pub fn axis_of(&self, axes: &Matrix3<f64>, held: Option<Axis>, rot_o_c: &Matrix3<f64>) -> Option<Axis> {
        let is_level = (rot_o_c * axes.column(0)).xy().norm() < MIN_TILT;
        let passes = |axis: &Axis, scale: f64| {
            self.direction_o(*axis).filter(|_| !is_level).is_some_and(|d| {
                let d = axes.tr_mul(&rot_o_c.tr_mul(&d));
                d.x.abs() < scale * PLANE_GATE && d.z.abs() < scale * SLOPE_GATE
            })
        };
        match held {
            Some(axis) if passes(&axis, RELEASE) => Some(axis),
            _ => Axis::ALL.into_iter().find(|axis| passes(axis, 1.0)),
        }
    }
}

/// A line belongs to a direction when that lies within this angle of the plane through line and camera, which
/// is measured well, rad ...
const PLANE_GATE: f64 = 0.006;
/// ... and within this one of the line in that plane, which only parallax measures, rad. It tells the
/// directions apart: they differ from each other by more than twice this.
const SLOPE_GATE: f64 = 0.1;
/// The plane of an edge level with the camera holds horizontal directions of all headings: within this angle of
/// the horizontal it belongs to none, rad.
const MIN_TILT: f64 = 0.25;
/// Gates are this much wider for a line that is taken to belong already.
const RELEASE: f64 = 2.0;
