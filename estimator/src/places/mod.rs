//! Recognition of places, and localisation in a map of them.
//!
//! Steps for a stereo pair:
//!
//! 1. [`extractor`]: corners of several sizes, each with depth from the other camera and a binary [`descriptor`] whose
//!    patch is turned by gravity and sized by depth;
//! 2. [`index`]: hashed words of the descriptors vote for the keyframes that hold alike ones;
//! 3. [`matching`]: one feature to one, between the frame and a keyframe with its neighbours;
//! 4. [`ransac`]: a pose from two points and gravity ([`upright`]);
//! 5. [`refine`]: least squares over all inliers, with the covariance of the pose, and [`guide`]: matching anew with it;
//! 6. [`locate`]: the whole, and what must hold before a pose is believed: precision comes before recall.
//!
//! [`map`] holds the keyframes, bounded, with a rule for forgetting; [`graph`] is the pose graph that loops correct;
//! [`mapper`] makes both in flight, of the [`images`] of keyframes. Everything is a pure function of its inputs: no clock,
//! seeded samples, ties broken by number. What works in flight is allocated beforehand.
//!
//! Frames: `M` map (z up), `B` body, `C` left camera.

pub mod descriptor;
pub mod extractor;
pub(crate) mod feature;
pub mod graph;
pub(crate) mod guide;
pub(crate) mod images;
pub mod index;
pub(crate) mod line;
pub mod locate;
pub mod map;
pub mod mapper;
pub(crate) mod matching;
pub(crate) mod ransac;
pub mod refine;
pub(crate) mod upright;

pub use descriptor::Descriptor;
pub use extractor::Extractor;
pub use feature::Feature;
pub use images::FrameImages;
pub use line::MapLine;
pub use locate::{Located, Locator, LocatorOptions, Query};
pub use map::{Keyframe, MapLimits, PlaceMap};
pub use mapper::{MapEstimate, MapFollower, MapPath, MapUpdate, Mapper, PlaceJob};

#[cfg(test)]
mod tests;
