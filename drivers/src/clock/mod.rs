//! From a device's clock to the host's: when a sample was measured, on the clock that everything else is stamped by.
//!
//! A sample brings the time of its measurement by its device's clock; the host knows when its bytes arrived. Arrivals
//! are late by what a transfer takes at least and by what chance adds (a busy host, USB frames, a stall), and the
//! device's crystal runs a little faster or slower than ours. [`DeviceClock`] finds offset and rate from the lower
//! [`hull`] of the arrivals of the last ten to twenty seconds ([`envelope`]), so that what is late is ignored, however
//! late and however often. Where the device answers questions for its time, round trips take the place of arrivals:
//! they know how long the way is.
//!
//! A device that starts anew, or whose clock is set, is noticed within a few samples, and its clock learnt afresh.
//!
//! The module holds no clock but [`monotonic_ns`], which the sources call: all the rest is a function of what it is fed.

mod counter;
mod device;
mod envelope;
mod host;
mod hull;
mod round_trip;
mod stamps;
#[cfg(test)]
mod tests;

pub use counter::Unwrap;
pub use device::{ClockFigures, DeviceClock, Stamped};
pub use host::monotonic_ns;
pub use plumbline_fields::StampFigures;
pub use round_trip::RoundTrip;
pub use stamps::{StampDefect, StampPace, StampProblem, TimeUnitName};
