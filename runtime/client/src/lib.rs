//! Programs beside a flight of Plumbline on the same computer: what the network process, the C library and the Python package are made of.
//!
//! - [`Local`] reads the local socket (`docs/local-socket.md`) and gives commands;
//! - [`FrameSender`] sends stereo frames to `plumbline fly` (`docs/own-sensors.md`);
//! - [`ImuLine`] is an inertial sensor for it, at a pseudo-terminal (`docs/own-sensors.md`).
//!
//! The formats are those of `plumbline-record` and `plumbline-protocol`. Calls block, for as long as
//! they are told to; there is no runtime of tasks.

mod error;
mod frames;
mod imu;
mod local;
mod socket;
#[cfg(test)]
mod tests;

pub use error::ClientError;
pub use frames::FrameSender;
pub use imu::{ImuLine, SensorAbout};
pub use local::{Local, Requests};

/// Now on the host's monotonic clock (CLOCK_MONOTONIC), ns, of which stamps of frames and samples are.
#[must_use]
pub fn monotonic_ns() -> i64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}
