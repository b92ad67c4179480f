//! Grey pixels of the images in ROS messages.

use super::messages::ImageMessage;
use crate::euroc::depth::Depth;
use crate::euroc::image::{luma, png_largest};
use crate::euroc::picture::{PictureDecoder, picture_size};
use plumbline_config::GrayImage;

/// Longest side of an image, px.
pub(crate) const MAX_SIDE_PX: usize = 8192;

/// Conversion of a raw pixel to grey.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pixel {
    /// One byte.
    Grey,
    /// Two bytes, of which all bits are in use or the lower ones.
    Grey16,
    /// Bytes in a pixel, and where red, green and blue stand in it.
    Colour { bytes: usize, red: usize, green: usize, blue: usize },
    /// One of two bytes: the luma of interleaved YUV.
    Luma { at: usize },
}

impl Pixel {
    fn of(encoding: &str) -> Option<Self> {
        let colour = |bytes, red, green, blue| Some(Self::Colour { bytes, red, green, blue });
        match encoding {
            "mono8" | "8UC1" => Some(Self::Grey),
            "mono16" | "16UC1" => Some(Self::Grey16),
            "rgb8" => colour(3, 0, 1, 2),
            "bgr8" | "8UC3" => colour(3, 2, 1, 0),
            "rgba8" => colour(4, 0, 1, 2),
            "bgra8" | "8UC4" => colour(4, 2, 1, 0),
            "yuv422" | "uyvy" => Some(Self::Luma { at: 1 }),
            "yuv422_yuy2" | "yuyv" => Some(Self::Luma { at: 0 }),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Grey16 | Self::Luma { .. } => 2,
            Self::Colour { bytes, .. } => bytes,
        }
    }
}

/// Encodings of raw images that can be read, for messages.
pub(crate) const ENCODINGS: &str =
    "mono8, mono16, rgb8, bgr8, rgba8, bgra8, 8UC1, 8UC3, 8UC4, 16UC1, yuv422, yuv422_yuy2";

/// True if raw images of that encoding can be read.
pub(crate) fn is_known(encoding: &str) -> bool {
    Pixel::of(encoding).is_some()
}

/// Width and height, px; `None` for what is no image.
pub(crate) fn size_px(message: &ImageMessage<'_>) -> Option<(usize, usize)> {
    let size = match message {
        ImageMessage::Raw { width, height, .. } => Some((*width, *height)),
        ImageMessage::File(file) => picture_size(file),
    };
    size.filter(|(width, height)| [width, height].iter().all(|side| (1..=MAX_SIDE_PX).contains(*side)))
}

/// Largest value of an image of 16 bits; `None` for other images. Finding it takes a file as long as decoding it.
pub(crate) fn largest_value(message: &ImageMessage<'_>) -> Option<u16> {
    match *message {
        ImageMessage::File(file) => png_largest(file),
        ImageMessage::Raw { width, encoding, is_big, step, data, .. } => {
            (Pixel::of(encoding)? == Pixel::Grey16 && step > 0).then_some(())?;
            let row_bytes = width.checked_mul(2)?.min(step);
            let is_big = true_order(is_big, data, step, row_bytes);
            let values = data.chunks(step).flat_map(|row| row[..row_bytes.min(row.len())].chunks_exact(2));
            values.map(|two| value(is_big, two)).max()
        }
    }
}

/// Every so many rows one is looked at for the order of the bytes.
const ORDER_ROWS: usize = 16;
/// The upper bytes of neighbours differ less than the lower ones; an order is wrong if they differ so many times as much.
const ROUGHER: u64 = 2;
/// Fewest neighbours that are judged.
const MIN_NEIGHBOURS: u64 = 100;

