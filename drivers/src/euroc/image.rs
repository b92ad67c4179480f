//! Grey pixels from a PNG file.
//!
//! The decoder is `png` of the image-rs project: 1.5 ms for a 752x480 grey EuRoC image on one core of
//! the development host, where `zune-png` 0.5 took 2.8 ms.

use crate::{DriverError, open_regular};
use plumbline_config::GrayImage;
use png::{ColorType, Decoder, Limits, Transformations};
use std::io::{BufRead, BufReader, Cursor, ErrorKind, Read, Seek};
use std::ops::RangeInclusive;
use std::path::Path;

/// Largest file that is read; a 16-bit RGB image of 4096x4096 fits.
const MAX_FILE_BYTES: u64 = 128 << 20;
/// What the decoder may allocate for itself.
const MAX_DECODER_BYTES: usize = 64 << 20;

/// Why there is no image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoImage {
    /// There is no such file.
    Missing,
    /// The file cannot be read, is cut off, or is no PNG.
    Corrupt,
    /// The image has this size, which is another than the camera's.
    OtherSize((usize, usize)),
}

/// Buffers that are used again for each image.
#[derive(Debug, Default)]
pub(super) struct ImageReader {
    file: Vec<u8>,
    channels: Vec<u8>,
}

impl ImageReader {
    /// Reads the file at `path` into `image`, whose size it must have. Colour is weighed to grey
    /// (ITU-R BT.601), of 16 bits the upper 8 are kept.
    pub(super) fn read(&mut self, path: &Path, image: &mut GrayImage) -> Result<(), NoImage> {
        self.file.clear();
        let file = open_regular(path).map_err(|e| match e.kind() {
            ErrorKind::NotFound => NoImage::Missing,
            _ => NoImage::Corrupt,
        })?;
        file.take(MAX_FILE_BYTES).read_to_end(&mut self.file).map_err(|_| NoImage::Corrupt)?;
        decode_png(&self.file, &mut self.channels, image).ok_or_else(|| {
            let expected = (image.width(), image.height());
            let size = header_size(Cursor::new(&self.file[..])).filter(|size| *size != expected);
            size.map_or(NoImage::Corrupt, NoImage::OtherSize)
        })
    }
}

/// Reads a single PNG image of any size whose sides are within `sides_px`, as grey.
///
/// # Errors
/// When the file cannot be read, is no PNG or a damaged one, or has another size.
pub fn read_gray_png(path: &Path, sides_px: RangeInclusive<usize>) -> Result<GrayImage, DriverError> {
    if path.is_dir() {
        return Err(DriverError::missing(path, "is a directory; name a PNG image"));
    }
    let file = open_regular(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => DriverError::missing(path, "does not exist; name a PNG image"),
        _ => DriverError::io(path, e),
    })?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES).read_to_end(&mut bytes).map_err(|e| DriverError::io(path, e))?;
    gray_png(path, &bytes, sides_px)
}

/// Reads the PNG image in `bytes`; `path` names it in messages.
pub(crate) fn gray_png(
    path: &Path,
    bytes: &[u8],
    sides_px: RangeInclusive<usize>,
) -> Result<GrayImage, DriverError> {
    let malformed = |message: &str| DriverError::malformed(path, message);
    let (width, height) = header_size(Cursor::new(bytes)).ok_or_else(|| {
        malformed("is not a PNG image; convert it to PNG first (8 or 16 bits, grey or colour)")
    })?;
    if !(sides_px.contains(&width) && sides_px.contains(&height)) {
        let (least, most) = (sides_px.start(), sides_px.end());
        let message = format!(
            "is {width}x{height} px; scale or crop it to sides of {least} to {most} px, which is what is read"
        );
        return Err(malformed(&message));
    }
    let mut image = GrayImage::new(width, height);
    decode_png(bytes, &mut Vec::new(), &mut image)
        .ok_or_else(|| malformed("is cut off or damaged; copy or write it again"))?;
    Ok(image)
}

/// Decodes the PNG image in `file` into `image`, whose size it must have; `channels` is used again for each.
pub(crate) fn decode_png(file: &[u8], channels: &mut Vec<u8>, image: &mut GrayImage) -> Option<()> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(file), Limits { bytes: MAX_DECODER_BYTES });
    decoder.set_transformations(Transformations::normalize_to_color8());
    let size = decoder.read_header_info().ok()?.size();
    if (size.0 as usize, size.1 as usize) != (image.width(), image.height()) {
        return None;
    }
    let mut reader = decoder.read_info().ok()?;
    if !reader.info().palette.as_deref().is_none_or(is_palette) {
        return None;
    }
    let step = match reader.output_color_type().0 {
        ColorType::Grayscale => return reader.next_frame(image.pixels_mut()).ok().map(drop),
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return None,
    };
    channels.resize(reader.output_buffer_size()?, 0);
    reader.next_frame(channels).ok()?;
    for (grey, pixel) in image.pixels_mut().iter_mut().zip(channels.chunks_exact(step)) {
        *grey = if step == 2 { pixel[0] } else { luma(pixel[0], pixel[1], pixel[2]) };
    }
    Some(())
}

/// Whether a palette is of whole entries and no more than an index can tell: png 0.18.1 takes both for granted, and
/// panics.
fn is_palette(bytes: &[u8]) -> bool {
    bytes.len().is_multiple_of(3) && bytes.len() <= 3 * 256
}

