//! Visual-inertial odometry as a pure function of its setup and of ordered inputs: images and inertial samples in,
//! pose, velocity, biases and their covariance out.
//!
//! No I/O, no clock, no threads of its own accord, no allocation after construction. The method is a sliding window
//! of keyframes with points, lines and preintegrated inertial samples; it needs one or two cameras and an IMU.
//!
//! A user starts at [`Estimator`]; a setup comes from code ([`EstimatorSetup`]), or from a file with the features
//! `toml` (configurations) and `yaml` (calibrations of EuRoC data sets and of Kalibr). This crate is the only
//! dependency needed: [`config`] and [`nalgebra`] are re-exported.
//!
//! Frames: `B` is the body, which is the IMU; `O` the odometry frame, z up, its origin at the first pose; `C0` and
//! `C1` the left and right camera. `pose_o_b` takes coordinates from `B` to `O`. Units are those of the SI, time is
//! [`Timestamp`], in nanoseconds.
//!
//! # Example
//!
//! Estimates of a stereo camera and an IMU, whatever they are read from:
//!
//! ```no_run
//! use plumbline_estimator::config::{Config, import};
//! use plumbline_estimator::{Estimator, FrameInput, ImageView, ImuSample, Timestamp};
//!
//! # struct Pair { stamp: Timestamp, left: Vec<u8>, right: Vec<u8> }
//! # fn next_sample() -> Option<ImuSample> { None }
//! # fn next_pair() -> Option<Pair> { None }
//! // The calibration of a EuRoC data set, with the thresholds and the noise model of the preset.
//! let config = import::euroc_into(Config::preset("euroc")?, "MH_01_easy")?;
//! let mut estimator = Estimator::new(config.setup());
//! while let Some(Pair { stamp, left, right }) = next_pair() {
//!     let needed = estimator.imu_needed_until(stamp);
//!     while let Some(sample) = next_sample() {
//!         estimator.add_imu(&sample);
//!         if sample.stamp >= needed {
//!             break;
//!         }
//!     }
//!     // Rows of 752 pixels, 768 bytes apart: the camera's own buffers, not copied.
//!     let [left, right] = [&left, &right].map(|pixels| ImageView::new(752, 480, 768, pixels));
//!     let estimate = estimator.add_frame(&FrameInput::stereo(stamp, left?, right?));
//!     if let Some(pose_o_b) = estimate.pose() {
//!         println!("{stamp} {pose_o_b}");
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How it is built
//!
//! The modules follow the flow of the data. [`front_end`] tracks [`points`] and [`lines`] through images;
//! [`odometry`] starts ([`initial`]) and runs the [`window`], whose solution is the [`Estimate`]; [`propagator`]
//! carries it forward at the rate of the IMU. [`facade`] runs all of it in turn on one thread. What the first two
//! hand each other is in [`exchange`]: executors with threads to spare follow its rule and get the same bits.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod admission;
pub mod estimate;
mod exchange;
mod facade;
mod front_end;
pub mod geometry;
pub mod health;
pub mod image;
mod inertial;
mod initial;
mod input;
pub mod lines;
pub mod odometry;
mod origin;
pub mod places;
pub mod points;
pub mod propagator;
mod shutter;
pub mod window;
mod work_budget;

pub use estimate::{
    BiasVariances, Estimate, FrameFigures, HealthBits, NavCovariance, Odometry, Stage, StageProbe,
    TrackingState,
};
pub use exchange::{Feedback, Tracked};
pub use facade::Estimator;
pub use front_end::FrontEnd;
pub use input::{FrameInput, ImuAdmission, ResetKind};
pub use odometry::Odometer;
pub use origin::OriginUncertainty;
pub use propagator::Propagator;
pub use propagator::history::{Instant, NoInstant};
pub use window::snapshot::MapSnapshot;
pub use window::trail::{Trail, TrailState};
pub use work_budget::{Fork, InTurn, WorkBudget};

/// The example of the README is compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub use nalgebra;
pub use plumbline_config as config;
pub use plumbline_config::{
    CameraModel, ConfigError, EstimatorSetup, GrayImage, ImageError, ImageView, ImuSample, Timestamp,
    ValidSetup,
};
