//! One message to one frame, and back.

use crate::message::{Message, Reader, Writer};
use core::fmt;
use crc::{CRC_32_ISO_HDLC, Crc};

/// Longest body (type, payload, CRC) that is taken, bytes: room for payloads to grow.
pub(crate) const MAX_BODY: usize = 96;
/// Length of the longest body in COBS, without the zeros around it, bytes.
pub(crate) const MAX_ENCODED: usize = cobs::max_encoding_length(MAX_BODY);
/// Longest frame, with the zero before it and the one after it, bytes.
pub const MAX_FRAME: usize = MAX_ENCODED + 2;

/// Type and CRC: the shortest body.
const MIN_BODY: usize = 1 + CRC_BYTES;
const CRC_BYTES: usize = 4;

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Reasons why bytes are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// Longer or shorter than any.
    Length,
    /// It breaks the rule of its encoding.
    Encoding,
    /// The checksum is wrong.
    Checksum,
    /// The checksum is right, but the type is unknown or the payload too short for it.
    Unknown,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "a frame of impossible length",
            Self::Encoding => "not COBS",
            Self::Checksum => "the checksum is wrong",
            Self::Unknown => "a message of a type that is not known",
        })
    }
}

impl core::error::Error for FrameError {}

/// Writes the frame of a message, zeros before and after it, and gives its bytes.
pub fn encode<'a>(message: &Message, frame: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
    let mut body = [0; MAX_BODY];
    let mut writer = Writer { bytes: &mut body, length: 0 };
    writer.put([message.kind()]);
    message.write(&mut writer);
    let length = writer.length;
    let crc = CRC.checksum(&body[..length]);
    body[length..length + CRC_BYTES].copy_from_slice(&crc.to_le_bytes());
    let encoded = cobs::encode_including_sentinels(&body[..length + CRC_BYTES], frame);
    &frame[..encoded]
}

/// Reads what stands between two zeros.
///
/// # Errors
/// When it is no message.
pub fn decode(encoded: &[u8]) -> Result<Message, FrameError> {
    if !(MIN_BODY + 1..=MAX_ENCODED).contains(&encoded.len()) {
        return Err(FrameError::Length);
    }
    let mut bytes = [0; MAX_ENCODED];
    let bytes = &mut bytes[..encoded.len()];
    bytes.copy_from_slice(encoded);
    // A zero within would end the frame before its end.
    if bytes.contains(&0) {
        return Err(FrameError::Encoding);
    }
    let length = cobs::decode_in_place(bytes).map_err(|_| FrameError::Encoding)?;
    let body = bytes.get(..length).ok_or(FrameError::Encoding)?;
    let (content, crc) = body.split_last_chunk::<CRC_BYTES>().ok_or(FrameError::Length)?;
    if CRC.checksum(content) != u32::from_le_bytes(*crc) {
        return Err(FrameError::Checksum);
    }
    let (kind, payload) = content.split_first().ok_or(FrameError::Length)?;
    Message::read(*kind, &mut Reader(payload)).ok_or(FrameError::Unknown)
}
