//! What is made of flights, and before them.
//!
//! - [`evaluate`] compares trajectories, a [`report`] sums a flight up, a [`campaign`] flies many, a [`sweep`] flies many
//!   settings, a [`mod@bench`] measures what they cost;
//! - a [`plot`] draws a flight, a [`picture`] what was found in an image;
//! - [`calibrate`] finds out about the sensors before a flight.

pub mod bench;
pub mod calibrate;
pub mod campaign;
pub mod evaluate;
pub mod picture;
pub mod plot;
pub mod report;
pub mod sweep;
