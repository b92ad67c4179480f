//! Images in a log: plain or compressed without loss, and the hash of their pixels.

use plumbline_config::options::ImageRecording;
use plumbline_config::{GrayImage, Timestamp};
use plumbline_drivers::StereoFrame;
use plumbline_record::parts::{FrameAbout, ImageAbout};
use plumbline_scene::messages::{CompressedImage, RawImage};
use plumbline_scene::timestamp;
use prost::Message as _;
use sha2::{Digest as _, Sha256};
use std::io::Cursor;

/// Sides of an image that is read, px: what the configuration admits.
const MAX_SIDE_PX: u32 = 4096;
/// Memory limit of the decoder of a compressed image, bytes.
const MAX_DECODER_BYTES: usize = 64 << 20;

/// SHA-256 of the pixels.
pub fn hash(image: &GrayImage) -> Vec<u8> {
    Sha256::digest(image.pixels()).to_vec()
}

/// A frame with the hashes of its images.
pub fn frame(frame: &StereoFrame) -> FrameAbout {
    let image = |camera: usize| {
        let image = &frame.images[camera];
        frame.valid[camera].then(|| ImageAbout {
            width_px: image.width() as u32,
            height_px: image.height() as u32,
            sha256: hash(image),
        })
    };
    FrameAbout { sequence: frame.sequence, stamp: frame.stamp, left: image(0), right: image(1) }
}

/// Appends the message of an image to `out`; nothing where images are not kept.
///
/// # Errors
/// When the image has no pixels, which no camera delivers.
pub fn encode(
    image: &GrayImage,
    stamp: Timestamp,
    frame_id: &str,
    images: ImageRecording,
    out: &mut Vec<u8>,
) -> Result<(), png::EncodingError> {
    let (timestamp, frame_id) = (timestamp(stamp), frame_id.to_owned());
    match images {
        ImageRecording::None => {}
        ImageRecording::Png => {
            let data = compress(image)?;
            let message = CompressedImage { timestamp, frame_id, data: data.into(), format: "png".into() };
            out.extend(message.encode_to_vec());
        }
        ImageRecording::Raw => {
            let message = RawImage {
                timestamp,
                frame_id,
                width: image.width() as u32,
                height: image.height() as u32,
                encoding: "mono8".into(),
                step: image.width() as u32,
                data: image.pixels().to_vec().into(),
            };
            out.extend(message.encode_to_vec());
        }
    }
    Ok(())
}

fn compress(image: &GrayImage) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::with_capacity(image.pixels().len());
    let mut encoder = png::Encoder::new(&mut bytes, image.width() as u32, image.height() as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fastest);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.pixels())?;
    writer.finish()?;
    Ok(bytes)
}

/// Reads the image of a message into `image`, and holds it against its description.
///
/// # Errors
/// When it is not the image that was recorded: what is wrong, in words.
pub fn decode(
    message: &[u8],
    images: ImageRecording,
    description: &ImageAbout,
    image: &mut GrayImage,
) -> Result<(), &'static str> {
    let (width_px, height_px) = (description.width_px, description.height_px);
    if !(1..=MAX_SIDE_PX).contains(&width_px) || !(1..=MAX_SIDE_PX).contains(&height_px) {
        return Err("an image of impossible size");
    }
    let size = (width_px as usize, height_px as usize);
    if (image.width(), image.height()) != size {
        *image = GrayImage::new(size.0, size.1);
    }
    match images {
        ImageRecording::None => return Err("an image in a log that says it has none"),
        ImageRecording::Png => {
            let message = CompressedImage::decode(message).map_err(|_| "not a message of its schema")?;
            decompress(&message.data, image).ok_or("an image that does not decompress")?;
        }
        ImageRecording::Raw => {
            let message = RawImage::decode(message).map_err(|_| "not a message of its schema")?;
            if message.data.len() != image.pixels().len() {
                return Err("an image with too few or too many pixels");
            }
            image.pixels_mut().copy_from_slice(&message.data);
        }
    }
    check(image, description)
}

/// Checks that `image` is the one described.
///
/// # Errors
/// When it is another: what is wrong, in words.
pub fn check(image: &GrayImage, description: &ImageAbout) -> Result<(), &'static str> {
    let size = (image.width() as u64, image.height() as u64);
    if size != (u64::from(description.width_px), u64::from(description.height_px)) {
        return Err("an image of another size than its frame says");
    }
    if hash(image) == description.sha256 {
        Ok(())
    } else {
        Err("an image whose pixels do not have their hash")
    }
}

fn decompress(file: &[u8], image: &mut GrayImage) -> Option<()> {
    let limits = png::Limits { bytes: MAX_DECODER_BYTES };
    let mut reader = png::Decoder::new_with_limits(Cursor::new(file), limits).read_info().ok()?;
    let fits = reader.output_color_type() == (png::ColorType::Grayscale, png::BitDepth::Eight)
        && reader.output_buffer_size() == Some(image.pixels().len())
        && reader.info().width as usize == image.width();
    if !fits {
        return None;
    }
    reader.next_frame(image.pixels_mut()).ok()?;
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> GrayImage {
        let pixels = (0..64u32 * 48).map(|k| ((k * k) >> 5) as u8).collect();
        GrayImage::from_pixels(64, 48, pixels).unwrap()
    }

    fn described(image: &GrayImage) -> ImageAbout {
        ImageAbout { width_px: 64, height_px: 48, sha256: hash(image) }
    }

    #[test]
    fn another_image_is_refused() {
        let (image, mut bytes) = (picture(), Vec::new());
        encode(&image, Timestamp::default(), "left", ImageRecording::Raw, &mut bytes).unwrap();
        // Pixels are all of the message but its ends.
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        let refused =
            decode(&bytes, ImageRecording::Raw, &described(&image), &mut GrayImage::default()).unwrap_err();
        assert!(refused.contains("hash"), "{refused}");
        let huge = ImageAbout { width_px: u32::MAX, height_px: u32::MAX, sha256: Vec::new() };
        assert!(decode(&bytes, ImageRecording::Raw, &huge, &mut GrayImage::default()).is_err());
    }
}
