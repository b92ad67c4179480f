//! Header before the images of a frame that a program sends over a socket (`docs/own-sensors.md` of the project).

/// The first bytes of every frame: the format and its version.
pub const MAGIC: [u8; 8] = *b"PLMBFRM1";

/// Header before the images of a frame: 40 bytes, numbers little-endian.
///
/// | bytes | what |
/// |---|---|
/// | 0..8 | `PLMBFRM1` |
/// | 8..16 | number of the frame, counted by the camera |
/// | 16..24 | middle of the exposure, ns of CLOCK_MONOTONIC (or of the system clock) |
/// | 24..32 | width and height of the left image, px |
/// | 32..40 | width and height of the right image, px |
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameHeader {
    /// Counts frames of the camera; a jump says how many were lost.
    pub sequence: u64,
    /// Middle of the exposure, ns.
    pub stamp_ns: i64,
    /// Width and height of both images, px; zeros for one that is missing.
    pub sizes_px: [(u32, u32); 2],
}

/// Reason why bytes are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameRefusal {
    /// The bytes do not begin as a frame does.
    Foreign,
    /// The images of the camera have another size: left or right, and theirs.
    Size(usize, (u32, u32)),
    /// There is no image in it.
    Empty,
}

impl FrameHeader {
    /// Bytes of a header.
    pub const BYTES: usize = 40;

    /// Encoded header.
    #[must_use]
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..16].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.stamp_ns.to_le_bytes());
        let sides = self.sizes_px.iter().flat_map(|(width, height)| [width, height]);
        for (to, side) in bytes[24..].chunks_exact_mut(4).zip(sides) {
            to.copy_from_slice(&side.to_le_bytes());
        }
        bytes
    }

    /// The header of a frame for a rig of these sizes, px ((0, 0) for a camera that is not there). Images of another size
    /// are refused: their length is known before any of their bytes is read.
    ///
    /// # Errors
    /// When the bytes are none.
    pub fn decode(bytes: &[u8; Self::BYTES], rig_px: [(usize, usize); 2]) -> Result<Self, FrameRefusal> {
        let (magic, rest) = bytes.split_at(MAGIC.len());
        if magic != MAGIC {
            return Err(FrameRefusal::Foreign);
        }
        let eight = |at: usize| -> [u8; 8] { core::array::from_fn(|i| rest[at + i]) };
        let four = |at: usize| u32::from_le_bytes(core::array::from_fn(|i| rest[at + i]));
        let header = Self {
            sequence: u64::from_le_bytes(eight(0)),
            stamp_ns: i64::from_le_bytes(eight(8)),
            sizes_px: [(four(16), four(20)), (four(24), four(28))],
        };
        for (camera, (size, rig)) in header.sizes_px.iter().zip(rig_px).enumerate() {
            let is_rigs = (size.0 as usize, size.1 as usize) == rig;
            if *size != (0, 0) && !is_rigs {
                return Err(FrameRefusal::Size(camera, *size));
            }
        }
        match header.valid() {
            [false, false] => Err(FrameRefusal::Empty),
            _ => Ok(header),
        }
    }

    /// Images that are there.
    #[must_use]
    pub fn valid(&self) -> [bool; 2] {
        self.sizes_px.map(|size| size != (0, 0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: [(usize, usize); 2] = [(752, 480), (640, 400)];

    fn header(sizes_px: [(u32, u32); 2]) -> FrameHeader {
        FrameHeader { sequence: 0x0102_0304_0506_0708, stamp_ns: -7_000_000_001, sizes_px }
    }

    #[test]
    fn what_is_encoded_comes_back() {
        for sizes in [[(752, 480), (640, 400)], [(0, 0), (640, 400)], [(752, 480), (0, 0)]] {
            let header = header(sizes);
            assert_eq!(FrameHeader::decode(&header.encode(), RIG), Ok(header));
            assert_eq!(header.valid(), sizes.map(|size| size.0 > 0));
        }
    }

    #[test]
    fn the_bytes_are_those_of_the_document() {
        let bytes = FrameHeader { sequence: 5, stamp_ns: 1, sizes_px: [(2, 3), (4, 1)] }.encode();
        let expected =
            b"PLMBFRM1\x05\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\x02\0\0\0\x03\0\0\0\x04\0\0\0\x01\0\0\0";
        assert_eq!(bytes, *expected);
    }

    #[test]
    fn what_does_not_fit_the_rig_is_refused_before_its_images_are_read() {
        let refused = |header: FrameHeader| FrameHeader::decode(&header.encode(), RIG).unwrap_err();
        assert_eq!(
            refused(header([(u32::MAX, u32::MAX), (640, 400)])),
            FrameRefusal::Size(0, (u32::MAX, u32::MAX))
        );
        assert_eq!(refused(header([(752, 480), (640, 480)])), FrameRefusal::Size(1, (640, 480)));
        assert_eq!(refused(header([(752, 0), (640, 400)])), FrameRefusal::Size(0, (752, 0)));
        assert_eq!(refused(header([(0, 0); 2])), FrameRefusal::Empty);
        let one_camera =
            FrameHeader::decode(&header([(752, 480), (640, 400)]).encode(), [(752, 480), (0, 0)]);
        assert_eq!(one_camera, Err(FrameRefusal::Size(1, (640, 400))));
        assert_eq!(FrameHeader::decode(&[b'P'; FrameHeader::BYTES], RIG), Err(FrameRefusal::Foreign));
    }
}
