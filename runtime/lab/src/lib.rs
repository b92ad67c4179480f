//! Work with flights, and before them.
//!
//! - [`evaluate`] compares trajectories, a [`report`] sums a flight up;
//! - [`calibrate`] finds out about the cameras before a flight.

pub mod calibrate;
pub mod evaluate;
pub mod report;
