//! The network: what a vehicle publishes over Zenoh, and how others read it.
//!
//! Nothing here may hold up the estimator: it hands its results to rings that forget the oldest and count
//! what they forgot ([`publisher`]); a small Tokio runtime at normal priority does the rest. The wire
//! format is `proto/plumbline/v1/plumbline.proto`; [`wire`] turns it into what was meant, or refuses it.

pub mod publisher;
pub mod session;
pub mod wire;

pub use publisher::Publisher;
pub use session::{Endpoints, NetError};

/// The generated wire format.
#[allow(missing_docs, clippy::all, clippy::pedantic)]
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/plumbline.v1.rs"));
}

/// Prefix of all keys.
pub const ROOT: &str = "plumbline";
