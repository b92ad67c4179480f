//! Incoming messages: bytes from outside become the few that concern us, in bounded memory.

use mavlink::dialects::common::{CAMERA_TRIGGER_DATA, MavMessage, TIMESYNC_DATA};
use mavlink::error::MessageReadError;
use mavlink::{MAVLinkMessageRaw, MavlinkReader, MessageData};
use std::io::{ErrorKind, Read};

/// Bytes that are taken at a time: more than any datagram of one message.
pub const CHUNK: usize = 2048;

/// A message that concerns us.
#[derive(Clone, Debug, PartialEq)]
pub struct Received {
    /// System that sent it.
    pub system_id: u32,
    /// Component that sent it.
    pub component_id: u8,
    /// Answer about time; `None` for a message of any other kind.
    pub timesync: Option<TIMESYNC_DATA>,
    /// Trigger of a camera; `None` for a message of any other kind.
    pub trigger: Option<CAMERA_TRIGGER_DATA>,
}

/// Counts of what came in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InboxFigures {
    /// Messages with a good checksum.
    pub messages: u64,
    /// Messages with a good checksum whose fields make no sense.
    pub malformed: u64,
    /// Bytes that were part of no message of the common dialect.
    pub passed_over: u64,
}

/// Puts messages together from pieces of any size.
pub struct MavlinkInbox {
    reader: MavlinkReader<Chunk>,
    figures: InboxFigures,
    /// Bytes taken and bytes that became messages.
    bytes: (u64, u64),
}

/// Bytes on their way into the reader: an empty one would block.
struct Chunk {
    bytes: [u8; CHUNK],
    from: usize,
    to: usize,
}

impl Read for Chunk {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = into.len().min(self.to - self.from);
        if count == 0 {
            return Err(ErrorKind::WouldBlock.into());
        }
        into[..count].copy_from_slice(&self.bytes[self.from..self.from + count]);
        self.from += count;
        Ok(count)
    }
}

impl Default for MavlinkInbox {
    fn default() -> Self {
        let chunk = Chunk { bytes: [0; CHUNK], from: 0, to: 0 };
        Self {
            reader: MavlinkReader::with_capacity(CHUNK, chunk),
            figures: InboxFigures::default(),
            bytes: (0, 0),
        }
    }
}

impl MavlinkInbox {
    /// Takes bytes, at most [`CHUNK`] of them, and hands every message that they complete to `take`.
    pub fn put(&mut self, bytes: &[u8], mut take: impl FnMut(Received)) {
        for piece in bytes.chunks(CHUNK) {
            let chunk = self.reader.get_mut();
            chunk.bytes[..piece.len()].copy_from_slice(piece);
            (chunk.from, chunk.to) = (0, piece.len());
            self.bytes.0 += piece.len() as u64;
            while let Some(message) = self.next() {
                self.figures.messages += 1;
                match received(&message) {
                    Some(received) => take(received),
                    None => self.figures.malformed += 1,
                }
            }
        }
    }

    /// The counts so far.
    pub fn figures(&self) -> InboxFigures {
        InboxFigures { passed_over: self.bytes.0.saturating_sub(self.bytes.1), ..self.figures }
    }

    fn next(&mut self) -> Option<MAVLinkMessageRaw> {
        match self.reader.read_any_raw_message::<MavMessage>() {
            Ok(message) => {
                let length = match &message {
                    MAVLinkMessageRaw::V1(raw) => raw.raw_bytes().len(),
                    MAVLinkMessageRaw::V2(raw) => raw.raw_bytes().len(),
                };
                self.bytes.1 += length as u64;
                Some(message)
            }
            // The only error of a reader of raw messages is that of its source.
            Err(MessageReadError::Io(_) | MessageReadError::Parse(_)) => None,
        }
    }
}

/// Part of a message that concerns us; `None` when its fields make no sense.
fn received(message: &MAVLinkMessageRaw) -> Option<Received> {
    let (version, payload) = (message.version(), message.payload());
    let (mut timesync, mut trigger) = (None, None);
    match message.message_id() {
        TIMESYNC_DATA::ID => timesync = Some(TIMESYNC_DATA::deser(version, payload).ok()?),
        CAMERA_TRIGGER_DATA::ID => trigger = Some(CAMERA_TRIGGER_DATA::deser(version, payload).ok()?),
        _ => {}
    }
    let (system_id, component_id) = (message.system_id(), message.component_id());
    Some(Received { system_id, component_id, timesync, trigger })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::MavHeader;

    fn timesync(tc1: i64) -> Vec<u8> {
        let header = MavHeader { system_id: 1, component_id: 1, sequence: 3 };
        let message = TIMESYNC_DATA { tc1, ts1: 5, target_system: 0, target_component: 0 };
        let mut bytes = Vec::new();
        mavlink::write_v2_msg(&mut bytes, header, &MavMessage::TIMESYNC(message)).unwrap();
        bytes
    }

    fn all(inbox: &mut MavlinkInbox, bytes: &[u8]) -> Vec<i64> {
        let mut found = Vec::new();
        inbox.put(bytes, |received| found.extend(received.timesync.map(|t| t.tc1)));
        found
    }

    #[test]
    fn messages_are_put_together_from_single_bytes_and_found_amid_noise() {
        let mut inbox = MavlinkInbox::default();
        let mut stream = vec![0xFD, 0xFE, 7, 0xFD];
        stream.extend(timesync(11));
        stream.extend([0xFD; 5]);
        stream.extend(timesync(12));
        stream.extend([0; 600]);
        let found: Vec<i64> = stream.iter().flat_map(|byte| all(&mut inbox, &[*byte])).collect();
        assert_eq!(found, [11, 12]);
        assert_eq!(inbox.figures(), InboxFigures { messages: 2, malformed: 0, passed_over: 609 });
    }

    #[test]
    fn a_changed_byte_spoils_one_message_and_is_counted() {
        let mut inbox = MavlinkInbox::default();
        let (mut bad, good) = (timesync(11), timesync(12));
        bad[14] ^= 1;
        assert_eq!(all(&mut inbox, &[bad.clone(), good].concat()), [12]);
        assert_eq!(inbox.figures().passed_over, bad.len() as u64);
    }

    #[test]
    fn mavlink_one_is_understood_too() {
        let header = MavHeader { system_id: 1, component_id: 1, sequence: 3 };
        let message = TIMESYNC_DATA { tc1: 9, ts1: 5, target_system: 0, target_component: 0 };
        let mut bytes = Vec::new();
        mavlink::write_v1_msg(&mut bytes, header, &MavMessage::TIMESYNC(message)).unwrap();
        assert_eq!(all(&mut MavlinkInbox::default(), &bytes), [9]);
    }
}
