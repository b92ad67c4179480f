//! Options of line segments: extraction, description, matching and their use in the window.

use serde::{Deserialize, Serialize};

/// Line segments and line landmarks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinesConfig {
    /// Extract and use lines.
    pub enabled: bool,
    /// Smallest gradient of an edge pixel, grey levels per pixel. Edges are found at half the resolution: there 0.7 of it counts,
    /// per halved pixel.
    pub min_gradient: f64,
    /// Shortest raw segment, px.
    pub min_raw_length_px: f64,
    /// The adaptive length threshold (equation 1 of the paper) is in force.
    pub length_filter: bool,
    /// Broken segments are joined (figure 4 of the paper).
    pub merge: bool,
    /// The outer rectangle of a segment is widened by this much across, px.
    pub merge_across_px: f64,
    /// Widening of a segment's outer rectangle along the segment for joining, px.
    pub merge_along_px: f64,
    /// Floor of the angle threshold of merging, degrees.
    pub merge_angle_deg: f64,
    /// Work of an image, in edge pixels visited: when it is spent the strongest segments so far are used.
    pub max_visits: usize,
    /// Largest number of raw segments of an image.
    pub max_raw: usize,
    /// Largest number of segments of an image that are refined at full resolution, described and matched: the longest
    /// of highest contrast.
    pub max_segments: usize,
    /// Largest Hamming distance of a match, of 256 bits.
    pub max_hamming: u32,
    /// Largest ratio of the distances of the best and the second best match.
    pub max_hamming_ratio: f64,
    /// Largest number of line landmarks in the window.
    pub max_landmarks: usize,
    /// Standard deviation of the end points of a segment across it, px.
    pub sigma_px: f64,
    /// Lines that are nearly vertical are held along gravity.
    pub use_verticals: bool,
    /// Horizontal lines along one heading, and those across it, are held to these vanishing directions.
    pub use_vanishing_directions: bool,
    /// Standard deviation of lines from the vertical or the vanishing direction they are held to, degrees.
    pub structure_sigma_deg: f64,
}

impl Default for LinesConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            min_gradient: 8.0,
            min_raw_length_px: 22.0,
            length_filter: true,
            merge: true,
            merge_across_px: 1.0,
            merge_along_px: 10.0,
            merge_angle_deg: 2.0,
            max_visits: 24_000,
            max_raw: 1000,
            max_segments: 48,
            max_hamming: 60,
            max_hamming_ratio: 0.75,
            max_landmarks: 120,
            sigma_px: 0.2,
            use_verticals: true,
            use_vanishing_directions: true,
            structure_sigma_deg: 0.1,
        }
    }
}
