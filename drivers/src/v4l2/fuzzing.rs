//! Entry points of the fuzzers for this module.

use super::convert::{Converter, RawLayout};
use super::format::{Arrangement, PixelFormat};
use super::jpeg::{LumaDecoder, size_of};
use plumbline_config::GrayImage;

/// An image of JPEG of the size that it says it has, as far as that is not above `max_side_px`.
pub(crate) fn mjpeg(data: &[u8], max_side_px: usize) {
    let Some((width, height)) = size_of(data) else { return };
    if width > max_side_px || height > max_side_px {
        return;
    }
    if let Some(luma) = LumaDecoder::new(width, height).decode(data) {
        assert_eq!(luma.len(), width * height);
    }
}

/// A buffer whose first six bytes say how it is to be read: format, arrangement, width, height, padding, and how much less
/// than the rest there is.
pub(crate) fn buffer(data: &[u8]) {
    let [format, both, width, height, padding, missing, bytes @ ..] = data else { return };
    let format = match format % 9 {
        0 => PixelFormat::Grey,
        1 => PixelFormat::Y8i,
        2 => PixelFormat::Wide(10),
        3 => PixelFormat::Wide(12),
        4 => PixelFormat::Wide(16),
        5 => PixelFormat::Yuyv,
        6 => PixelFormat::Uyvy,
        7 => PixelFormat::Nv12,
        _ => PixelFormat::Mjpeg,
    };
    let Some(arrangement) = Arrangement::of(format, both % 2 == 1) else { return };
    let (width_px, height_px) = (usize::from(*width), usize::from(*height));
    // The driver's word is not taken for its stride either: some are less than a row.
    let row = arrangement.device_width_px(width_px) * format.bytes_per_pixel().unwrap_or(0);
    let stride = (row + usize::from(*padding)).saturating_sub(16);
    let layout = RawLayout { format, arrangement, width_px, height_px, stride };
    let mut images = vec![GrayImage::default(); if arrangement == Arrangement::Single { 1 } else { 2 }];
    let bytes = &bytes[..bytes.len().saturating_sub(usize::from(*missing))];
    let converted = Converter::new(layout).convert(bytes, &mut images);
    for image in &images {
        assert_eq!((image.width(), image.height()), (width_px, height_px));
    }
    if converted.is_some() && format != PixelFormat::Mjpeg {
        assert!(stride >= row && bytes.len() >= height_px.saturating_sub(1) * stride);
    }
}
