//! The network: what a vehicle publishes over Zenoh, what it answers, and how others read it.
//!
//! The messages of a flight are relayed as they are, each in an envelope: a feed takes them ([`relay`]), a small Tokio runtime
//! sends them ([`publisher`], [`publishers`], [`map`], [`answers`]) on the keys of the table of topics ([`outlet`]), and Zenoh's
//! own sends odometry ([`odometry`]). Commands go back to the flight ([`commands`]). [`read`] reads messages, or refuses them. Who
//! may connect is in [`security`], who may do what in [`roles`]; why a connection cannot be made, in [`diagnosis`].

pub mod answers;
pub mod audit;
pub mod camera;
pub mod certificate;
pub mod commands;
pub mod diagnosis;
pub mod endpoints;
pub mod error;
pub mod health;
pub mod history;
pub mod keys;
pub mod map;
pub mod odometry;
pub mod outlet;
pub mod pace;
pub mod picture;
pub mod publisher;
pub mod publishers;
pub mod read;
pub mod relay;
pub mod roles;
pub mod security;
mod session;
pub mod threads;
pub mod vehicle;

pub use commands::CommandRelay;
pub use endpoints::{Endpoints, Mode};
pub use error::NetError;
pub use publisher::Publisher;
pub use relay::Feed;

use std::time::{SystemTime, UNIX_EPOCH};

/// Prefix of all keys.
pub const ROOT: &str = "plumbline";

/// This host's clock, nanoseconds since 1970.
pub fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as i64)
}

/// Words of somebody else as a terminal and a log may show them: without what controls a terminal or turns the direction of the
/// text (Unicode 16, UAX #9, 2).
pub fn plain(words: &str) -> String {
    let turns = |c| matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    words.chars().map(|c| if c.is_control() || turns(c) { '?' } else { c }).collect()
}
