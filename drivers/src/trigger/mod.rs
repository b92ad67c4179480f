//! Frames stamped by the triggers of their cameras.
//!
//! A microcontroller that triggers the cameras tells when it did ([`TriggerEvent`](crate::serial::TriggerEvent)), on the clock that it stamps its
//! inertial samples by: better than any stamp that a camera's driver can give. [`matching`] finds which trigger a frame
//! belongs to, without a clock or a device; [`Triggered`] is a source of frames around another one that stamps by it.

mod figures;
mod matching;
#[cfg(test)]
mod realtime;
mod source;

pub use figures::{TriggerFigures, TriggerMonitor};
pub use source::{Exposure, Triggered};
