//! Where samples come from: replay of EuRoC data sets and a simulator, behind the traits of [`source`].
//!
//! A driver never learns what its samples are for; it hands them out in order of measurement time, with
//! what went missing counted.

pub mod error;
pub mod source;

pub use error::DriverError;
pub use source::{Faults, ImuReading, ImuSource, StereoFrame, StereoSource};
