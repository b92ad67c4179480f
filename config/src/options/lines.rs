//! Options of line segments: extraction, description, matching and their use in the window.

use plumbline_keys::keys;
use serde::{Deserialize, Serialize};

/// Line segments and line landmarks.
#[keys]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinesConfig {
    /// Extract and use lines.
    #[key(default = true)]
    pub enabled: bool,
    /// Smallest gradient of an edge pixel, grey levels per pixel. Edges are detected at half the resolution, with a
    /// threshold of 0.7 times this value per half-resolution pixel.
    #[key(default = 8.0, range = 0.5..=200.0, cure = "write it in grey levels per pixel")]
    pub min_gradient: f64,
    /// Shortest raw segment, px.
    #[key(default = 22.0, range = 8.0..=500.0, unit = PIXELS, experiment)]
    pub min_raw_length_px: f64,
    /// Apply the adaptive length threshold.
    #[key(default = true, experiment)]
    pub length_filter: bool,
    /// Join broken segments.
    #[key(default = true, experiment)]
    pub merge: bool,
    /// Widening of a segment's outer rectangle across the segment for joining, px.
    #[key(default = 1.0, range = 0.0..=50.0, unit = PIXELS, experiment)]
    pub merge_across_px: f64,
    /// Widening of a segment's outer rectangle along the segment for joining, px.
    #[key(default = 10.0, range = 0.0..=200.0, unit = PIXELS, experiment)]
    pub merge_along_px: f64,
    /// Smallest angle threshold for joining, degrees.
    #[key(default = 2.0, range = 0.0..=45.0, unit = DEGREES, experiment)]
    pub merge_angle_deg: f64,
    /// Largest number of edge pixels visited in an image. At this limit, the strongest segments found so far are used.
    #[key(default = 24_000, range = 1000..=100_000_000)]
    pub max_visits: usize,
    /// Largest number of raw segments of an image.
    #[key(default = 1000, range = 8..=10_000, experiment)]
    pub max_raw: usize,
    /// Largest number of segments of an image that are refined and matched. Long segments of high contrast are
    /// preferred.
    #[key(default = 48, range = 8..=500)]
    pub max_segments: usize,
    /// Largest Hamming distance of a match, of 256 bits.
    #[key(default = 60, range = 1..=256, experiment)]
    pub max_hamming: u32,
    /// Largest ratio of the distances of the best and the second best match.
    #[key(default = 0.75, range = 0.1..=1.0, experiment)]
    pub max_hamming_ratio: f64,
    /// Largest number of line landmarks in the window.
    #[key(default = 120, range = 4..=2000, experiment)]
    pub max_landmarks: usize,
    /// Standard deviation of a segment's end points, across the segment. It is larger for real lenses than for
    /// simulated ones.
    #[key(default = 0.2, range = 0.01..=20.0, unit = PIXELS)]
    pub sigma_px: f64,
}
