//! Frames of MAVLink 1 and 2, as far as they carry the messages that concern us.
//!
//! The checksum of a frame covers a byte that is not on the wire and differs from message to message (`CRC_EXTRA`): a frame
//! can be checked only by whoever knows its message. Messages that do not concern us are passed over byte by byte, which
//! finds the frame behind them whatever they hold.
//!
//! Source: <https://mavlink.io/en/guide/serialization.html>; numbers of messages, lengths and CRC_EXTRA are those of the
//! definitions (`common.xml`); tests of the runtime hold them against the library that is generated from these.

use super::super::framing::{Scan, before_any};
use crc::{CRC_16_MCRF4XX, Crc};

/// First byte of a MAVLink 1 frame.
const MAGIC_1: u8 = 0xFE;
/// First byte of a MAVLink 2 frame.
const MAGIC_2: u8 = 0xFD;
/// Bytes before the payload, with the first.
const HEADER_1: usize = 6;
const HEADER_2: usize = 10;
const CHECKSUM: usize = 2;
/// A signature follows the checksum.
const SIGNED: u8 = 1;
const SIGNATURE: usize = 13;
/// Longest payload of a message that concerns us, bytes.
pub const MAX_PAYLOAD: usize = 63;
/// Longest message that we write, bytes.
pub const MAX_WRITTEN: usize = HEADER_2 + MAX_PAYLOAD + CHECKSUM;

static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);

/// A message that concerns us.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageKind {
    /// Number of the message.
    pub id: u32,
    /// The byte that its checksum covers besides.
    extra: u8,
    /// Length of its payload in MAVLink 1, and with the extensions of MAVLink 2, bytes.
    lengths: [usize; 2],
}

impl MessageKind {
    pub const SCALED_IMU: Self = Self { id: 26, extra: 170, lengths: [22, 24] };
    pub const RAW_IMU: Self = Self { id: 27, extra: 144, lengths: [26, 29] };
    pub const COMMAND_LONG: Self = Self { id: 76, extra: 152, lengths: [33, 33] };
    pub const HIGHRES_IMU: Self = Self { id: 105, extra: 93, lengths: [62, 63] };
    pub const TIMESYNC: Self = Self { id: 111, extra: 34, lengths: [16, 18] };
    pub const SCALED_IMU2: Self = Self { id: 116, extra: 76, lengths: [22, 24] };
    pub const SCALED_IMU3: Self = Self { id: 129, extra: 46, lengths: [22, 24] };

    /// Messages that are received.
    const ALL: [Self; 6] = [
        Self::SCALED_IMU,
        Self::RAW_IMU,
        Self::HIGHRES_IMU,
        Self::TIMESYNC,
        Self::SCALED_IMU2,
        Self::SCALED_IMU3,
    ];

    fn of(id: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.id == id)
    }
}

/// A frame, taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MavlinkFrame {
    pub kind: MessageKind,
    pub system_id: u8,
    pub component_id: u8,
    /// Bytes that were not sent are zero, as the protocol has it.
    pub payload: [u8; MAX_PAYLOAD],
}

/// Layout of a frame, once its header is there and makes sense.
struct Layout {
    kind: MessageKind,
    header: usize,
    payload: usize,
    /// Length of the whole frame, signature included.
    whole: usize,
}

enum Header {
    Sensible(Layout),
    Incomplete,
    /// It is none, or of a message that does not concern us.
    Foreign,
    /// A payload of a length that the message does not have.
    Absurd,
}

fn header(bytes: &[u8]) -> Header {
    let (id, header, payload, tail) = match *bytes {
        [MAGIC_1, payload, _, _, _, id, ..] => (u32::from(id), HEADER_1, payload, CHECKSUM),
        [MAGIC_2, payload, flags, _, _, _, _, a, b, c, ..] if flags & !SIGNED == 0 => {
            let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE };
            (u32::from_le_bytes([a, b, c, 0]), HEADER_2, payload, CHECKSUM + signature)
        }
        [MAGIC_1] | [MAGIC_1, _] | [MAGIC_2] | [MAGIC_2, _] => return Header::Incomplete,
        [MAGIC_1, ..] if bytes.len() < HEADER_1 => return Header::Incomplete,
        [MAGIC_2, _, flags, ..] if bytes.len() < HEADER_2 && flags & !SIGNED == 0 => {
            return Header::Incomplete;
        }
        _ => return Header::Foreign,
    };
    let Some(kind) = MessageKind::of(id) else { return Header::Foreign };
    let payload = usize::from(payload);
    // MAVLink 2 leaves zeros at the end of a payload out, but for the first byte.
    let is_possible = match header {
        HEADER_1 => payload == kind.lengths[0],
        _ => (1..=kind.lengths[1]).contains(&payload),
    };
    match is_possible {
        true => Header::Sensible(Layout { kind, header, payload, whole: header + payload + tail }),
        false => Header::Absurd,
    }
}

/// Beginning of `bytes`: a frame, an incomplete one, or noise.
pub fn scan(bytes: &[u8]) -> Scan {
    match header(bytes) {
        Header::Sensible(layout) if bytes.len() < layout.whole => Scan::More,
        Header::Sensible(layout) => {
            let end = layout.header + layout.payload;
            let told = u16::from_le_bytes([bytes[end], bytes[end + 1]]);
            match checksum(&bytes[1..end], layout.kind) == told {
                true => Scan::Frame(layout.whole),
                false => Scan::BadChecksum(1),
            }
        }
        Header::Incomplete => Scan::More,
        Header::Absurd => Scan::BadLength(1),
        Header::Foreign => Scan::Noise(1 + before_any(&bytes[1..], &[MAGIC_1, MAGIC_2])),
    }
}

/// Takes a frame apart that [`scan`] has found.
pub fn parse(bytes: &[u8]) -> Option<MavlinkFrame> {
    let Header::Sensible(Layout { kind, header, payload: length, .. }) = header(bytes) else { return None };
    let mut payload = [0; MAX_PAYLOAD];
    payload[..length].copy_from_slice(bytes.get(header..header + length)?);
    let sender = if header == HEADER_1 { 3 } else { 5 };
    Some(MavlinkFrame { kind, system_id: bytes[sender], component_id: bytes[sender + 1], payload })
}

fn checksum(covered: &[u8], kind: MessageKind) -> u16 {
    let mut digest = CRC.digest();
    digest.update(covered);
    digest.update(&[kind.extra]);
    digest.finalize()
}

/// Writes a message of MAVLink 2; its bytes.
pub fn write<'a>(frame: &MavlinkFrame, sequence: u8, into: &'a mut [u8; MAX_WRITTEN]) -> &'a [u8] {
    let whole = &frame.payload[..frame.kind.lengths[1]];
    let length = whole.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
    let id = frame.kind.id.to_le_bytes();
    into[..HEADER_2].copy_from_slice(&[
        MAGIC_2,
        length as u8,
        0,
        0,
        sequence,
        frame.system_id,
        frame.component_id,
        id[0],
        id[1],
        id[2],
    ]);
    let end = HEADER_2 + length;
    into[HEADER_2..end].copy_from_slice(&whole[..length]);
    let checksum = checksum(&into[1..end], frame.kind);
    into[end..end + CHECKSUM].copy_from_slice(&checksum.to_le_bytes());
    &into[..end + CHECKSUM]
}
