//! Calibration of the infrared pair, as the camera stores it: table 25 of its firmware.
//!
//! The layout is that of `d400_coefficients_table` in librealsense (`src/ds/d400/d400-private.h`): a header of 16 bytes with
//! the CRC-32 of what follows, raw intrinsics of both imagers, baseline, and for each size of the rectified images focal
//! lengths and principal point. Numbers are little-endian floats of 32 bits. Plumbline reads the rectified images (`Y8I`), so
//! the last part is what counts.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use thiserror::Error;

/// Number of the table in the firmware.
pub const TABLE_ID: u32 = 25;
/// Longest table that is looked at, bytes.
pub const MAX_TABLE_BYTES: usize = 4096;

const HEADER_BYTES: usize = 16;
const TYPE_AT: usize = 2;
const CRC_AT: usize = 12;
/// Place of the baseline: behind the header and four matrices of 3 x 3.
const BASELINE_AT: usize = HEADER_BYTES + 4 * 36;
/// Place of the rectified sizes: behind baseline, distortion model and a reserve of 88 bytes.
const SIZES_AT: usize = BASELINE_AT + 4 + 4 + 88;
/// Bytes of one size: focal lengths and principal point.
const SIZE_BYTES: usize = 16;

/// Width and height of the rectified images, by their place in the table; `None` for a place without a use.
const SIZES_PX: [Option<(usize, usize)>; 13] = [
    Some((1920, 1080)),
    Some((1280, 720)),
    Some((640, 480)),
    Some((848, 480)),
    Some((640, 360)),
    Some((424, 240)),
    Some((320, 240)),
    Some((480, 270)),
    Some((1280, 800)),
    Some((960, 540)),
    None,
    None,
    Some((640, 400)),
];

/// Baselines that a camera of this family can have, m.
const BASELINE_M: std::ops::RangeInclusive<f64> = 0.01..=0.5;
/// Focal lengths in units of the width: fields of view from 20 to 140 degrees.
const FOCAL_PER_WIDTH: std::ops::RangeInclusive<f64> = 0.18..=2.9;

/// Intrinsics of the rectified images in one size. Both imagers share them, and lenses do not distort any more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RectifiedSize {
    /// Width, px.
    pub width_px: usize,
    /// Height, px.
    pub height_px: usize,
    /// Focal lengths, px.
    pub focal_px: [f64; 2],
    /// Principal point, px. The centre of the first pixel is at 0.
    pub centre_px: [f64; 2],
}

/// Calibration of a camera's infrared pair.
#[derive(Clone, Debug, PartialEq)]
pub struct StereoTable {
    /// Distance between the imagers, m.
    pub baseline_m: f64,
    /// Sizes with an entry, in the order of the table.
    pub sizes: Vec<RectifiedSize>,
}

/// Reason why a table cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum TableError {
    /// It ends before its last part.
    #[error("the calibration table has {0} bytes, fewer than its header and a size of images need")]
    Short(usize),
    /// It is longer than any.
    #[error("the calibration table has {0} bytes, more than any that is known ({MAX_TABLE_BYTES})")]
    Long(usize),
    /// It is another table.
    #[error("table {0} is no calibration of the infrared pair, which is {TABLE_ID}")]
    Other(u16),
    /// The bytes are damaged.
    #[error("the calibration table is damaged: its checksum is {found:08x}, and {stated:08x} is stated")]
    Checksum {
        /// CRC-32 of the bytes.
        found: u32,
        /// CRC-32 in the header.
        stated: u32,
    },
    /// Such a camera cannot have this baseline.
    #[error("the calibration table states a baseline of {0} m")]
    Baseline(f64),
    /// No size has intrinsics of a camera.
    #[error("the calibration table has no intrinsics for any size of images")]
    Empty,
}

impl StereoTable {
    /// Reads a table with its header.
    ///
    /// # Errors
    /// When it is cut off, damaged, another one, or states what no camera has.
    pub fn parse(bytes: &[u8]) -> Result<Self, TableError> {
        if bytes.len() > MAX_TABLE_BYTES {
            return Err(TableError::Long(bytes.len()));
        }
        let too_short = TableError::Short(bytes.len());
        if bytes.len() < SIZES_AT + SIZE_BYTES {
            return Err(too_short);
        }
        let word =
            |at: usize| bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().map(u32::from_le_bytes);
        let kind = bytes.get(TYPE_AT..).and_then(|rest| rest.first_chunk()).copied().map(u16::from_le_bytes);
        let (Some(kind), Some(stated)) = (kind, word(CRC_AT)) else { return Err(too_short) };
        if u32::from(kind) != TABLE_ID {
            return Err(TableError::Other(kind));
        }
        let found = checksum(&bytes[HEADER_BYTES..]);
        if found != stated {
            return Err(TableError::Checksum { found, stated });
        }
        let number = |at: usize| word(at).map(|bits| f64::from(f32::from_bits(bits)));
        // Millimetres; the sign is a matter of direction.
        let baseline_m = number(BASELINE_AT).unwrap_or(f64::NAN).abs() * 1e-3;
        if !BASELINE_M.contains(&baseline_m) {
            return Err(TableError::Baseline(baseline_m));
        }
        let sizes: Vec<_> = (0..SIZES_PX.len())
            .filter_map(|place| {
                let at = SIZES_AT + place * SIZE_BYTES;
                let [fx, fy, cx, cy] = [0, 4, 8, 12].map(|offset| number(at + offset));
                size(SIZES_PX[place]?, [fx?, fy?], [cx?, cy?])
            })
            .collect();
        match sizes.is_empty() {
            true => Err(TableError::Empty),
            false => Ok(Self { baseline_m, sizes }),
        }
    }

