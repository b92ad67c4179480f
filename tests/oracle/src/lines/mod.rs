//! Line segments of different detectors, comparable.

pub mod agreement;
pub mod detectors;
pub mod images;

pub use detectors::Detector;

use nalgebra::Vector2;
use plumbline_estimator::lines::Segment;

/// A segment of any detector, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// One end.
    pub start: Vector2<f64>,
    /// The other.
    pub end: Vector2<f64>,
}

impl Line {
    /// From `x1, y1, x2, y2`.
    pub fn new([x1, y1, x2, y2]: [f64; 4]) -> Self {
        Self { start: Vector2::new(x1, y1), end: Vector2::new(x2, y2) }
    }

    /// Length, px.
    pub fn length(&self) -> f64 {
        (self.end - self.start).norm()
    }

    /// Unit vector from start to end.
    pub fn direction(&self) -> Vector2<f64> {
        (self.end - self.start) / self.length().max(f64::MIN_POSITIVE)
    }

    /// Angle to another, whichever way both point, rad.
    pub fn angle(&self, other: &Self) -> f64 {
        let (a, b) = (self.direction(), other.direction());
        a.perp(&b).abs().atan2(a.dot(&b).abs())
    }

    /// Distance of a point from the segment, px.
    pub fn distance(&self, px: &Vector2<f64>) -> f64 {
        let along = self.direction().dot(&(px - self.start)).clamp(0.0, self.length());
        (px - self.start - self.direction() * along).norm()
    }
}

impl From<&Segment> for Line {
    fn from(segment: &Segment) -> Self {
        Self { start: segment.start.cast(), end: segment.end.cast() }
    }
}

/// Sorts longest first.
pub fn longest_first(lines: &mut [Line]) {
    lines.sort_by(|a, b| b.length().total_cmp(&a.length()));
}

/// The median; 0 of nothing.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// The value that the share `at` of all values do not exceed; 0 of nothing.
pub fn quantile(values: &[f64], at: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    sorted.get((at * last as f64).round() as usize).copied().unwrap_or_default()
}
