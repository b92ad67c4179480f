//! The C library of Plumbline: `libplumbline`, with its header [`plumbline.h`](../include/plumbline.h).
//!
//! - [`estimator`]: the pure estimator, samples and images in, estimates out;
//! - [`drone`]: the programs beside a flight: local socket, frames, inertial samples, by `plumbline-client`;
//! - [`types`]: the structures of the header; [`status`] and [`names`]: outcomes, states and health as text;
//! - [`handles`]: what a handle of C stands for; [`pointers`]: the one place that reads and writes memory of the caller.
//!
//! Every function is called from C: its documentation is that of the header, which cbindgen makes of this crate. A pointer
//! is null, where that is said, or points to what its type says, for the time of the call. No panic leaves a function.

// The contract of pointers stands above, once for all functions.
#![allow(clippy::missing_safety_doc)]

#[cfg(target_endian = "big")]
compile_error!("structures of the header are records of the local socket, whose numbers are little endian");

// In the order of the header.
pub mod version;

pub mod estimator;

mod call;
pub mod drone;
pub mod handles;
#[cfg(test)]
mod layout_tests;
pub mod names;
mod pointers;
pub mod status;
#[cfg(test)]
mod tests;
pub mod types;
