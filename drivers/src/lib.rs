//! Sources of samples: replay of EuRoC data sets and ROS bags, live cameras and inertial sensors, behind the traits of
//! [`source`].
//!
//! A driver never learns what its samples are for; it hands them out in order of measurement time, with
//! what went missing counted.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]
// What bags share with data sets and cameras is called by nobody else.
#![cfg_attr(not(feature = "bags"), allow(dead_code))]

#[cfg(feature = "bags")]
pub mod bag;
mod bag_name;
mod board;
pub mod clock;
pub mod error;
pub mod euroc;
pub mod frame_socket;
#[cfg(any(all(test, feature = "bags"), feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
mod grid;
pub mod iio;
pub mod inertial;
pub mod live;
pub mod prefetch;
mod regular_file;
pub mod serial;
pub mod source;
pub mod stop;
mod sysfs;
mod text_lines;
pub mod truth;
pub mod tum;
pub mod unix_socket;
pub mod v4l2;
pub mod video_nodes;

#[cfg(feature = "bags")]
pub use bag::{BagDataset, BagStereo};
pub use bag_name::{BagTopics, is_bag};
pub use error::DriverError;
pub use euroc::{EurocDataset, EurocImu, EurocOptions, EurocStereo};
pub use frame_socket::{SocketFigures, SocketMonitor, SocketStereo};
pub use iio::IioImu;
pub use inertial::{ImuFigures, ImuMonitor};
pub use live::{CameraMonitor, LiveCameras, LiveImu, open_cameras, open_imu};
pub use prefetch::Prefetch;
pub use regular_file::open_regular;
pub use serial::SerialImu;
pub use source::{Faults, ImuReading, ImuSource, StereoFrame, StereoSource};
pub use stop::StopFlag;
pub use truth::TruthState;
pub use tum::StampedPose;
pub use v4l2::{V4l2Figures, V4l2Monitor, V4l2Options, V4l2Stereo};

/// The example of the README is compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
