//! The Plumbline runtime as a library; the binary `plumbline` is its command line.
//!
//! The data flow one way: a [`flight`] opens the streams, the [`pipeline`] takes them to estimates, sinks
//! take what it produces ([`record`], [`net`], [`autopilot`], to ROS 2 as [`ros`] has it), a [`report`] sums it up,
//! [`evaluate`] compares trajectories, and a [`campaign`] does all of it over many flights. A flight [`log`] holds a
//! run so that it can be executed again. The [`ground`] watches from afar. A [`picture`] shows what was found in an image.

pub mod alloc;
pub mod autopilot;
pub mod bench;
pub mod campaign;
pub mod cli;
pub mod demo;
pub mod evaluate;
pub mod flight;
#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod ground;
pub mod log;
pub mod net;
pub mod picture;
pub mod pipeline;
pub mod record;
pub mod report;
pub mod ros;
pub mod schedule;
