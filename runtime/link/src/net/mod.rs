//! The network: what a vehicle publishes over Zenoh, what it answers, and how others read it.
//!
//! The records of a flight fill rings that forget the oldest and count what they forgot ([`feed`], [`rings`]); a small Tokio
//! runtime empties them ([`publisher`], [`publishers`], [`map`], [`answers`]), and Zenoh's own sends odometry
//! ([`odometry`]). Commands go back to the flight ([`commands`]). The wire format is `proto/plumbline/v1/plumbline.proto`; [`wire`] writes it, [`read`]
//! turns it into what was meant, or refuses it. Who may connect is in [`security`], who may do what in
//! [`roles`]; why a connection cannot be made, in [`diagnosis`].

pub mod access;
pub mod answers;
pub mod audit;
pub mod camera;
pub mod certificate;
pub mod commands;
pub mod datagrams;
pub mod decision;
mod declare;
pub mod diagnosis;
pub mod endpoints;
pub mod error;
pub mod feed;
pub mod health;
pub mod keyframes;
pub mod keys;
pub mod map;
pub mod odometry;
pub mod pace;
pub mod picture;
pub mod publisher;
pub mod publishers;
pub mod read;
pub mod rings;
pub mod roles;
pub mod security;
mod session;
pub mod task_bell;
pub mod threads;
pub mod vehicle;
pub mod wire;

pub use commands::Commands;
pub use endpoints::{Endpoints, Mode};
pub use error::NetError;
pub use feed::Feed;
pub use publisher::Publisher;

use std::time::{SystemTime, UNIX_EPOCH};

/// The generated wire format.
#[allow(missing_docs, clippy::all, clippy::pedantic, rustdoc::all)]
pub mod proto {
    include!("../../generated/plumbline.v1.rs");
}

/// Descriptors of the wire format.
pub const DESCRIPTORS: &[u8] = include_bytes!("../../generated/plumbline.descriptors");

/// Prefix of all keys.
pub const ROOT: &str = "plumbline";

/// This host's clock, nanoseconds since 1970.
#[must_use]
pub fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as i64)
}

/// Words from the network as a terminal and a log may show them: without what controls a terminal.
#[must_use]
pub fn plain(words: &str) -> String {
    words.chars().map(|c| if c.is_control() { '?' } else { c }).collect()
}
