//! Work with flights, and before them.
//!
//! - [`evaluate`] compares trajectories, a [`report`] sums a flight up, a [`campaign`] flies many, a [`sweep`] flies many
//!   settings, a [`mod@bench`] measures what they cost;
//! - a [`shuttle`] tells the drift of a recording without ground truth;
//! - a [`plot`] draws a flight, a [`picture`] what was found in an image, [`tracking`] what became of its features;
//! - [`calibrate`] finds out about the sensors before a flight.
//!
//! Without the feature `full` (default) there are [`evaluate`], [`report`] and [`tracking`] alone: what a flight says of itself.

#[cfg(feature = "full")]
pub mod bench;
#[cfg(feature = "full")]
pub mod calibrate;
#[cfg(feature = "full")]
pub mod campaign;
pub mod evaluate;
#[cfg(feature = "full")]
pub mod picture;
#[cfg(feature = "full")]
pub mod plot;
pub mod report;
#[cfg(feature = "full")]
pub mod shuttle;
#[cfg(feature = "full")]
pub mod sweep;
pub mod tracking;
