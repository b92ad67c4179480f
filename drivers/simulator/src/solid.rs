//! Boxes: what furniture is made of, and what it must keep clear of.

use nalgebra::Vector3;
use plumbline_config::Portable;

/// An axis-aligned box, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) low: Vector3<f64>,
    pub(super) high: Vector3<f64>,
}

impl Bounds {
    /// The smallest box around `points` (there must be one).
    pub(super) fn around(points: &[Vector3<f64>]) -> Self {
        let first = points[0];
        points
            .iter()
            .fold(Self { low: first, high: first }, |b, p| Self { low: b.low.inf(p), high: b.high.sup(p) })
    }

    /// Distance of `p` from the box, 0 inside.
    pub(super) fn distance(&self, p: &Vector3<f64>) -> f64 {
        (p - p.sup(&self.low).inf(&self.high)).norm()
    }

    pub(super) fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] < other.high[k] && other.low[k] < self.high[k])
    }
}

/// An upright box: centre, half extents, turned about z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solid {
    pub(super) centre: Vector3<f64>,
    pub(super) half: Vector3<f64>,
    pub(super) yaw: f64,
}

impl Solid {
    /// A box of `size` that stands on `foot`.
    pub(super) fn standing(foot: Vector3<f64>, size: [f64; 3], yaw: f64) -> Self {
        let half = Vector3::from(size) * 0.5;
        Self { centre: foot + Vector3::new(0.0, 0.0, half.z), half, yaw }
    }

    /// Directions of the box's x and y.
    pub(super) fn axes(&self) -> [Vector3<f64>; 2] {
        let (sin, cos) = libm::sincos(self.yaw);
        [Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0)]
    }

    /// True if the solid blocks the straight way from `a` to `b`.
    pub(super) fn blocks(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        let way = b - a;
        let along = ((self.centre - a).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
        if (a + way * along - self.centre).norm_squared() > self.half.norm_squared() {
            return false;
        }
        let axes = self.axes();
        let local = |v: &Vector3<f64>| Vector3::new(v.dot(&axes[0]), v.dot(&axes[1]), v.z);
        let (from, way) = (local(&(a - self.centre)), local(&way));
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for k in 0..3 {
            let (p, q) = ((-self.half[k] - from[k]) / way[k], (self.half[k] - from[k]) / way[k]);
            enter = enter.at_least(p.at_most(q));
            leave = leave.at_most(p.at_least(q));
        }
        enter < leave
    }

    /// The axis-aligned box around it.
    pub(super) fn bounds(&self) -> Bounds {
        let [a, b] = self.axes();
        let reach = a.abs() * self.half.x + b.abs() * self.half.y + Vector3::z() * self.half.z;
        Bounds { low: self.centre - reach, high: self.centre + reach }
    }
}
