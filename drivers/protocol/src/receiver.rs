//! Bytes as they come, to messages.

use crate::frame::{FrameError, MAX_ENCODED, decode};
use crate::message::Message;

/// Puts messages together from single bytes.
#[derive(Clone, Debug)]
pub struct Receiver {
    bytes: [u8; MAX_ENCODED],
    length: usize,
    /// More came than any frame has: all up to the next zero is passed over.
    is_lost: bool,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// One that has received nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [0; MAX_ENCODED], length: 0, is_lost: false }
    }

    /// Takes a byte: the message that it completes, or what was wrong with the bytes before it.
    pub fn push(&mut self, byte: u8) -> Option<Result<Message, FrameError>> {
        if byte != 0 {
            match self.bytes.get_mut(self.length) {
                Some(place) => {
                    *place = byte;
                    self.length += 1;
                }
                None => self.is_lost = true,
            }
            return None;
        }
        let (length, was_lost) = (self.length, self.is_lost);
        (self.length, self.is_lost) = (0, false);
        match (was_lost, length) {
            (true, _) => Some(Err(FrameError::Length)),
            // Between the zeros of neighbours.
            (false, 0) => None,
            (false, _) => Some(decode(&self.bytes[..length])),
        }
    }
}
