//! The ground floor of Plumbline: the words that every other part speaks.
//!
//! - [`time`], [`sample`] and [`camera`] are the vocabulary: integer-nanosecond stamps, IMU samples,
//!   image views, and the camera models with their projection.
//! - [`options`] is the configuration as plain typed data, with units in the names.
//! - [`Config::load`], [`Config::from_toml_str`] and [`Config::preset`] give a configuration that has
//!   passed validation, or a [`ConfigError`] that names every refused key, the reason and the cure.
//! - [`import`] reads the calibration files of EuRoC data sets and of Kalibr.
//!
//! Nothing here does any work on samples; nothing here knows who produces or consumes them.

pub mod camera;
mod error;
pub mod import;
mod load;
pub mod options;
pub mod sample;
mod shape;
mod text;
pub mod time;
mod validate;

pub use camera::CameraModel;
pub use error::{ConfigError, Violation};
pub use load::{PRESETS, preset_text};
pub use options::Config;
pub use sample::{GrayImage, ImageView, ImuSample};
pub use time::Timestamp;

#[cfg(test)]
mod tests;
