//! The bridge to the vehicle's autopilot (PX4, ArduPilot): odometry by MAVLink, at a constant rate.
//!
//! The tick leaves its odometry in a ring ([`handover`]; [`bridge`] listens to the run); a thread of its own sends the
//! newest as `ODOMETRY` on absolute deadlines ([`sender`]). [`feed`] decides which message that is: nothing before the first
//! pose, quality -1 while the odometry is lost, never a number that is not finite. [`frames`] turns it into LOCAL_FRD and
//! BODY_FRD, [`message`] fills the fields, [`status`] decides what is tracking and what the pilot is told.
//! [`flow`] compares the points of frames for OPTICAL_FLOW_RAD, [`status`] says when it is sent.
//! [`words`] tells people. [`link`] is the line, [`inbox`] what comes in from it, [`timesync`] finds the autopilot's clock, and
//! [`clock`] the time at which replayed data were measured.
//!
//! **Whose time.** `time_usec` and our answers to TIMESYNC are always of the same clock. By default it is this
//! host's (since boot): PX4 brings it to its own time by the TIMESYNC that it runs itself, and ArduPilot by the
//! smallest delay it sees; both would be wrong by the offset if we had added it already. With `clock =
//! "autopilot"` both are of the autopilot's clock, found by our own TIMESYNC, for whoever converts nothing.

pub mod awaited;
pub mod bridge;
pub mod clock;
pub mod feed;
#[cfg(test)]
pub(crate) mod fixture;
pub mod flow;
pub mod frames;
pub mod handover;
pub mod inbox;
pub mod link;
pub mod message;
pub mod sender;
pub mod status;
pub mod timesync;
pub mod words;

pub use bridge::{Bridge, BridgeError};
pub use sender::BridgeFigures;