    /// Intrinsics of images of this size.
    #[must_use]
    pub fn of_size(&self, width_px: usize, height_px: usize) -> Option<&RectifiedSize> {
        self.sizes.iter().find(|size| (size.width_px, size.height_px) == (width_px, height_px))
    }
}

/// Entry of a size, unless it is empty or impossible.
fn size(
    (width_px, height_px): (usize, usize),
    focal_px: [f64; 2],
    centre_px: [f64; 2],
) -> Option<RectifiedSize> {
    let sides = [width_px as f64, height_px as f64];
    let is_focal = |focal: &f64| FOCAL_PER_WIDTH.contains(&(focal / sides[0]));
    let is_inside = |(centre, side): (&f64, f64)| (0.0..side).contains(centre);
    let is_camera = focal_px.iter().all(is_focal) && centre_px.iter().zip(sides).all(is_inside);
    is_camera.then_some(RectifiedSize { width_px, height_px, focal_px, centre_px })
}

/// CRC-32 of the table's content.
fn checksum(content: &[u8]) -> u32 {
    Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC).checksum(content)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A table as the firmware of a D435i has it, with 848 x 480 and 1280 x 720 alone.
    pub(crate) fn table() -> Vec<u8> {
        let mut bytes = vec![0; SIZES_AT + 16 * SIZE_BYTES + 64];
        let mut put = |at: usize, number: f32| bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        put(BASELINE_AT, -50.12);
        for (place, [fx, fy, cx, cy]) in
            [(3, [424.75, 424.75, 421.5, 238.25]), (1, [641.1, 641.1, 636.2, 357.3])]
        {
            for (k, number) in [fx, fy, cx, cy].into_iter().enumerate() {
                put(SIZES_AT + place * SIZE_BYTES + 4 * k, number);
            }
        }
        sealed(bytes)
    }

    /// The table with number and checksum in its header.
    pub(crate) fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
        bytes[TYPE_AT..TYPE_AT + 2].copy_from_slice(&(TABLE_ID as u16).to_le_bytes());
        let crc = checksum(&bytes[HEADER_BYTES..]);
        bytes[CRC_AT..CRC_AT + 4].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    #[test]
    fn intrinsics_and_baseline_are_those_of_the_table() {
        let table = StereoTable::parse(&table()).unwrap();
        assert!((table.baseline_m - 0.05012).abs() < 1e-7);
        let size = table.of_size(848, 480).unwrap();
        assert_eq!((size.focal_px, size.centre_px), ([424.75; 2], [421.5, 238.25]));
        assert_eq!(table.sizes.len(), 2);
        assert_eq!(table.of_size(640, 480), None);
    }

    #[test]
    fn the_checksum_is_that_of_zlib() {
        // The check value of CRC-32/ISO-HDLC.
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn damaged_and_cut_tables_are_refused_with_the_cause() {
        let whole = table();
        for length in 0..SIZES_AT + SIZE_BYTES {
            assert_eq!(StereoTable::parse(&whole[..length]), Err(TableError::Short(length)));
        }
        let mut other = whole.clone();
        other[BASELINE_AT] ^= 1;
        assert!(matches!(StereoTable::parse(&other), Err(TableError::Checksum { .. })));
        let mut other = whole.clone();
        other[TYPE_AT] = 32;
        assert_eq!(StereoTable::parse(&other), Err(TableError::Other(32)));
        assert_eq!(StereoTable::parse(&[0; MAX_TABLE_BYTES + 1]), Err(TableError::Long(MAX_TABLE_BYTES + 1)));
    }

    #[test]
    fn impossible_numbers_are_no_calibration() {
        let with = |at: usize, number: f32| {
            let mut bytes = table();
            bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
            StereoTable::parse(&sealed(bytes))
        };
        assert!(matches!(with(BASELINE_AT, f32::NAN), Err(TableError::Baseline(_))));
        assert!(matches!(with(BASELINE_AT, 50_000.0), Err(TableError::Baseline(_))));
        // One size with a focal length of nothing: the other stands.
        let left = with(SIZES_AT + 3 * SIZE_BYTES, 0.0).unwrap();
        assert_eq!((left.sizes.len(), left.of_size(848, 480)), (1, None));
        let none = sealed({
            let mut bytes = table();
            bytes[SIZES_AT..].fill(0);
            bytes
        });
        assert_eq!(StereoTable::parse(&none), Err(TableError::Empty));
    }
}
