//! The ground floor of Plumbline: the words that every other part speaks.
//!
//! - [`time`], [`sample`], [`image`] and [`camera`] are the vocabulary: integer-nanosecond stamps, IMU samples,
//!   image views, and the camera models with their projection.
//! - [`options`] is the configuration as plain typed data, with units in the names: [`EstimatorSetup`] for the
//!   estimator alone, [`Config`] for a whole vehicle.
//! - [`ValidSetup`] and [`ValidConfig`] are the same, proven valid: made by [`EstimatorSetup::validate`] and
//!   [`Config::validated`], which answer a [`ConfigError`] that names every refused key, the reason and the cure.
//!
//! Nothing here does any work on samples; nothing here knows who produces or consumes them.
//!
//! # Features
//!
//! File formats are optional, so that who puts a setup together in code links no parser:
//!
//! - `toml` (default): `Config::load`, `Config::from_toml_str`, the presets;
//! - `yaml` (default): the module `import`, which reads calibrations of EuRoC data sets, of Kalibr and of other
//!   programs.
//!
//! # Example
//!
//! A pinhole camera beside an IMU, put together in code:
//!
//! ```
//! use plumbline_config::camera::Distortion;
//! use plumbline_config::options::{CameraConfig, ImuConfig};
//! use plumbline_config::EstimatorSetup;
//!
//! let camera = CameraConfig {
//!     width_px: 640,
//!     height_px: 480,
//!     rate_hz: 20.0,
//!     readout_s: 0.0,
//!     exposure_s: 0.0,
//!     mask: None,
//!     focal_px: [380.0, 380.0],
//!     centre_px: [320.0, 240.0],
//!     distortion: Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
//!     // T_BC: the camera looks along the x axis of the IMU.
//!     pose_b_c: [[0.0, 0.0, 1.0, 0.05], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
//! };
//! let imu = ImuConfig::with_noise(200.0, (2e-3, 2e-5), (2e-2, 3e-3));
//! let mut setup = EstimatorSetup::new(vec![camera], imu);
//! setup.imu.gravity_m_s2 = 9.807;
//! let setup = setup.validate()?;
//! assert_eq!(setup.left().model().focal_px.x, 380.0);
//!
//! // What is wrong is refused before anything is built from it.
//! let mut wrong = setup.into_inner();
//! wrong.camera[0].focal_px[0] = 0.0038;
//! let error = wrong.validate().unwrap_err();
//! assert!(error.to_string().contains("write it in pixels (is this in mm?)"));
//! # Ok::<(), plumbline_config::ConfigError>(())
//! ```

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod camera;
mod doubts;
mod error;
#[cfg(any(all(test, feature = "toml", feature = "yaml"), feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod image;
#[cfg(feature = "yaml")]
pub mod import;
mod keys;
#[cfg(feature = "toml")]
mod load;
#[cfg(feature = "toml")]
mod mask_file;
pub mod options;
mod portable;
#[cfg(feature = "toml")]
mod presets;
mod random;
pub mod sample;
#[cfg(feature = "toml")]
mod shape;
mod statistics;
#[cfg(any(feature = "toml", feature = "yaml"))]
mod text;
pub mod time;
#[cfg(feature = "toml")]
mod unset;
mod valid;
mod validate;

pub use camera::CameraModel;
pub use error::{ConfigError, Violation};
pub use image::{GrayImage, ImageError, ImageView, StereoFrame};
pub use options::{Config, EstimatorSetup};
pub use portable::Portable;
#[cfg(feature = "toml")]
pub use presets::{PRESETS, every_key, preset_text};
pub use random::Random;
pub use sample::ImuSample;
pub use statistics::{median, median_by};
pub use time::Timestamp;
pub use valid::{ValidConfig, ValidSetup};
pub use validate::MAX_WINDOW_FRAMES;

#[cfg(all(test, feature = "toml", feature = "yaml"))]
mod tests;

/// The examples of the README are compiled and run.
#[cfg(all(doctest, feature = "toml"))]
#[doc = include_str!("../README.md")]
struct Readme;
