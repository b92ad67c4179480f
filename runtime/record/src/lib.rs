//! Output of a flight, and every form that it takes.
//!
//! - [`messages`] has the table of topics, and the one type for inputs, orders, outputs and events; [`orders`] and [`event`] are what it holds besides
//!   the types of drivers and estimator, [`parts`] what a log holds about images and about itself;
//! - each field of each of these types says beside it by which number it is known, and what else reads it ([`fields`]);
//! - what reads these declarations: [`protobuf`] and [`schema`] (the messages of the log and of the local socket), [`layout`] (the
//!   fixed layouts of the local socket), [`digest`], [`compare`], [`columns`];
//! - [`local`]: records and requests of the local socket, for both of its ends.
//!
//! It does no I/O, starts no threads and reads no clock.

#![deny(clippy::disallowed_methods)]

#[macro_use]
mod row;

pub mod columns;
pub mod compare;
pub mod digest;
pub mod event;
pub mod layout;
pub mod local;
#[cfg(test)]
mod made_tests;
pub mod messages;
pub mod orders;
pub mod parts;
pub mod protobuf;
pub mod said;
pub mod schema;
#[cfg(test)]
mod tests;
pub mod topics;

pub use event::{Event, Severity};
pub use orders::{
    CorrectionOrder, FrameOrder, InstantAnswer, InstantOrder, InstantOutcome, InstantSource, MapOrder,
    MapVerdict, ResetOrder, Verdict,
};
pub use plumbline_fields as fields;

/// Lowest quality of a pose that may be used: what contradicts itself has at most 10, and from here on errors under faults are within
/// five standard deviations (`honesty` of the reports). Autopilots get it as their threshold, ground stations show it.
pub const QUALITY_TO_USE: i8 = 20;
pub use said::{Dropped, EntryKind};
pub use topics::Said;
