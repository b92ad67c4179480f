//! Records: a header of fixed size, then bytes of the length that it gives. Numbers are little endian.

use crate::topics::Subscription;

/// First bytes of the greeting: the format and its version.
pub const MAGIC: [u8; 8] = *b"PLMBLCL1";

/// Version of the layouts of this build. Later versions append fields.
pub const VERSION: u16 = 1;

/// Longest record, bytes: room for a picture of 16 megapixels.
pub const MAX_RECORD_BYTES: usize = 17 << 20;

/// The other end announced a record or request longer than any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong;

/// Kind of a record that the flight sends: the topics that have one.
pub use crate::topics::Topic as Kind;

/// Set of kinds, as a reader subscribes to them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kinds(u64);

impl Kinds {
    /// Kinds that a reader can subscribe to. Pictures are asked for by themselves.
    pub const SUBSCRIBABLE: Self = Self::where_subscribed(false);

    /// Kinds that a reader receives before it subscribes.
    pub const DEFAULT: Self = Self::where_subscribed(true);

    /// Set of the kinds that can be subscribed to, or of those that are from the beginning.
    const fn where_subscribed(from_the_beginning: bool) -> Self {
        let (mut bits, mut k) = (0, 0);
        while k < Kind::ALL.len() {
            let is_in = match Kind::ALL[k].row().subscription {
                Subscription::Always => true,
                Subscription::Asked => !from_the_beginning,
                Subscription::Other => false,
            };
            bits |= (is_in as u64) << Kind::ALL[k].kind();
            k += 1;
        }
        Self(bits)
    }

    /// Set of these kinds.
    pub const fn of(kinds: &[Kind]) -> Self {
        let (mut bits, mut k) = (0, 0);
        while k < kinds.len() {
            bits |= 1 << kinds[k].kind();
            k += 1;
        }
        Self(bits)
    }

    /// Set of the kinds in a mask, as far as a reader can subscribe to them: bit `k` stands for kind `k`.
    pub fn of_mask(mask: u64) -> Self {
        Self(mask & Self::SUBSCRIBABLE.0)
    }

    /// Mask of the set.
    #[must_use]
    pub const fn mask(self) -> u64 {
        self.0
    }

    /// True if the set has this kind.
    #[must_use]
    pub const fn has(self, kind: Kind) -> bool {
        kind.kind() > 0 && self.0 & (1 << kind.kind()) != 0
    }

    /// Returns the set without a kind.
    #[must_use]
    pub const fn without(self, kind: Kind) -> Self {
        Self(self.0 & !(1 << kind.kind()))
    }

    /// Returns the kinds of both sets.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Header of a record or request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Number of the kind.
    pub kind: u16,
    /// Version of the layout.
    pub version: u16,
    /// Bytes after the header.
    pub length: u32,
    /// Counts records of this kind; number of the request in a request and in its answer.
    pub sequence: u64,
}

impl Header {
    /// Bytes of a header.
    pub const BYTES: usize = 16;

    /// Bytes of the header.
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[..2].copy_from_slice(&self.kind.to_le_bytes());
        bytes[2..4].copy_from_slice(&self.version.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.length.to_le_bytes());
        bytes[8..].copy_from_slice(&self.sequence.to_le_bytes());
        bytes
    }

    /// Header in these bytes.
    pub fn decode(bytes: &[u8; Self::BYTES]) -> Self {
        let [a, b, c, d, e, f, g, h, sequence @ ..] = *bytes;
        Self {
            kind: u16::from_le_bytes([a, b]),
            version: u16::from_le_bytes([c, d]),
            length: u32::from_le_bytes([e, f, g, h]),
            sequence: u64::from_le_bytes(sequence),
        }
    }
}

/// Encodes a record or request: the header, then what `fill` appends.
pub fn encoded(kind: u16, sequence: u64, fill: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = vec![0; Header::BYTES];
    fill(&mut bytes);
    let length = u32::try_from(bytes.len() - Header::BYTES).unwrap_or(u32::MAX);
    let header = Header { kind, version: VERSION, length, sequence };
    bytes[..Header::BYTES].copy_from_slice(&header.encode());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_comes_back_as_it_was() {
        let header = Header { kind: 16, version: 1, length: 504, sequence: 0x0102_0304_0506_0708 };
        let bytes = header.encode();
        assert_eq!(bytes, *b"\x10\0\x01\0\xf8\x01\0\0\x08\x07\x06\x05\x04\x03\x02\x01");
        assert_eq!(Header::decode(&bytes), header);
    }

    #[test]
    fn a_mask_selects_what_can_be_subscribed_to() {
        let all = Kinds::of_mask(u64::MAX);
        assert_eq!(all, Kinds::SUBSCRIBABLE);
        assert!(!all.has(Kind::Picture) && !all.has(Kind::Result) && all.has(Kind::Ladder));
        assert_eq!(Kinds::DEFAULT.mask(), 0x3_0000);
    }
}
