//! Questions of a calibration about an image, to be answered by OpenCV in the crate `plumbline-boards`.

use nalgebra::Vector2;
use plumbline_config::ImageView;

/// Failure of a detector.
pub type Fault = Box<dyn std::error::Error + Send + Sync>;
/// Places in an image, px.
pub type Places = Vec<Vector2<f64>>;
/// A marker's number, and its corners clockwise, px.
pub type Marker = (u32, [Vector2<f64>; 4]);

/// A search for corners near guesses, with windows of so many pixels to each side.
pub type Refine = fn(&ImageView<'_>, &[Vector2<f64>], usize) -> Result<Places, Fault>;

/// The eyes of a calibration. Functions, so that neither side knows the other's types.
#[derive(Clone, Copy, Debug)]
pub struct Detector {
    /// Markers of a dictionary (by OpenCV's number) whose black border has so many bits, in the order of their numbers.
    pub markers: fn(&ImageView<'_>, i32, i32) -> Result<Vec<Marker>, Fault>,
    /// The inner corners of a chessboard of so many columns and rows, row by row; `None` unless all are in sight.
    pub chessboard: fn(&ImageView<'_>, [usize; 2]) -> Result<Option<Places>, Fault>,
    /// Corners near the guesses to a fraction of a pixel, by windows of so many pixels to each side.
    pub refine: Refine,
}
