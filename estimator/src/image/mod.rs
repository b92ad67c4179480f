//! Images as the trackers want them: 8-bit pyramids and interpolated patches.

pub(crate) mod frozen;
pub mod mask;
pub(crate) mod noise;
pub(crate) mod patch;
pub mod pyramid;
#[cfg(test)]
pub(crate) mod synthetic;

pub use pyramid::{Plane, Pyramid};