/// Order of the bytes of pixels of two: as the message says, unless the bytes that would be the upper ones differ from pixel to
/// pixel as only lower ones do. Some drivers say the order of another computer.
fn true_order(is_big: bool, data: &[u8], step: usize, row_bytes: usize) -> bool {
    let (mut differences, mut neighbours) = ([0_u64; 2], 0_u64);
    for row in data.chunks(step.max(1)).step_by(ORDER_ROWS) {
        let row = &row[..row_bytes.min(row.len())];
        for pair in row.chunks_exact(2).zip(row.chunks_exact(2).skip(1)) {
            neighbours += 1;
            for (sum, (a, b)) in differences.iter_mut().zip(pair.0.iter().zip(pair.1)) {
                *sum += u64::from(a.abs_diff(*b));
            }
        }
    }
    let [upper, lower] = if is_big { differences } else { [differences[1], differences[0]] };
    // Where one of both says nothing, as of 8 bits in 16, neither does the comparison.
    is_big ^ (neighbours >= MIN_NEIGHBOURS && lower > 0 && upper > ROUGHER * lower)
}

fn value(is_big: bool, two: &[u8]) -> u16 {
    let two = [two[0], two[1]];
    if is_big { u16::from_be_bytes(two) } else { u16::from_le_bytes(two) }
}

/// Buffers that are used again for each image.
#[derive(Debug, Default)]
pub(crate) struct ImageDecoder(PictureDecoder);

impl ImageDecoder {
    /// For images of which, where they have 16 bits, these are in use.
    pub(crate) fn new(depth: Depth) -> Self {
        Self(PictureDecoder::new(depth))
    }

    /// Writes the image of `message` into `image`, whose size it must have. Colour is weighed to grey (ITU-R BT.601), of 16
    /// bits the upper 8 of those in use are kept. `None` where it is damaged, or of another kind or size.
    pub(crate) fn decode(&mut self, message: &ImageMessage<'_>, image: &mut GrayImage) -> Option<()> {
        match *message {
            ImageMessage::Raw { width, height, encoding, is_big, step, data } => {
                if (width, height) != (image.width(), image.height()) {
                    return None;
                }
                raw(Pixel::of(encoding)?, is_big, step, data, self.0.depth(), image)
            }
            ImageMessage::File(file) => self.0.decode(file, image),
        }
    }
}

