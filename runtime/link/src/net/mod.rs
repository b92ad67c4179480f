//! The network: what a vehicle publishes over Zenoh, what it answers, and how others read it.
//!
//! Nothing here may hold up the estimator: it hands its results to rings that forget the oldest and count
//! what they forgot ([`rings`]); a small Tokio runtime at normal priority does the rest ([`publisher`],
//! [`publishers`], [`map`], [`answers`]), and Zenoh's own sends odometry ([`odometry`]). The wire format is `proto/plumbline/v1/plumbline.proto`; [`wire`] writes it, [`read`]
//! turns it into what was meant, or refuses it. Who may connect is in [`security`], who may do what in
//! [`roles`]; why a connection cannot be made, in [`diagnosis`].

pub mod access;
pub mod answers;
pub mod audit;
pub mod camera;
pub mod certificate;
pub mod datagrams;
pub mod decision;
mod declare;
pub mod diagnosis;
pub mod endpoints;
pub mod error;
pub mod health;
pub mod keyframes;
pub mod keys;
pub mod listener;
pub mod map;
pub mod memory;
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

pub use endpoints::{Endpoints, Mode};
pub use error::NetError;
pub use publisher::Publisher;

use std::time::{SystemTime, UNIX_EPOCH};

/// The generated wire format.
#[allow(missing_docs, clippy::all, clippy::pedantic, rustdoc::all)]
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/plumbline.v1.rs"));
}

/// Descriptors of the wire format.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/plumbline.descriptors"));

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
