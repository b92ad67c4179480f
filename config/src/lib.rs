//! The ground floor of Plumbline: the words that every other part speaks.
//!
//! - [`time`], [`sample`] and [`camera`] are the vocabulary: integer-nanosecond stamps, IMU samples,
//!   image views, and the camera models with their projection.
//! - [`options`] is the configuration as plain typed data, with units in the names.
//!
//! Nothing here does any work on samples; nothing here knows who produces or consumes them.

pub mod camera;
pub mod options;
pub mod sample;
pub mod time;

pub use camera::CameraModel;
pub use options::Config;
pub use sample::{GrayImage, ImageView, ImuSample};
pub use time::Timestamp;
