//! Line segments: extraction, description, and tracking from frame to frame and from left to right.
//!
//! A reader starts at [`LineExtractor`]. What an image goes through:
//!
//! 1. [`gradient`]: smoothed gradients at half the resolution and the ridges of their magnitude, [`seeds`]: the promising ones;
//! 2. [`growth`]: edges followed from the strongest ridges;
//! 3. [`filter`]: those that are too short by the paper's adaptive threshold are left out; [`refine`]: where the others lie in
//!    the whole image, from end to end; [`validation`]: those that are no chance;
//! 4. [`descriptor`], [`gates`] and [`matching`]: the same edge in the frame before and in the other camera;
//! 5. [`measurement`]: its line without the distortion of the lens.
//!
//! [`LineTracker`] does all of this for one or two cameras, in one of three parts of the images each frame; what it follows it refines in all.

pub mod descriptor;
pub mod extractor;
pub mod filter;
mod fit;
pub(crate) mod gates;
pub(crate) mod gradient;
pub(crate) mod growth;
pub mod matching;
pub(crate) mod measurement;
pub(crate) mod refine;
pub(crate) mod seeds;
pub(crate) mod segment;
pub(crate) mod tracker;
pub(crate) mod validation;
mod view;

pub use extractor::{ExtractionFigures, LineExtractor};
pub use measurement::ImageLine;
pub use segment::{Segment, SegmentNode};
pub use tracker::{LineFigures, LineObservation, LineTracker};
