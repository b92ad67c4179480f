//! Grey pixels from the files of a data set.
//!
//! The decoder of PNG is `png` of the image-rs project: 1.5 ms for a 752x480 grey EuRoC image on one core of
//! the development host, where `zune-png` 0.5 took 2.8 ms.

use super::depth::Depth;
use crate::{DriverError, open_regular};
use plumbline_config::GrayImage;
use png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};
use std::io::{self, BufRead, Cursor, ErrorKind, Read, Seek};
use std::ops::RangeInclusive;
use std::path::Path;

/// Largest file that is read; a 16-bit RGB image of 4096x4096 fits.
pub(super) const MAX_FILE_BYTES: u64 = 128 << 20;
/// Memory limit of the decoder, bytes.
const MAX_DECODER_BYTES: usize = 64 << 20;
/// Longest side of an image whose values are looked at, px.
const MAX_LOOKED_AT_PX: usize = 8192;

/// The first bytes of the file at `path`, at most this many.
pub(super) fn read_start(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_regular(path)?.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a single PNG image of any size whose sides are within `sides_px`, as grey.
///
/// # Errors
/// When the file cannot be read, is no PNG or a damaged one, or has another size.
pub fn read_gray_png(path: &Path, sides_px: RangeInclusive<usize>) -> Result<GrayImage, DriverError> {
    if path.is_dir() {
        return Err(DriverError::refused(path, "is a directory; name a PNG image"));
    }
    let file = open_regular(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => DriverError::refused(path, "does not exist; name a PNG image"),
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
    let malformed = |message: &str| DriverError::refused(path, message);
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
    let depth = png_largest(bytes).map_or(Depth::FULL, Depth::of_largest);
    decode_png(bytes, depth, &mut Vec::new(), &mut image)
        .ok_or_else(|| malformed("is cut off or damaged; copy or write it again"))?;
    Ok(image)
}

/// Decodes the PNG image in `file` into `image`, whose size it must have; `channels` is used again for each. Of 16 bits those in
/// use are `depth`.
pub(crate) fn decode_png(
    file: &[u8],
    depth: Depth,
    channels: &mut Vec<u8>,
    image: &mut GrayImage,
) -> Option<()> {
    let mut reader = opened(file, (image.width(), image.height()), depth)?;
    let (colour, bits) = reader.output_color_type();
    let step = match colour {
        ColorType::Grayscale if bits == BitDepth::Eight => {
            return reader.next_frame(image.pixels_mut()).ok().map(drop);
        }
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return None,
    };
    channels.resize(reader.output_buffer_size()?, 0);
    reader.next_frame(channels).ok()?;
    if bits == BitDepth::Sixteen {
        // Every sample becomes a byte, in its place.
        let samples = image.width() * image.height() * step;
        for k in 0..samples {
            channels[k] = depth.grey(u16::from_be_bytes([channels[2 * k], channels[2 * k + 1]]));
        }
    }
    for (grey, pixel) in image.pixels_mut().iter_mut().zip(channels.chunks_exact(step)) {
        *grey = if step < 3 { pixel[0] } else { luma(pixel[0], pixel[1], pixel[2]) };
    }
    Some(())
}

type PngReader<'a> = Reader<Cursor<&'a [u8]>>;

/// A PNG image of the size `expected`, as grey or colour; of 16 bits where only some of those are in use.
fn opened(file: &[u8], expected: (usize, usize), depth: Depth) -> Option<PngReader<'_>> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(file), Limits { bytes: MAX_DECODER_BYTES });
    let transformations = match depth == Depth::FULL {
        true => Transformations::normalize_to_color8(),
        false => Transformations::EXPAND,
    };
    decoder.set_transformations(transformations);
    let size = decoder.read_header_info().ok()?.size();
    if (size.0 as usize, size.1 as usize) != expected {
        return None;
    }
    let reader = decoder.read_info().ok()?;
    reader.info().palette.as_deref().is_none_or(is_palette).then_some(reader)
}

/// Largest value of a PNG image of 16 bits, alpha left out; `None` for other images and damaged ones.
pub(crate) fn png_largest(file: &[u8]) -> Option<u16> {
    let (width, height) = png_size_of(file)?;
    let mut decoder = Decoder::new_with_limits(Cursor::new(file), Limits { bytes: MAX_DECODER_BYTES });
    let is_wide = decoder.read_header_info().ok()?.bit_depth == BitDepth::Sixteen;
    if !is_wide || width.max(height) > MAX_LOOKED_AT_PX {
        return None;
    }
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().ok()?;
    let (step, colours) = match reader.output_color_type().0 {
        ColorType::Grayscale => (2, 2),
        ColorType::GrayscaleAlpha => (4, 2),
        ColorType::Rgb => (6, 6),
        ColorType::Rgba => (8, 6),
        ColorType::Indexed => return None,
    };
    let mut samples = vec![0; reader.output_buffer_size()?];
    reader.next_frame(&mut samples).ok()?;
    let values = samples.chunks_exact(step).flat_map(|pixel| pixel[..colours].chunks_exact(2));
    values.map(|two| u16::from_be_bytes([two[0], two[1]])).max()
}

/// True if a palette has whole entries and no more than an index can address. png 0.18.1 assumes both, and
/// panics otherwise.
fn is_palette(bytes: &[u8]) -> bool {
    bytes.len().is_multiple_of(3) && bytes.len() <= 3 * 256
}

/// Luma of ITU-R BT.601 in eighths of a bit: weights 77, 150, 29 of 256.
pub(crate) fn luma(red: u8, green: u8, blue: u8) -> u8 {
    let sum = 77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue) + 128;
    (sum >> 8) as u8
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
        decode_png(file, Depth::FULL, &mut Vec::new(), &mut image).map(|()| image.pixels().to_vec())
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
    fn twelve_bits_in_sixteen_keep_their_upper_eight() {
        let values: [u16; 8] = [0, 16, 255, 1024, 2048, 4095, 4000, 100];
        let wide =
            |step: usize| values.iter().flat_map(|v| v.to_be_bytes().repeat(step)).collect::<Vec<u8>>();
        let expected = values.map(|value| (value >> 4) as u8).to_vec();
        for (colour, step) in [(ColorType::Grayscale, 1), (ColorType::Rgb, 3), (ColorType::Rgba, 4)] {
            let file = encode(colour, BitDepth::Sixteen, &wide(step));
            assert_eq!(png_largest(&file), Some(4095));
            let mut image = GrayImage::new(4, 2);
            decode_png(&file, Depth::of_largest(4095), &mut Vec::new(), &mut image).unwrap();
            assert_eq!(image.pixels(), expected, "{colour:?}");
            assert_eq!(gray_png(Path::new("a"), &file, 1..=9).unwrap().pixels(), expected);
            assert_eq!(png_largest(&file[..file.len() - 24]), None);
        }
        assert_eq!(png_largest(&encode(ColorType::Grayscale, BitDepth::Eight, &[9; 8])), None);
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
        assert_eq!(decode_png(&file, Depth::FULL, &mut Vec::new(), &mut GrayImage::new(2, 4)), None);
    }
}
