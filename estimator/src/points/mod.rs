//! Point features: corners, tracking, stereo matching, outlier rejection.
//!
//! A reader starts at [`PointTracker`]. What a frame goes through:
//!
//! 1. [`flow`]: from the previous image by pyramidal flow, guess and warp from the gyroscope's rotation;
//! 2. [`template`]: refined against the patch of the track's first sight, so that errors do not add up;
//! 3. [`outliers`]: what no motion of the camera explains goes;
//! 4. [`pairing`] and [`stereo`]: the same point in the other camera, against the same first patch;
//! 5. [`corners`]: new points where the image has none.
//!
//! Where texture repeats ([`repetition`]), points are looked for where the window predicts them ([`prediction`]), by a turn that corners
//! of their own may correct ([`witness`]).

mod affine_sums;
pub mod align;
pub mod corners;
pub mod flow;
pub mod outliers;
mod pairing;
pub mod prediction;
mod repetition;
pub mod rig;
pub mod stereo;
pub mod template;
mod temporal;
mod track;
pub mod tracker;
mod witness;

#[cfg(test)]
mod tests;

pub use tracker::{PointTracker, TrackerInput};

use nalgebra::{Matrix2, Vector2};

/// One tracked point in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointObservation {
    /// Id of the track: unique since the tracker was made, never used again.
    pub track_id: u32,
    /// Frames in which it has been seen, this one included.
    pub age: u32,
    /// Pixel in the left and right image (distorted, as measured), where seen.
    pub px: [Option<Vector2<f64>>; 2],
    /// Ideal normalized coordinates in the left and right camera, where seen: the direction at the time of the row, in the
    /// axes that the camera has at the time of the frame.
    pub xy: [Option<Vector2<f64>>; 2],
    /// Covariance of the pixels against the reference patch, by its texture and its residual, px².
    pub covariance_px2: [Matrix2<f32>; 2],
}
