//! Images as the trackers want them: 8-bit pyramids and interpolated patches.

pub mod condition;
pub mod frozen;
pub mod mask;
pub mod noise;
pub mod patch;
pub mod pyramid;
#[cfg(test)]
pub(crate) mod synthetic;

pub use pyramid::{Plane, Pyramid};