fn raw(
    pixel: Pixel,
    is_big: bool,
    step: usize,
    data: &[u8],
    depth: Depth,
    image: &mut GrayImage,
) -> Option<()> {
    let (width, height) = (image.width(), image.height());
    let row_bytes = width.checked_mul(pixel.bytes())?;
    if step < row_bytes || width == 0 {
        return None;
    }
    let is_big = if pixel == Pixel::Grey16 { true_order(is_big, data, step, row_bytes) } else { is_big };
    let mut rows = data.chunks(step);
    for to in image.pixels_mut().chunks_exact_mut(width).take(height) {
        // The last row may end where its pixels do.
        let from = rows.next()?.get(..row_bytes)?;
        match pixel {
            Pixel::Grey => to.copy_from_slice(from),
            Pixel::Grey16 => {
                let grey = |two: &[u8]| depth.grey(value(is_big, two));
                to.iter_mut().zip(from.chunks_exact(2)).for_each(|(to, two)| *to = grey(two));
            }
            Pixel::Luma { at } => to.iter_mut().zip(from.chunks_exact(2)).for_each(|(to, two)| *to = two[at]),
            Pixel::Colour { bytes, red, green, blue } => {
                let grey = |p: &[u8]| luma(p[red], p[green], p[blue]);
                to.iter_mut().zip(from.chunks_exact(bytes)).for_each(|(to, p)| *to = grey(p));
            }
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drivers of little-endian computers that say big-endian, and the other way round.
    #[test]
    fn bytes_in_the_order_of_another_computer_are_read_as_they_are() {
        const WIDTH: usize = 64;
        for shift in [0, 2, 4] {
            // A slope with noise, of 12, 14 and 16 bits.
            let values: Vec<u16> = (0..WIDTH * 32)
                .map(|i| ((40 * (i % WIDTH) + 7 * (i / WIDTH) + i * 37 % 61) as u16) << shift)
                .collect();
            for is_big in [false, true] {
                let bytes = |value: &u16| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
                let data: Vec<u8> = values.iter().flat_map(bytes).collect();
                for said in [false, true] {
                    let found = true_order(said, &data, 2 * WIDTH, 2 * WIDTH);
                    assert_eq!(found, is_big, "{shift} {said}");
                }
            }
        }
        // Eight bits in the upper or the lower byte: as it is said.
        let eight: Vec<u8> = (0..WIDTH * 32).flat_map(|i| [(i * 31 % 200) as u8, 0]).collect();
        for said in [false, true] {
            assert_eq!(true_order(said, &eight, 2 * WIDTH, 2 * WIDTH), said);
        }
    }

    fn decoded(encoding: &str, is_big: bool, step: usize, data: &[u8]) -> Option<Vec<u8>> {
        let mut image = GrayImage::new(2, 2);
        let message = ImageMessage::Raw { width: 2, height: 2, encoding, is_big, step, data };
        ImageDecoder::default().decode(&message, &mut image).map(|()| image.pixels().to_vec())
    }

    #[test]
    fn every_encoding_comes_out_grey() {
        let grey = Some(vec![10, 20, 30, 40]);
        assert_eq!(decoded("mono8", false, 2, &[10, 20, 30, 40]), grey);
        assert_eq!(decoded("8UC1", false, 3, &[10, 20, 0, 30, 40]), grey, "rows further apart");
        assert_eq!(decoded("mono16", false, 4, &[9, 10, 9, 20, 9, 30, 9, 40]), grey);
        assert_eq!(decoded("16UC1", true, 4, &[10, 9, 20, 9, 30, 9, 40, 9]), grey);
        assert_eq!(decoded("yuv422", false, 4, &[1, 10, 1, 20, 1, 30, 1, 40]), grey);
        assert_eq!(decoded("yuv422_yuy2", false, 4, &[10, 1, 20, 1, 30, 1, 40, 1]), grey);
        let rgb = [255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 9, 9];
        assert_eq!(decoded("rgb8", false, 6, &rgb), Some(vec![77, 149, 29, 9]));
        assert_eq!(decoded("bgr8", false, 6, &rgb), Some(vec![29, 149, 77, 9]));
        let rgba: Vec<u8> = rgb.chunks(3).flat_map(|p| [p[0], p[1], p[2], 200]).collect();
        assert_eq!(decoded("rgba8", false, 8, &rgba), decoded("rgb8", false, 6, &rgb));
        assert_eq!(decoded("bgra8", false, 8, &rgba), decoded("bgr8", false, 6, &rgb));
    }

    #[test]
    fn what_is_too_short_too_narrow_or_unknown_is_no_image() {
        assert_eq!(decoded("mono8", false, 2, &[10, 20, 30]), None);
        assert_eq!(decoded("mono8", false, 1, &[10, 20, 30, 40]), None);
        assert_eq!(decoded("bayer_rggb8", false, 2, &[10, 20, 30, 40]), None);
        assert_eq!(decoded("mono8", false, 0, &[]), None);
    }

    #[test]
    fn files_are_told_apart_by_how_they_begin() {
        let pixels: Vec<u8> = (0..64 * 48).map(|k| (k % 251) as u8).collect();
        let mut png = Vec::new();
        let mut encoder = png::Encoder::new(&mut png, 64, 48);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        let mut jpeg = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 100);
        encoder.encode(&pixels, 64, 48, jpeg_encoder::ColorType::Luma).unwrap();
        let mut decoder = ImageDecoder::default();
        for (file, tolerance) in [(&png, 0), (&jpeg, 6)] {
            let message = ImageMessage::File(file);
            assert_eq!(size_px(&message), Some((64, 48)));
            let mut image = GrayImage::new(64, 48);
            decoder.decode(&message, &mut image).unwrap();
            assert!(image.pixels().iter().zip(&pixels).all(|(a, b)| a.abs_diff(*b) <= tolerance));
            assert_eq!(decoder.decode(&message, &mut GrayImage::new(48, 64)), None, "another size");
        }
        assert_eq!(size_px(&ImageMessage::File(b"GIF89a")), None);
    }
}
