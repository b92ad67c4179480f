//! What the network may hold in memory.
//!
//! Zenoh bounds messages and links, but not the keys that a peer declares, and not how many pieces of a message it holds that
//! never becomes whole. Whoever has a certificate could so take all memory of a vehicle. Nothing in Zenoh tells whose it is;
//! but all of it goes with the session. So a session that holds too much is closed, and opened anew.

use plumbline_flight::alloc::held_by_network;

/// On a router, which has 160 links, and passes on longer messages, MB (10^6 bytes). A vehicle's is configured: three times what
/// 32 links hold that do as they should, 1 MB each for what is sent, received and not complete yet.
pub const MAX_HELD_BY_ROUTER_MB: u32 = 512;

/// What a session holds since it was opened.
#[derive(Clone, Copy, Debug)]
pub struct SessionMemory {
    before: i64,
    max: i64,
}

impl SessionMemory {
    /// To be made before the session is opened: it may hold `max_mb`, MB (10^6 bytes). Of what the network's threads hold, `kept` are kept
    /// beyond the session.
    #[must_use]
    pub fn begin(max_mb: u32, kept: usize) -> Self {
        Self { before: held_beside(kept), max: i64::from(max_mb) * 1_000_000 }
    }

    /// Whether it holds more than it may; says so then.
    #[must_use]
    pub fn is_too_much(&self, kept: usize) -> bool {
        let held = held_beside(kept) - self.before;
        let is_too_much = held > self.max;
        if is_too_much {
            tracing::warn!(
                "the network holds {} MB: an authenticated peer exceeded the memory limit; closing and reopening all links",
                held / 1_000_000
            );
        }
        is_too_much
    }
}

fn held_beside(kept: usize) -> i64 {
    held_by_network() - i64::try_from(kept).unwrap_or(i64::MAX)
}