/// Luma of ITU-R BT.601 in eighths of a bit: weights 77, 150, 29 of 256.
pub(crate) fn luma(red: u8, green: u8, blue: u8) -> u8 {
    let sum = 77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue) + 128;
    (sum >> 8) as u8
}

/// Width and height by the header of a PNG file; `None` when it is none.
pub(super) fn png_size(path: &Path) -> Option<(usize, usize)> {
    header_size(BufReader::new(open_regular(path).ok()?))
}

/// Width and height of a PNG file in memory; `None` if it is not a PNG.
pub(crate) fn png_size_of(bytes: &[u8]) -> Option<(usize, usize)> {
    header_size(Cursor::new(bytes))
}

fn header_size(file: impl BufRead + Seek) -> Option<(usize, usize)> {
    let mut decoder = Decoder::new(file);
    let (width, height) = decoder.read_header_info().ok()?.size();
    Some((width as usize, height as usize))
}

#[cfg(test)]
mod tests {
    use super::*;
    use png::{BitDepth, Encoder};

    fn encode(color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, 4, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        file
    }

    fn decoded(file: &[u8]) -> Option<Vec<u8>> {
        let mut image = GrayImage::new(4, 2);
        decode_png(file, &mut Vec::new(), &mut image).map(|()| image.pixels().to_vec())
    }

    #[test]
    fn every_colour_type_comes_out_grey() {
        let grey: Vec<u8> = (0..8).map(|i| i * 30).collect();
        let wide: Vec<u8> = grey.iter().flat_map(|&g| [g, 77]).collect();
        let rgb: Vec<u8> = grey.iter().flat_map(|&g| [g; 3]).collect();
        let rgba: Vec<u8> = grey.iter().flat_map(|&g| [g, g, g, 9]).collect();
        assert_eq!(decoded(&encode(ColorType::Grayscale, BitDepth::Eight, &grey)), Some(grey.clone()));
        assert_eq!(decoded(&encode(ColorType::Grayscale, BitDepth::Sixteen, &wide)), Some(grey.clone()));
        assert_eq!(decoded(&encode(ColorType::GrayscaleAlpha, BitDepth::Eight, &wide)), Some(grey.clone()));
        assert_eq!(decoded(&encode(ColorType::Rgb, BitDepth::Eight, &rgb)), Some(grey.clone()));
        assert_eq!(decoded(&encode(ColorType::Rgba, BitDepth::Eight, &rgba)), Some(grey));
        assert_eq!((luma(255, 255, 255), luma(255, 0, 0), luma(0, 0, 255)), (255, 77, 29));
    }

    #[test]
    fn a_single_image_is_read_or_refused_with_the_cure() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        let file = encode(ColorType::Grayscale, BitDepth::Eight, &[7; 8]);
        let refusal = |bytes: &[u8], sides| {
            std::fs::write(&path, bytes).unwrap();
            read_gray_png(&path, sides).unwrap_err().to_string()
        };
        assert!(refusal(&file, 3..=9).contains("is 4x2 px"));
        assert!(refusal(&file[..file.len() - 24], 1..=9).contains("cut off"));
        assert!(refusal(b"P5 4 2 255", 1..=9).contains("not a PNG"));
        std::fs::write(&path, &file).unwrap();
        assert_eq!(read_gray_png(&path, 1..=9).unwrap().pixels(), [7; 8]);
        let missing = read_gray_png(&folder.path().join("none.png"), 1..=9).unwrap_err().to_string();
        assert!(missing.contains("none.png") && missing.contains("does not exist"), "{missing}");
        assert!(read_gray_png(folder.path(), 1..=9).unwrap_err().to_string().contains("is a directory"));
    }

    #[test]
    fn a_file_cut_anywhere_or_bent_is_corrupt_never_a_panic() {
        let data: Vec<u8> = (0..8).collect();
        let file = encode(ColorType::Grayscale, BitDepth::Eight, &data);
        let end_of_data = file.len() - 16; // The closing chunk says nothing about pixels.
        for length in 0..end_of_data {
            assert_eq!(decoded(&file[..length]), None, "{length} bytes");
        }
        for at in 0..file.len() {
            let mut bent = file.clone();
            bent[at] ^= 0x55;
            let _ = decoded(&bent);
        }
    }

    #[test]
    fn a_palette_of_half_an_entry_or_of_too_many_is_refused() {
        let with_palette = |bytes: usize| {
            let mut file = Vec::new();
            let mut encoder = Encoder::new(&mut file, 4, 2);
            encoder.set_color(ColorType::Indexed);
            encoder.set_palette(vec![9; bytes]);
            encoder.write_header().unwrap().write_image_data(&[0; 8]).unwrap();
            decoded(&file)
        };
        assert_eq!(with_palette(6), Some(vec![9; 8]));
        for bytes in [5, 8, 3 * 257] {
            assert_eq!(with_palette(bytes), None, "{bytes} bytes");
        }
    }

    #[test]
    fn another_size_is_refused_before_decoding() {
        let file = encode(ColorType::Grayscale, BitDepth::Eight, &[0; 8]);
        assert_eq!(decode_png(&file, &mut Vec::new(), &mut GrayImage::new(2, 4)), None);
    }
}
