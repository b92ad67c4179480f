//! Line segments and what they say of the motion.
//!
//! A reader starts at [`LineExtractor`]. What an image goes through:
//!
//! 1. [`gradient`]: smoothed gradients and the ridges of their magnitude;
//! 2. [`growth`]: edges followed from the strongest ridges, [`validation`]: those that are no chance;
//! 3. [`filter`] and [`merge`]: the paper's adaptive length threshold and joining of broken segments.

pub mod extractor;
pub mod filter;
mod fit;
pub mod gradient;
pub mod growth;
pub mod merge;
pub mod segment;
pub mod validation;

pub use extractor::{ExtractionFigures, LineExtractor};
pub use segment::{Node, Segment};
