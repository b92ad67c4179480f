//! 8-bit grey images: owned ([`GrayImage`]), lent from a buffer of the caller's own ([`ImageView`]), or the pair of a rig
//! ([`StereoFrame`]).

use crate::Timestamp;

/// An owned 8-bit grey image, rows without padding: the first pixel is the upper left one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GrayImage {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl GrayImage {
    /// A black image of `width` x `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![0; width * height] }
    }

    /// Takes `pixels` (row-major, `width * height` of them); `None` when their number differs.
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<u8>) -> Option<Self> {
        (pixels.len() == width * height).then_some(Self { width, height, pixels })
    }

    /// Width in pixels.
    #[inline]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    #[inline]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels, row-major.
    #[inline]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// The pixels, row-major, to be written in place.
    #[inline]
    pub fn pixels_mut(&mut self) -> &mut [u8] {
        &mut self.pixels
    }

    /// A borrowed view of the whole image.
    #[inline]
    pub fn view(&self) -> ImageView<'_> {
        ImageView { width: self.width, height: self.height, stride: self.width, pixels: &self.pixels }
    }
}

/// A borrowed 8-bit grey image: pixel `(x, y)` is byte `y * stride + x`. Rows may be padded, as those of camera
/// buffers are; the padding is never read.
///
/// ```
/// use plumbline_config::ImageView;
///
/// // A camera's buffer: rows of 768 bytes, of which the first 752 are the image.
/// let buffer = vec![0u8; 768 * 480];
/// let image = ImageView::new(752, 480, 768, &buffer)?;
/// assert_eq!(image.rows().map(<[u8]>::len).sum::<usize>(), 752 * 480);
/// # Ok::<(), plumbline_config::ImageError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ImageView<'a> {
    width: usize,
    height: usize,
    stride: usize,
    pixels: &'a [u8],
}

/// Reason why a buffer cannot be viewed as an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// Rows would overlap.
    #[error(
        "a stride of {stride} bytes is less than the width of {width} px; give the bytes from row to row"
    )]
    ShortStride {
        /// Width of the image, px.
        width: usize,
        /// Bytes from the beginning of a row to that of the next.
        stride: usize,
    },
    /// The last row ends beyond the buffer.
    #[error("the buffer has {bytes} bytes and the image needs {needed}; check its size and stride")]
    ShortBuffer {
        /// Bytes that there are.
        bytes: usize,
        /// Bytes to the end of the last row; `usize::MAX` when that cannot be counted.
        needed: usize,
    },
}

impl<'a> ImageView<'a> {
    /// Views `pixels` as an image of `width` x `height` pixels whose rows begin `stride` bytes apart. Nothing is
    /// copied. The last row needs no padding.
    ///
    /// # Errors
    /// When `stride` is less than `width`, or the buffer ends before the last row does.
    pub fn new(width: usize, height: usize, stride: usize, pixels: &'a [u8]) -> Result<Self, ImageError> {
        if stride < width {
            return Err(ImageError::ShortStride { width, stride });
        }
        let needed = match height.checked_sub(1) {
            None => 0,
            Some(rows) => rows.checked_mul(stride).and_then(|b| b.checked_add(width)).unwrap_or(usize::MAX),
        };
        if pixels.len() < needed {
            return Err(ImageError::ShortBuffer { bytes: pixels.len(), needed });
        }
        Ok(Self { width, height, stride, pixels })
    }

    /// Width in pixels.
    #[inline]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    #[inline]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row `y` from the top, `width` pixels.
    ///
    /// # Panics
    /// When `y` is not less than the height.
    #[inline]
    pub fn row(&self, y: usize) -> &'a [u8] {
        assert!(y < self.height, "row {y} of {}", self.height);
        &self.pixels[y * self.stride..][..self.width]
    }

    /// The grey level at column `x` of row `y`.
    ///
    /// # Panics
    /// When the buffer ends before it; a column beyond `width` is padding.
    #[inline]
    pub fn pixel(&self, x: usize, y: usize) -> u8 {
        self.pixels[y * self.stride + x]
    }

    /// The rows from top to bottom, `width` pixels each.
    #[inline]
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &'a [u8]> + use<'a> {
        let view = *self;
        (0..self.height).map(move |y| view.row(y))
    }
}

/// A stereo pair in buffers that are allocated once and written again and again.
#[derive(Clone, Debug)]
pub struct StereoFrame {
    /// Counts frames of the sensor from 0; a jump says how many were lost.
    pub sequence: u64,
    /// Measurement time by the camera's clock (of the left image where both are there).
    pub stamp: Timestamp,
    /// Left and right image; what they hold counts only where `valid` says so.
    pub images: [GrayImage; 2],
    /// Images that arrived.
    pub valid: [bool; 2],
}

impl StereoFrame {
    /// Buffers for a rig of up to two cameras, sizes in pixels (0x0 for a camera that is not there).
    pub fn new(sizes_px: [(usize, usize); 2]) -> Self {
        let images = sizes_px.map(|(width, height)| GrayImage::new(width, height));
        Self { sequence: 0, stamp: Timestamp::default(), images, valid: [false; 2] }
    }

    /// The image of camera `index`, if it arrived.
    pub fn image(&self, index: usize) -> Option<ImageView<'_>> {
        self.valid[index].then(|| self.images[index].view())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_is_never_seen() {
        let buffer: Vec<u8> = (0..20).collect();
        let view = ImageView::new(3, 4, 5, &buffer).expect("fits");
        let rows: Vec<&[u8]> = view.rows().collect();
        assert_eq!(rows, [&[0, 1, 2][..], &[5, 6, 7], &[10, 11, 12], &[15, 16, 17]]);
        assert_eq!(view.row(2), [10, 11, 12]);
    }

    #[test]
    fn the_last_row_needs_no_padding() {
        let buffer = [0; 18];
        assert!(ImageView::new(3, 4, 5, &buffer).is_ok());
        let refused = ImageView::new(3, 4, 5, &buffer[..17]).map(|_| ());
        assert_eq!(refused, Err(ImageError::ShortBuffer { bytes: 17, needed: 18 }));
    }

    #[test]
    fn impossible_strides_and_sizes_are_refused() {
        let buffer = [0; 18];
        let refused = ImageView::new(5, 2, 4, &buffer).map(|_| ());
        assert_eq!(refused, Err(ImageError::ShortStride { width: 5, stride: 4 }));
        let refused = ImageView::new(5, usize::MAX, 1 << 60, &buffer).map(|_| ());
        assert_eq!(refused, Err(ImageError::ShortBuffer { bytes: 18, needed: usize::MAX }));
        assert!(ImageView::new(0, 0, 0, &[]).is_ok());
        assert!(ImageView::new(7, 0, 7, &[]).is_ok());
    }

    #[test]
    fn an_owned_image_is_viewed_whole() {
        let image = GrayImage::from_pixels(3, 2, vec![1, 2, 3, 4, 5, 6]).expect("size");
        assert_eq!(image.view().rows().flatten().copied().collect::<Vec<u8>>(), image.pixels());
        assert_eq!(GrayImage::default().view().rows().len(), 0);
    }
}
