//! Camera pictures for people: the left image with what is tracked in it, reduced and compressed.

use super::now_ns;
use jpeg_encoder::{ColorType, Encoder};
use plumbline_config::GrayImage;
use plumbline_record::local::picture::Shot;
use plumbline_record::messages::{Envelope, Picture};
use plumbline_record::protobuf::encode;

/// Message of a picture in its envelope: at most `max_width_px` wide, compressed with `quality` (1 to 100). `None` without image.
pub fn message(shot: &Shot, max_width_px: usize, quality: u8, sequence: u64) -> Option<Vec<u8>> {
    let factor = shot.image.width().div_ceil(max_width_px.max(1)).max(1);
    let (width, height) = (shot.image.width() / factor, shot.image.height() / factor);
    if !shot.has_image || width == 0 || height == 0 {
        return None;
    }
    let (columns, rows) = (u16::try_from(width).ok()?, u16::try_from(height).ok()?);
    let mut jpeg = Vec::new();
    let pixels = reduced(&shot.image, factor);
    Encoder::new(&mut jpeg, quality.clamp(1, 100)).encode(&pixels, columns, rows, ColorType::Luma).ok()?;
    let place = |x: f32| place(x, factor);
    let message = Picture {
        frame: shot.frame,
        stamp_ns: shot.stamp,
        width_px: u32::from(columns),
        height_px: u32::from(rows),
        pixels: Vec::new(),
        points: shot.points.iter().map(|[x, y, age]| [place(*x), place(*y), *age]).collect(),
        lines: shot.lines.iter().map(|line| line.map(place)).collect(),
        jpeg,
    };
    Some(encode(&Envelope::around(&message, encode(&message), sequence, now_ns())))
}

/// Coordinate in an image reduced by `factor`. The centre of pixel 0 is at 0: the reduced one's lies in the middle of its
/// block.
fn place(x: f32, factor: usize) -> f32 {
    (x + 0.5) / factor as f32 - 0.5
}

/// Means of blocks of `factor` x `factor` pixels; what is left over at the right and at the bottom is cut.
fn reduced(image: &GrayImage, factor: usize) -> Vec<u8> {
    let (width, height) = (image.width() / factor, image.height() / factor);
    let area = (factor * factor) as u32;
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let rows = (y * factor..(y + 1) * factor).map(|row| {
                let start = row * image.width() + x * factor;
                image.pixels()[start..start + factor].iter().map(|p| u32::from(*p)).sum::<u32>()
            });
            pixels.push(((rows.sum::<u32>() + area / 2) / area) as u8);
        }
    }
    pixels
}

/// Width and height that a JPEG image says it has, px (T.81, Annex B); `None` when it does not begin as one.
pub fn jpeg_size(jpeg: &[u8]) -> Option<(u32, u32)> {
    /// Markers of frames are C0 to CF without tables and the like.
    const FRAMES: std::ops::RangeInclusive<u8> = 0xc0..=0xcf;
    const NO_FRAMES: [u8; 3] = [0xc4, 0xc8, 0xcc];
    let mut rest = jpeg.strip_prefix(&[0xff, 0xd8])?;
    loop {
        let marker = match rest {
            [0xff, 0xff, ..] => {
                rest = &rest[1..];
                continue;
            }
            [0xff, marker, ..] => *marker,
            _ => return None,
        };
        let segment = &rest[2..];
        let length = usize::from(u16::from_be_bytes(*segment.first_chunk()?));
        if FRAMES.contains(&marker) && !NO_FRAMES.contains(&marker) {
            let side = |at: usize| Some(u32::from(u16::from_be_bytes(*segment.get(at..)?.first_chunk()?)));
            return side(5).zip(side(3));
        }
        // A length counts itself.
        rest = segment.get(length.max(2)..)?;
    }
}

#[cfg(test)]
mod tests {
    use super::super::read::{self, Heard};
    use super::*;
    use plumbline_config::Timestamp;

    fn shot() -> Shot {
        let (width, height) = (752, 480);
        let pixels = (0..width * height).map(|k| (k % width * 255 / width) as u8).collect();
        Shot {
            frame: 3,
            stamp: Timestamp::default(),
            image: GrayImage::from_pixels(width, height, pixels).unwrap(),
            has_image: true,
            points: vec![[101.5, 201.5, 7.0]],
            lines: Vec::new(),
        }
    }

    #[test]
    fn a_jpeg_image_tells_its_size_or_nothing() {
        let mut jpeg = Vec::new();
        Encoder::new(&mut jpeg, 50).encode(&[7; 64 * 48], 64, 48, ColorType::Luma).unwrap();
        assert_eq!(jpeg_size(&jpeg), Some((64, 48)));
        for length in 0..24 {
            assert_eq!(jpeg_size(&jpeg[..length]), None, "{length}");
        }
        assert_eq!(jpeg_size(b"\xff\xd8\xff\xe0\0\0\xff\xe0\0\0"), None);
        assert_eq!(jpeg_size(b"no image at all"), None);
    }

    #[test]
    fn a_picture_that_is_larger_than_it_says_is_refused() {
        let mut jpeg = Vec::new();
        Encoder::new(&mut jpeg, 50).encode(&[7; 64 * 48], 64, 48, ColorType::Luma).unwrap();
        let decoded = |jpeg: &[u8]| {
            let message = Picture { width_px: 64, height_px: 48, jpeg: jpeg.to_vec(), ..Picture::default() };
            read::picture(&encode(&Envelope::around(&message, encode(&message), 1, 1)))
        };
        assert!(decoded(&jpeg).is_some());
        // The same bytes, whose header claims 16000 x 16000.
        let at = jpeg.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        jpeg[at + 5..at + 9].copy_from_slice(&[0x3e, 0x80, 0x3e, 0x80]);
        assert_eq!(jpeg_size(&jpeg), Some((16_000, 16_000)));
        assert!(decoded(&jpeg).is_none());
    }

    #[test]
    fn a_picture_is_reduced_and_its_points_with_it() {
        let Heard { envelope, message } = read::picture(&message(&shot(), 376, 70, 3).unwrap()).unwrap();
        assert_eq!((message.width_px, message.height_px, envelope.sequence), (376, 240, 3));
        assert_eq!(message.points, [[50.5, 100.5, 7.0]]);
        assert!(message.jpeg.len() < 20_000);
    }

    #[test]
    fn without_an_image_there_is_no_picture() {
        assert!(message(&Shot { has_image: false, ..shot() }, 376, 70, 0).is_none());
        let empty = Shot { image: GrayImage::new(0, 0), ..shot() };
        assert!(message(&empty, 376, 70, 0).is_none());
    }

    #[test]
    fn blocks_are_averaged() {
        let mut image = GrayImage::new(5, 2);
        image.pixels_mut().copy_from_slice(&[0, 10, 20, 30, 99, 10, 20, 30, 40, 99]);
        assert_eq!(reduced(&image, 2), [10, 30]);
    }
}
