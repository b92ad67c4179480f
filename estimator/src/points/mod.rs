//! Point features: corners, tracking, stereo matching, outlier rejection.

use nalgebra::Vector2;

/// One tracked point in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointObservation {
    /// Names the track: unique since the tracker was made, never used again.
    pub track_id: u32,
    /// Frames in which it has been seen, this one included.
    pub age: u32,
    /// Pixel in the left and right image (distorted, as measured), where seen.
    pub px: [Option<Vector2<f64>>; 2],
    /// Ideal normalized coordinates in the left and right camera, where seen.
    pub xy: [Option<Vector2<f64>>; 2],
}
