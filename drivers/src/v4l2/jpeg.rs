//! Luma of the JPEG images that cameras send (MJPEG): baseline, 8 bits, Huffman codes (ITU-T T.81).
//!
//! The decoder is zune-jpeg, compiled without SIMD, so that every processor gets the same pixels. It runs on the driver's
//! thread and allocates for each image, within bounds that follow from the size that the camera was set to.
//!
//! zune-jpeg fills in for data that end before the image does, as a viewer should and a flight must not, and mixes up
//! components that are sent one after the other. Therefore images are put together anew before they are decoded: the first
//! scan alone, of a frame that has luma alone where the scan has, and [`NO_CODE`] behind its data. Reading on is an error.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

const START_OF_IMAGE: [u8; 2] = [0xff, 0xd8];
/// Segment of the images in AVI files: codes that are not sent are those of the standard (T.81, Annex K). Many cameras
/// leave their tables out without saying so.
const STANDARD_CODES: [u8; 9] = [0xff, 0xe0, 0, 7, b'A', b'V', b'I', b'1', 0];
/// Bits that are all ones, escaped: no code consists of ones alone (T.81, Annex C). More than the decoder reads ahead.
const NO_CODE: [[u8; 2]; 16] = [[0xff, 0]; 16];
/// Markers of segments: tables of codes, and the start of a scan.
const HUFFMAN: u8 = 0xc4;
const SCAN: u8 = 0xda;

/// Width and height of the JPEG image in `bytes`, px; `None` for one that is not read.
pub(crate) fn size_of(bytes: &[u8]) -> Option<(usize, usize)> {
    Parts::of(bytes).map(|parts| parts.size())
}

/// Number of components of an image; 0 where it is none that is read.
pub(crate) fn components_of(bytes: &[u8]) -> u8 {
    Parts::of(bytes).map_or(0, |parts| parts.frame[5])
}

/// An image taken apart (T.81, Annex B).
struct Parts<'a> {
    /// Segments up to the frame's.
    before: &'a [u8],
    /// Payload of the frame's segment: bits, height, width, number of components, and three bytes of each.
    frame: &'a [u8],
    /// Segments up to the first scan's, that one, and its data.
    scan: &'a [u8],
    /// Number of components in the scan.
    scanned: u8,
}

impl<'a> Parts<'a> {
    fn of(bytes: &'a [u8]) -> Option<Self> {
        let body = bytes.strip_prefix(&START_OF_IMAGE)?;
        let (mut at, mut frame) = (0, None);
        loop {
            match body[at..] {
                // The second of these fills, and may begin a marker.
                [0xff, 0xff, ..] => at += 1,
                [0xff, marker @ 0xc0..=0xfe, high, low, ref rest @ ..] => {
                    let length = usize::from(u16::from_be_bytes([high, low]));
                    let payload = rest.get(..length.checked_sub(2)?)?;
                    let end = at + 2 + length;
                    match (marker, payload, &frame) {
                        (0xc0 | 0xc1, [8, _, _, _, _, 1..=4, ..], None) => frame = Some((at, payload, end)),
                        (SCAN, [scanned, ..], Some((start, frame, frame_end))) => {
                            let scan = &body[*frame_end..end + data_length(&body[end..])];
                            return Some(Self { before: &body[..*start], frame, scan, scanned: *scanned });
                        }
                        (HUFFMAN | 0xc8 | 0xcc, ..) => {}
                        // Progressive, arithmetic, lossless, or of 12 bits: cameras send none of these.
                        (0xc0..=0xcf | SCAN, ..) => return None,
                        _ => {}
                    }
                    at = end;
                }
                _ => return None,
            }
        }
    }

    fn size(&self) -> (usize, usize) {
        let side = |at: usize| usize::from(u16::from_be_bytes([self.frame[at], self.frame[at + 1]]));
        (side(3), side(1))
    }

    /// True if only the height of chroma is halved.
    fn is_tall(&self) -> bool {
        self.scanned > 1 && self.frame.get(7) == Some(&0x12)
    }

    /// Writes the image as it is decoded: luma alone where the scan has nothing else, in blocks that then follow each other.
    fn write(&self, data: &mut Vec<u8>) -> Option<()> {
        let is_alone = self.scanned == 1;
        let components = if is_alone { 1 } else { self.frame[5] };
        let list = self.frame.get(6..6 + 3 * usize::from(components))?;
        if self.scanned != components {
            return None;
        }
        let segment = [0xff, 0xc0, 0, 8 + list.len() as u8];
        data.clear();
        let parts: [&[u8]; 8] = [
            &START_OF_IMAGE,
            &STANDARD_CODES,
            self.before,
            &segment,
            &self.frame[..5],
            &[components],
            list,
            self.scan,
        ];
        parts.iter().for_each(|part| data.extend_from_slice(part));
        if is_alone {
            let sampling = data.len() - self.scan.len() - 2;
            data[sampling] = 0x11;
        }
        data.extend_from_slice(NO_CODE.as_flattened());
        Some(())
    }
}

/// Length of the data of a scan: up to a marker that is neither an escaped byte nor a restart.
fn data_length(data: &[u8]) -> usize {
    let is_end = |two: &[u8]| two[0] == 0xff && !matches!(two[1], 0 | 0xd0..=0xd7 | 0xff);
    data.windows(2).position(is_end).unwrap_or(data.len())
}

/// Decodes the images of one camera.
#[derive(Debug)]
pub struct LumaDecoder {
    width: usize,
    height: usize,
    /// Input of the decoder.
    data: Vec<u8>,
    /// Pixels, of which luma comes first.
    luma: Vec<u8>,
}

impl LumaDecoder {
    /// For images of this size, px.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, data: Vec::new(), luma: Vec::new() }
    }

    /// Luma of an image, row by row; `None` when the bytes are none that is read. One of another size is refused before
    /// anything is allocated.
    pub fn decode(&mut self, bytes: &[u8]) -> Option<&[u8]> {
        let parts = Parts::of(bytes)?;
        if parts.size() != (self.width, self.height) {
            return None;
        }
        parts.write(&mut self.data)?;
        let (wanted, channels) = if parts.is_tall() { (ColorSpace::YCbCr, 3) } else { (ColorSpace::Luma, 1) };
        let options = DecoderOptions::default().jpeg_set_out_colorspace(wanted).set_strict_mode(true);
        let limits = options.set_max_width(self.width).set_max_height(self.height);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(self.data.as_slice()), limits);
        let pixels = self.width * self.height;
        self.luma.resize(channels * pixels, 0);
        decoder.decode_into(&mut self.luma).ok()?;
        (0..pixels).filter(|_| channels > 1).for_each(|k| self.luma[k] = self.luma[channels * k]);
        Some(&self.luma[..pixels])
    }
}

#[cfg(test)]
mod tests;
