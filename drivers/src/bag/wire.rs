//! Fields of ROS messages in their bytes, as far as images and inertial samples need them: CDR, the encoding of ROS 2 (OMG
//! DDS-XTypes 1.3, section 7.4.1), and the serialization of ROS 1.
//!
//! Our own, and small: a message is a view into the bytes that were read, where a deserializer would copy every image.
//! Alignment of CDR counts from the end of the header of four bytes; the header says which end comes first.

/// Nanoseconds of a second.
const SECOND_NS: i64 = 1_000_000_000;

/// Encoding of the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// Plain CDR of either byte order: ROS 2.
    Cdr,
    /// Little-endian fields without gaps: ROS 1.
    Ros1,
}

impl Encoding {
    /// Encoding of that name in an MCAP file or a table of topics.
    pub(crate) fn named(name: &str) -> Option<Self> {
        match name {
            "cdr" => Some(Self::Cdr),
            "ros1" => Some(Self::Ros1),
            _ => None,
        }
    }
}

/// Message that is being read field by field. A field beyond its end is `None`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wire<'a> {
    encoding: Encoding,
    body: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Wire<'a> {
    /// The message in `bytes`.
    pub(crate) fn new(encoding: Encoding, bytes: &'a [u8]) -> Option<Self> {
        if encoding == Encoding::Ros1 {
            return Some(Self { encoding, body: bytes, at: 0, is_little: true });
        }
        let (header, body) = bytes.split_at_checked(4)?;
        let is_little = match header[..2] {
            [0, 0] => false,
            [0, 1] => true,
            // Parameter lists and the second version: no ROS 2 message is sent so.
            _ => return None,
        };
        Some(Self { encoding, body, at: 0, is_little })
    }

    fn align(&mut self, size: usize) {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(size);
        }
    }

    /// Stamp of the header that messages of sensors begin with, ns.
    pub(crate) fn header(&mut self) -> Option<i64> {
        let (seconds, nanos) = self.header_time()?;
        let _frame = self.sequence()?;
        (nanos < SECOND_NS).then_some(seconds * SECOND_NS + nanos)
    }

    /// Seconds and nanoseconds of the header as they are.
    pub(crate) fn header_time(&mut self) -> Option<(i64, i64)> {
        let seconds = match self.encoding {
            Encoding::Cdr => i64::from(self.i32()?),
            Encoding::Ros1 => {
                let _sequence = self.u32()?;
                i64::from(self.u32()?)
            }
        };
        Some((seconds, i64::from(self.u32()?)))
    }

    /// `count` bytes as they are.
    pub(crate) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let bytes = self.body.get(self.at..end)?;
        self.at = end;
        Some(bytes)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.align(N);
        let mut bytes: [u8; N] = self.bytes(N)?.try_into().ok()?;
        if !self.is_little {
            bytes.reverse();
        }
        Some(bytes)
    }

    /// A byte.
    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(u8::from_le_bytes)
    }

    /// Four bytes.
    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array::<4>().map(u32::from_le_bytes)
    }

    /// Four bytes with a sign.
    pub(crate) fn i32(&mut self) -> Option<i32> {
        self.array::<4>().map(i32::from_le_bytes)
    }

    /// A number.
    pub(crate) fn f64(&mut self) -> Option<f64> {
        self.array::<8>().map(f64::from_le_bytes)
    }

    /// Three numbers.
    pub(crate) fn vector(&mut self) -> Option<nalgebra::Vector3<f64>> {
        Some(nalgebra::Vector3::new(self.f64()?, self.f64()?, self.f64()?))
    }

    /// A sequence of bytes.
    pub(crate) fn sequence(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()? as usize;
        self.bytes(count)
    }

    /// A text. In CDR its closing zero counts in its length.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let bytes = self.sequence()?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ends_are_read_and_alignment_counts_from_behind_the_header() {
        // A byte, then a number of four bytes at 4, a text, and one of eight at 16.
        let little =
            [0, 1, 0, 0, 7, 9, 9, 9, 1, 2, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 9, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f];
        let big =
            [0, 0, 0, 0, 7, 9, 9, 9, 0, 0, 2, 1, 0, 0, 0, 3, b'a', b'b', 0, 9, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0];
        for bytes in [little, big] {
            let mut wire = Wire::new(Encoding::Cdr, &bytes).unwrap();
            assert_eq!((wire.u8(), wire.u32(), wire.text()), (Some(7), Some(513), Some("ab")));
            assert_eq!((wire.f64(), wire.u8()), (Some(1.0), None));
        }
    }

    #[test]
    fn what_ends_early_or_is_of_another_kind_is_none() {
        assert!(
            Wire::new(Encoding::Cdr, &[0, 1, 0]).is_none()
                && Wire::new(Encoding::Cdr, &[0, 3, 0, 0, 1]).is_none()
        );
        let mut wire = Wire::new(Encoding::Cdr, &[0, 1, 0, 0, 255, 255, 255, 255, 1]).unwrap();
        assert_eq!(wire.sequence(), None);
    }

    #[test]
    fn ros_1_has_no_header_of_its_own_and_no_gaps() {
        let bytes = [7, 1, 2, 0, 0, 2, 0, 0, 0, b'a', b'b', 0, 0, 0, 0, 0, 0, 0xf0, 0x3f];
        let mut wire = Wire::new(Encoding::Ros1, &bytes).unwrap();
        assert_eq!((wire.u8(), wire.u32(), wire.text()), (Some(7), Some(513), Some("ab")));
        assert_eq!((wire.f64(), wire.u8()), (Some(1.0), None));
        // Sequence number, seconds, nanoseconds, and the name of the frame.
        let header = [9, 0, 0, 0, 2, 0, 0, 0, 5, 0, 0, 0, 1, 0, 0, 0, b'x'];
        assert_eq!(Wire::new(Encoding::Ros1, &header).unwrap().header(), Some(2_000_000_005));
    }
}
