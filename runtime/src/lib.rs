//! The Plumbline runtime as a library; the binary `plumbline` is its command line.
//!
//! Data flow one way, and imports point down only. From the ground up:
//!
//! - [`alloc`] counts allocations; [`schedule`] makes a run a real-time one;
//! - [`pipeline`] takes samples to estimates, in virtual time or live, and tells its listeners;
//! - those who listen: [`log`] holds a run so that it can be executed again, [`net`] publishes it, [`autopilot`] sends it
//!   by MAVLink, [`ros`] to ROS 2;
//! - [`places`] are maps on disk, made of data sets and searched;
//! - a [`flight`] puts sources, run and listeners together;
//! - who judges flights: [`evaluate`] compares trajectories, a [`report`] sums a flight up, a [`campaign`] flies many,
//!   a [`sweep`] flies many settings, a [`mod@bench`] measures what they cost; a [`plot`] draws a flight, a [`picture`] what was
//!   found in an image;
//! - [`calibrate`] finds out about the sensors before a flight;
//! - the [`ground`] watches from afar;
//! - [`cli`] is the command line. Nothing but the binary imports it.
//!
//! `tests/imports` holds this order.

pub mod alloc;
pub mod autopilot;
pub mod bench;
pub mod calibrate;
pub mod campaign;
pub mod cli;
pub mod evaluate;
pub mod flight;
#[cfg(any(feature = "fuzzing", all(test, feature = "ground")))]
#[doc(hidden)]
pub mod fuzzing;
#[cfg(feature = "ground")]
pub mod ground;
pub mod log;
pub mod net;
pub mod picture;
pub mod pipeline;
pub mod places;
pub mod plot;
pub mod report;
pub mod ros;
pub mod schedule;
pub mod sweep;
