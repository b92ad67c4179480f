//! CDR, the encoding of ROS 2 messages (OMG DDS-XTypes 1.3, section 7.4.1), as far as images and inertial samples need it.
//!
//! Our own, and small: a message is a view into the bytes that were read, where a deserializer would copy every image.
//! Alignment counts from the end of the header of four bytes; the header says which end comes first.

/// A message that is being read. Everything that is not there is `None`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
    is_little: bool,
}

impl<'a> Cdr<'a> {
    /// The message in `bytes`: plain CDR of either end.
    pub(crate) fn new(bytes: &'a [u8]) -> Option<Self> {
        let (header, body) = bytes.split_at_checked(4)?;
        let is_little = match header[..2] {
            [0, 0] => false,
            [0, 1] => true,
            // Parameter lists and the second version: no ROS 2 message is sent so.
            _ => return None,
        };
        Some(Self { body, at: 0, is_little })
    }

    fn align(&mut self, size: usize) {
        self.at = self.at.next_multiple_of(size);
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

    /// A text; its closing zero counts in its length.
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
            let mut cdr = Cdr::new(&bytes).unwrap();
            assert_eq!((cdr.u8(), cdr.u32(), cdr.text()), (Some(7), Some(513), Some("ab")));
            assert_eq!((cdr.f64(), cdr.u8()), (Some(1.0), None));
        }
    }

    #[test]
    fn what_ends_early_or_is_of_another_kind_is_none() {
        assert!(Cdr::new(&[0, 1, 0]).is_none() && Cdr::new(&[0, 3, 0, 0, 1]).is_none());
        let mut cdr = Cdr::new(&[0, 1, 0, 0, 255, 255, 255, 255, 1]).unwrap();
        assert_eq!(cdr.sequence(), None);
    }
}
