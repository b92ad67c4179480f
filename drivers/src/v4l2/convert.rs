//! From the bytes of a driver's buffer to 8-bit grey images, in one pass and without memory of its own; JPEG is made grey
//! first.

use super::format::{Arrangement, PixelFormat};
use super::jpeg::LumaDecoder;
use plumbline_config::GrayImage;

/// Format of a device's images: their encoding and their layout in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// The encoding.
    pub format: PixelFormat,
    /// Arrangement of the cameras' images in it.
    pub arrangement: Arrangement,
    /// Width of each camera's image, px.
    pub width_px: usize,
    /// Height, px.
    pub height_px: usize,
    /// Bytes from the beginning of a row to that of the next; without meaning for JPEG.
    pub stride: usize,
}

impl RawLayout {
    /// Bytes of a row that are looked at; 0 for JPEG.
    fn row_bytes(&self) -> usize {
        let width = self.arrangement.device_width_px(self.width_px);
        self.format.bytes_per_pixel().map_or(0, |bytes| width.saturating_mul(bytes))
    }

    /// Bytes to the end of the last row; 0 for JPEG.
    fn needed(&self) -> usize {
        match self.height_px.checked_sub(1) {
            None => 0,
            Some(rows) => rows.saturating_mul(self.stride).saturating_add(self.row_bytes()),
        }
    }
}

/// Makes images of the buffers of one device.
#[derive(Debug)]
pub struct Converter {
    layout: RawLayout,
    jpeg: Option<LumaDecoder>,
}

impl Converter {
    /// For buffers that lie so.
    pub fn new(layout: RawLayout) -> Self {
        let width = layout.arrangement.device_width_px(layout.width_px);
        let jpeg = (layout.format == PixelFormat::Mjpeg).then(|| LumaDecoder::new(width, layout.height_px));
        Self { layout, jpeg }
    }

    /// Layout of the buffers.
    pub fn layout(&self) -> &RawLayout {
        &self.layout
    }

    /// Writes the images that `bytes` hold into `images`: one, or left and right. Images of another size than the
    /// layout says are made anew, and everything else but JPEG without allocating.
    ///
    /// `None` when the bytes are no image; what the images hold is then of no use.
    ///
    /// # Panics
    /// When there are not as many images as the layout has.
    pub fn convert(&mut self, bytes: &[u8], images: &mut [GrayImage]) -> Option<()> {
        let layout = self.layout;
        for image in images.iter_mut() {
            if (image.width(), image.height()) != (layout.width_px, layout.height_px) {
                *image = GrayImage::new(layout.width_px, layout.height_px);
            }
        }
        let (layout, bytes) = match &mut self.jpeg {
            Some(jpeg) => {
                let stride = layout.arrangement.device_width_px(layout.width_px);
                (RawLayout { format: PixelFormat::Grey, stride, ..layout }, jpeg.decode(bytes)?)
            }
            None => (layout, bytes),
        };
        if layout.stride < layout.row_bytes() || bytes.len() < layout.needed() {
            return None;
        }
        match (layout.arrangement, images) {
            (Arrangement::Single, [image]) => single(&layout, bytes, image),
            (Arrangement::SideBySide, [left, right]) => halves(&layout, bytes, left, right),
            (Arrangement::Interleaved, [left, right]) => interleaved(&layout, bytes, left, right),
            (arrangement, images) => panic!("{} images for {arrangement:?}", images.len()),
        }
        Some(())
    }
}

fn single(layout: &RawLayout, bytes: &[u8], image: &mut GrayImage) {
    let width = layout.width_px;
    if layout.format.bytes_per_pixel() == Some(1) && layout.stride == width {
        image.pixels_mut().copy_from_slice(&bytes[..width * layout.height_px]);
        return;
    }
    for (from, to) in rows(layout, bytes).zip(image.pixels_mut().chunks_exact_mut(width.max(1))) {
        luma_row(layout.format, from, to);
    }
}

/// Rows of a buffer with those of the two images that are made of it.
fn rows_of_both<'a>(
    layout: &RawLayout,
    bytes: &'a [u8],
    left: &'a mut GrayImage,
    right: &'a mut GrayImage,
) -> impl Iterator<Item = (&'a [u8], &'a mut [u8], &'a mut [u8])> {
    let width = layout.width_px.max(1);
    let left = left.pixels_mut().chunks_exact_mut(width);
    let both = left.zip(right.pixels_mut().chunks_exact_mut(width));
    rows(layout, bytes).zip(both).map(|(from, (left, right))| (from, left, right))
}

fn halves(layout: &RawLayout, bytes: &[u8], left: &mut GrayImage, right: &mut GrayImage) {
    for (from, left, right) in rows_of_both(layout, bytes, left, right) {
        let (from_left, from_right) = from.split_at(from.len() / 2);
        luma_row(layout.format, from_left, left);
        luma_row(layout.format, from_right, right);
    }
}

fn interleaved(layout: &RawLayout, bytes: &[u8], left: &mut GrayImage, right: &mut GrayImage) {
    for (from, left, right) in rows_of_both(layout, bytes, left, right) {
        for ((pair, left), right) in from.chunks_exact(2).zip(left).zip(right) {
            (*left, *right) = (pair[0], pair[1]);
        }
    }
}

/// The rows of a buffer that is whole, without padding.
fn rows<'a>(layout: &RawLayout, bytes: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + use<'a> {
    let (row, stride, height) = (layout.row_bytes(), layout.stride, layout.height_px);
    (0..height).map(move |y| &bytes[y * stride..][..row])
}

/// Luma of a row. Wide pixels lose their lower bits.
fn luma_row(format: PixelFormat, from: &[u8], to: &mut [u8]) {
    let pairs = from.chunks_exact(2).zip(to.iter_mut());
    match format {
        PixelFormat::Grey | PixelFormat::Nv12 => to.copy_from_slice(from),
        PixelFormat::Yuyv | PixelFormat::Y8i => pairs.for_each(|(pair, to)| *to = pair[0]),
        PixelFormat::Uyvy => pairs.for_each(|(pair, to)| *to = pair[1]),
        PixelFormat::Wide(bits) => {
            let shift = u32::from(bits.saturating_sub(8));
            // What a driver leaves in the bits above is no brightness.
            pairs.for_each(|(pair, to)| {
                *to = (u16::from_le_bytes([pair[0], pair[1]]) >> shift).min(255) as u8
            });
        }
        PixelFormat::Mjpeg => {}
    }
}

#[cfg(test)]
mod tests;
