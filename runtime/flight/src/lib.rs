//! A flight of Plumbline: samples in, odometry out, on time, recorded and executed again. It knows of no network.
//!
//! Data flow one way, and imports point down only. From the ground up:
//!
//! - [`alloc`] counts allocations; [`schedule`] makes a run a real-time one;
//! - [`pipeline`] takes samples to estimates, in virtual time or live, and tells its listeners;
//! - those who listen: [`log`] holds a run so that it can be executed again, [`autopilot`] sends it by MAVLink, [`local`]
//!   serves other programs of this computer, the network process among them;
//! - `sensor_board` holds the state of live sensors on its way to the local socket;
//! - [`places`] are maps on disk, made of data sets and searched;
//! - a [`flight`] puts sources, run and listeners together. What else listens is handed in by the caller
//!   ([`pipeline::listener::Subscriber`]).

pub mod alloc;
pub mod autopilot;
pub mod flight;
#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod local;
pub mod log;
pub mod pipeline;
pub mod places;
pub mod schedule;
mod sensor_board;
