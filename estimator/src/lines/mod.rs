//! Line segments: extraction, description, and tracking from frame to frame and from left to right.
//!
//! A reader starts at [`LineExtractor`]. What an image goes through:
//!
//! 1. [`gradient`]: smoothed gradients and the ridges of their magnitude, [`seeds`]: the promising ones;
//! 2. [`growth`]: edges followed from the strongest ridges, [`validation`]: those that are no chance;
//! 3. [`filter`] and [`merge`]: the paper's adaptive length threshold and joining of broken segments;
//! 4. [`descriptor`], [`gates`] and [`matching`]: the same edge in the frame before and in the other camera;
//! 5. [`measurement`]: its line without the distortion of the lens.
//!
//! [`LineTracker`] does all of this for each frame of one or two cameras.

pub mod descriptor;
pub mod extractor;
pub mod filter;
mod fit;
pub mod gates;
pub mod gradient;
pub mod growth;
pub mod matching;
pub mod measurement;
pub mod merge;
pub mod seeds;
pub mod segment;
pub mod tracker;
pub mod validation;

pub use extractor::{ExtractionFigures, LineExtractor};
pub use measurement::ImageLine;
pub use segment::{Node, Segment};
pub use tracker::{LineFigures, LineObservation, LineTracker};
