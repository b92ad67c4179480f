//! Images of a flight in figures: how long tracks live, how well they fit, and how many do not.
//!
//! The figures depend on the images and not on the truth, so that a recorded flight and a simulated one can be compared by them.
//! Memory is fixed: long flights cost no more than short ones.

mod fit;
mod lives;
mod watch;

pub use watch::TrackingWatch;

use plumbline_flight::schedule::times::Times;
use serde::{Deserialize, Serialize};

/// Median and 90 % of a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// Value that nine in ten do not exceed.
    pub p90: f64,
}

impl Spread {
    /// Spread of recorded values; `None` without one.
    fn of(values: &Times) -> Option<Self> {
        (values.count() > 0).then(|| Self { median: values.quantile(0.5), p90: values.quantile(0.9) })
    }
}

/// Residuals of points in the newest frame after its solution, px. Landmarks of that frame itself are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Residuals {
    /// Landmarks in their first 5 frames.
    pub young: Option<Spread>,
    /// Landmarks of 5 to 20 frames.
    pub grown: Option<Spread>,
    /// Landmarks of more than 20 frames.
    pub old: Option<Spread>,
    /// Within 0.6 of the angle between the optical axis and the corner of the image.
    pub centre: Option<Spread>,
    /// Beyond that.
    pub rim: Option<Spread>,
}

/// Tracks of one kind of feature.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    /// Tracked in a frame, mean.
    pub per_frame: f64,
    /// Seen by both cameras in a frame, mean.
    pub stereo: f64,
    /// Frames from the first sight to the last.
    pub frames: Option<Spread>,
}

/// Tracking figures of a flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackingFigures {
    /// Points.
    pub points: Tracks,
    /// Residuals of points.
    pub residuals_px: Residuals,
    /// Share of the points' observations in the window that were rejected as outliers.
    pub outliers: Option<f64>,
    /// Line segments of the left image that are tracked.
    pub lines: Tracks,
    /// Length of these segments, px.
    pub line_length_px: Option<Spread>,
}

impl TrackingFigures {
    /// All figures by name.
    #[must_use]
    pub fn named(&self) -> Vec<(&'static str, Option<f64>)> {
        let median = |spread: &Option<Spread>| spread.map(|s| s.median);
        let p90 = |spread: &Option<Spread>| spread.map(|s| s.p90);
        let r = &self.residuals_px;
        vec![
            ("points in a frame", Some(self.points.per_frame)),
            ("points by both cameras", Some(self.points.stereo)),
            ("frames of a point, median", median(&self.points.frames)),
            ("frames of a point, 90 %", p90(&self.points.frames)),
            ("residual px, up to 5 frames", median(&r.young)),
            ("residual px, 5 to 20 frames", median(&r.grown)),
            ("residual px, over 20 frames", median(&r.old)),
            ("residual px, centre", median(&r.centre)),
            ("residual px, rim", median(&r.rim)),
            ("outliers %", self.outliers.map(|share| 100.0 * share)),
            ("lines in a frame", Some(self.lines.per_frame)),
            ("line length px, median", median(&self.line_length_px)),
            ("line length px, 90 %", p90(&self.line_length_px)),
            ("frames of a line, median", median(&self.lines.frames)),
            ("frames of a line, 90 %", p90(&self.lines.frames)),
        ]
    }
}
