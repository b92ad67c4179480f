//! Encodings of a device's images, and the choice among its formats.

use plumbline_config::options::V4l2Format;
use serde::Serialize;

/// Conversion of a device's images to 8-bit grey.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum PixelFormat {
    /// A byte a pixel.
    Grey,
    /// Two bytes a pixel: one of the left sensor, one of the right.
    Y8i,
    /// Two bytes a pixel, little end first, of which so many bits count: 10, 12 or 16.
    Wide(u8),
    /// Two bytes a pixel, luma first.
    Yuyv,
    /// Two bytes a pixel, luma second.
    Uyvy,
    /// A byte a pixel, chroma after all of them.
    Nv12,
    /// An image of JPEG.
    Mjpeg,
}

/// Codes of the kernel with what they are, in the order in which they are taken where the choice is ours: grey before
/// colour, few bytes before many, and what must be decoded last.
const FORMATS: &[(&[u8; 4], V4l2Format, PixelFormat)] = &[
    (b"GREY", V4l2Format::Grey, PixelFormat::Grey),
    (b"Y8I ", V4l2Format::Y8i, PixelFormat::Y8i),
    (b"Y10 ", V4l2Format::Y10, PixelFormat::Wide(10)),
    (b"Y12 ", V4l2Format::Y12, PixelFormat::Wide(12)),
    (b"Y16 ", V4l2Format::Y16, PixelFormat::Wide(16)),
    (b"NV12", V4l2Format::Nv12, PixelFormat::Nv12),
    // The same with luma and chroma in buffers of their own.
    (b"NM12", V4l2Format::Nv12, PixelFormat::Nv12),
    (b"YUYV", V4l2Format::Yuyv, PixelFormat::Yuyv),
    (b"UYVY", V4l2Format::Uyvy, PixelFormat::Uyvy),
    (b"MJPG", V4l2Format::Mjpeg, PixelFormat::Mjpeg),
    (b"JPEG", V4l2Format::Mjpeg, PixelFormat::Mjpeg),
];

impl PixelFormat {
    /// Bytes of a pixel's luma and what lies between; `None` where an image has no fixed size.
    #[must_use]
    pub fn bytes_per_pixel(self) -> Option<usize> {
        match self {
            Self::Grey | Self::Nv12 => Some(1),
            Self::Y8i | Self::Wide(_) | Self::Yuyv | Self::Uyvy => Some(2),
            Self::Mjpeg => None,
        }
    }

    /// Format of a code of the kernel; `None` if it is not supported.
    pub fn from_fourcc(fourcc: u32) -> Option<Self> {
        FORMATS.iter().find(|(code, ..)| u32::from_le_bytes(**code) == fourcc).map(|(.., format)| *format)
    }
}

/// Codes that are tried for what the configuration asks for, in order.
pub(crate) fn candidates(wanted: V4l2Format) -> impl Iterator<Item = (u32, PixelFormat)> {
    let chosen = FORMATS.iter().filter(move |(_, name, _)| wanted == V4l2Format::Auto || *name == wanted);
    chosen.map(|(code, _, format)| (u32::from_le_bytes(**code), *format))
}

/// A code of the kernel as text, without the spaces at its end.
pub(crate) fn fourcc_text(fourcc: u32) -> String {
    let bytes = (fourcc & 0x7fff_ffff).to_le_bytes();
    let text: String = bytes.map(|b| if b.is_ascii_graphic() { b as char } else { ' ' }).iter().collect();
    text.trim_end().to_owned()
}

/// Arrangement of the images of left and right camera in the output of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrangement {
    /// One image, of one camera.
    Single,
    /// The left image in the left half, the right one in the right.
    SideBySide,
    /// Pixels of left and right in alternation (`Y8I`).
    Interleaved,
}

impl Arrangement {
    /// Returns the arrangement of a format; `both` says whether the device delivers both images. `None` if the format
    /// cannot.
    pub fn of(format: PixelFormat, both: bool) -> Option<Self> {
        match (format, both) {
            (PixelFormat::Y8i, true) => Some(Self::Interleaved),
            (PixelFormat::Y8i, false) => None,
            (_, true) => Some(Self::SideBySide),
            (_, false) => Some(Self::Single),
        }
    }

    /// Width that the device is asked for, px, where each image is to be `width_px` wide.
    #[must_use]
    pub fn device_width_px(self, width_px: usize) -> usize {
        match self {
            Self::SideBySide => 2 * width_px,
            Self::Single | Self::Interleaved => width_px,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_is_taken_before_colour_and_what_is_asked_for_alone() {
        let names = |wanted| candidates(wanted).map(|(code, _)| fourcc_text(code)).collect::<Vec<_>>();
        assert_eq!(names(V4l2Format::Auto)[..3], ["GREY", "Y8I", "Y10"]);
        assert_eq!(names(V4l2Format::Auto).last().unwrap(), "JPEG");
        assert_eq!(names(V4l2Format::Nv12), ["NV12", "NM12"]);
        assert_eq!(names(V4l2Format::Y8i), ["Y8I"]);
    }

    #[test]
    fn every_format_of_the_configuration_has_a_code() {
        use V4l2Format as F;
        for wanted in [F::Auto, F::Grey, F::Y8i, F::Y10, F::Y12, F::Y16, F::Yuyv, F::Uyvy, F::Nv12, F::Mjpeg]
        {
            assert!(candidates(wanted).count() > 0, "{wanted:?}");
        }
        assert_eq!(PixelFormat::from_fourcc(u32::from_le_bytes(*b"Y12 ")), Some(PixelFormat::Wide(12)));
        assert_eq!(PixelFormat::from_fourcc(u32::from_le_bytes(*b"RGB3")), None);
    }

    #[test]
    fn two_images_of_one_device_lie_side_by_side_or_interleaved() {
        assert_eq!(Arrangement::of(PixelFormat::Y8i, true), Some(Arrangement::Interleaved));
        assert_eq!(Arrangement::of(PixelFormat::Y8i, false), None);
        let halves = Arrangement::of(PixelFormat::Yuyv, true).unwrap();
        assert_eq!((halves, halves.device_width_px(672)), (Arrangement::SideBySide, 1344));
    }
}
