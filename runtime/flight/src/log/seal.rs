//! A running hash over the inputs and orders of a part: what a re-execution is fed is what was recorded.
//!
//! It finds what a comparison of outputs may not: a changed pixel that no feature looked at, a number that
//! no estimate depends on. It is no signature: who writes a log can seal it.

use super::channel::Channel;
use sha2::{Digest as _, Sha256};

/// The hash so far.
#[derive(Clone, Debug, Default)]
pub struct Seal(Sha256);

impl Seal {
    /// Adds a message. Of images the CRC is enough, since their pixels have a hash of their own.
    pub fn add(&mut self, channel: Channel, payload: &[u8]) {
        if !channel.is_input() {
            return;
        }
        self.0.update([channel as u8]);
        self.0.update((payload.len() as u64).to_le_bytes());
        if channel.is_image() {
            self.0.update(crc32fast::hash(payload).to_le_bytes());
        } else {
            self.0.update(payload);
        }
    }

    /// The hash of all messages so far.
    pub fn value(&self) -> Vec<u8> {
        self.0.clone().finalize().to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_of_any_input_changes_the_seal() {
        let value = |payload: &[u8], channel| {
            let mut seal = Seal::default();
            seal.add(channel, payload);
            seal.value()
        };
        for channel in Channel::LOGGED {
            let changes = value(b"abc", channel) != value(b"abb", channel);
            assert_eq!(changes, channel.is_input(), "{channel:?}");
        }
    }
}
