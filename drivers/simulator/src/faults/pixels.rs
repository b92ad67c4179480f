//! Changes of the pixels of one image by faults.

use crate::noise::{NOISE_RUN, NoiseTable};
use jpeg_encoder::{ColorType, Encoder};
use plumbline_config::GrayImage;
use plumbline_drivers::v4l2::LumaDecoder;

/// Noise of `sigma` grey levels for the image of `camera` in frame `sequence`, which keeps the share `correlation` of its `field` of
/// the frame before; the field is empty before the first frame.
pub(super) fn add_noise(
    table: &NoiseTable,
    image: &mut GrayImage,
    field: &mut Vec<f32>,
    (sigma, correlation): (f64, f64),
    (sequence, camera): (u64, usize),
) {
    let is_first = field.is_empty();
    field.resize(image.pixels().len(), 0.0);
    let (kept, new) =
        if is_first { (0.0, 1.0) } else { (correlation, (1.0 - correlation * correlation).sqrt()) };
    let (sigma, kept, new) = (sigma as f32, kept as f32, new as f32);
    let runs = field.chunks_mut(NOISE_RUN).zip(table.runs(sequence, camera));
    for (pixels, (field, noise)) in image.pixels_mut().chunks_mut(NOISE_RUN).zip(runs) {
        for ((pixel, field), noise) in pixels.iter_mut().zip(field).zip(noise) {
            *field = kept * *field + new * noise;
            // The grey level nearest to the value: a cast keeps within 0 to 255.
            *pixel = (f32::from(*pixel) + sigma * *field + 0.5) as u8;
        }
    }
}

/// Shifts an image to the right and down by whole pixels; what comes into view repeats the edge.
pub(super) fn shift(image: &mut GrayImage, right_px: f64, down_px: f64) {
    let (width, height) = (image.width() as isize, image.height() as isize);
    let (right, down) = (right_px.round() as isize, down_px.round() as isize);
    if width == 0 || height == 0 || (right, down) == (0, 0) {
        return;
    }
    let source = |at: isize, by: isize, size: isize| (at - by).clamp(0, size - 1);
    let pixels = image.pixels_mut();
    // Each row is written after the last row that is made of it.
    let rows = |k: isize| if down > 0 { height - 1 - k } else { k };
    for v in (0..height).map(rows) {
        let from = (source(v, down, height) * width) as usize;
        pixels.copy_within(from..from + width as usize, (v * width) as usize);
    }
    for row in pixels.chunks_mut(width as usize) {
        let columns = |k: isize| if right > 0 { width - 1 - k } else { k };
        for u in (0..width).map(columns) {
            row[u as usize] = row[source(u, right, width) as usize];
        }
    }
}

/// JPEG encoder and decoder of one camera.
pub(super) struct Jpeg {
    file: Vec<u8>,
    decoder: LumaDecoder,
}

impl Jpeg {
    pub(super) fn new(image: &GrayImage) -> Self {
        Self {
            file: Vec::with_capacity(image.pixels().len()),
            decoder: LumaDecoder::new(image.width(), image.height()),
        }
    }

    /// Compresses the image and decodes it again. An image that JPEG cannot hold stays as it is.
    pub(super) fn pass(&mut self, image: &mut GrayImage, quality: f64) {
        let (Ok(width), Ok(height)) = (u16::try_from(image.width()), u16::try_from(image.height())) else {
            return;
        };
        self.file.clear();
        let encoder = Encoder::new(&mut self.file, quality.round().clamp(1.0, 100.0) as u8);
        if encoder.encode(image.pixels(), width, height, ColorType::Luma).is_ok()
            && let Some(pixels) = self.decoder.decode(&self.file)
        {
            image.pixels_mut().copy_from_slice(pixels);
        }
    }
}
