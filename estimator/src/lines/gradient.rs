//! Image gradients and the ridges of their magnitude, at half the resolution of the image.
//!
//! Edges are found in an image of half the size, whose pixels are the sums of four: a quarter of the pixels and half the
//! way along each edge, and half the noise; where an edge lies to a fraction of a pixel the whole image tells
//! ([`super::refine`]). The halved image is smoothed by the binomial filter `[1 2 1] / 4` in both directions (with the sums,
//! sigma 1.5 px of the whole image) and differentiated by Sobel's operator. All arithmetic is in 16-bit integers with
//! [`SCALE`] steps per grey level and halved pixel, written in whole rows that the compiler vectorises; the bits are
//! the same at any width.
//!
//! A ridge is a pixel whose magnitude exceeds the threshold and that of its two neighbours along the
//! dominant axis of its gradient: where an edge may pass. Ridges are found while the rows are still in the
//! cache. What growth reads of a pixel, its gradient and its marks, is one word: following an edge is bound
//! by memory.

use super::segment::{REDUCTION, Segment, halved_px};
use crate::image::mask::ImageMask;
use nalgebra::Vector2;
use plumbline_config::ImageView;
use std::ops::Range;

/// Steps of a stored gradient per grey level and pixel: 16 of smoothing times 8 of Sobel's weights.
pub const SCALE: f32 = 128.0;
/// Ridges are looked for this far from the image's edge, halved px: there the filters see the image alone.
pub const BORDER: usize = 2;
/// Gradients are computed so many rows beyond those of the seeds: a descriptor looks so far.
const MARGIN: usize = 14;
/// One in this many ridges of an edge is a seed: a segment is much longer than that.
const SEED_STEP: usize = 8;
/// First column that is looked at for seeds of flat edges.
const FIRST_COLUMN: usize = BORDER + SEED_STEP / 2;

/// The gradient of a pixel; the lowest bit of either component holds a mark of the growth instead.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pixel {
    gx: i16,
    gy: i16,
}

impl Pixel {
    /// The gradient, in steps.
    pub fn gradient(self) -> (i16, i16) {
        (self.gx & !1, self.gy & !1)
    }

    /// The gradient as a vector, in steps.
    pub fn vector(self) -> Vector2<f32> {
        let (gx, gy) = self.gradient();
        Vector2::new(f32::from(gx), f32::from(gy))
    }

    /// All of it in one word, for [`of_word`]: x in the lower half.
    pub fn word(self) -> u32 {
        u32::from(self.gx as u16) | u32::from(self.gy as u16) << 16
    }

    /// True if an edge here is steep, by a gradient without marks.
    fn is_steep(self) -> bool {
        self.gx.abs() >= self.gy.abs()
    }

    /// True if the pixel belongs to a segment, or lies beside one that does.
    pub fn is_taken(self) -> bool {
        self.gx & 1 != 0
    }

    /// True if the growth of a segment was tried here and failed.
    pub fn is_tried(self) -> bool {
        self.gy & 1 != 0
    }

    /// The pixel marked as taken.
    pub fn taken(self) -> Self {
        Self { gx: self.gx | 1, ..self }
    }

    /// Marks the pixel as tried, and no longer taken.
    pub fn give_back(&mut self) {
        self.gx &= !1;
        self.gy |= 1;
    }
}

/// The gradient of a pixel given by its word.
#[inline(always)]
pub fn of_word(word: u32) -> [f32; 2] {
    [((word << 16) as i32 >> 16 & !1) as f32, (word as i32 >> 16 & !1) as f32]
}

/// Gradients of one image at half its resolution, and the memory that computing them needs.
#[derive(Clone, Debug)]
pub struct Gradients {
    /// Width of the halved image, px.
    pub(super) width: usize,
    /// Height of the halved image, px.
    pub(super) height: usize,
    /// All pixels, row by row.
    pub(super) pixels: Vec<Pixel>,
    /// Rows whose gradients are those of the last image.
    pub(super) rows: Range<usize>,
    /// One row of the halved image: sums of four pixels.
    halved: Vec<u16>,
    /// The last three rows, smoothed horizontally.
    blurred: [Vec<u16>; 3],
    /// The last three rows, smoothed.
    smooth: [Vec<i16>; 3],
    /// Vertical sums and differences of the three.
    sums: [Vec<i16>; 2],
    /// Magnitudes of all pixels, in steps: of most that growth looks at it asks for nothing else.
    pub(super) magnitudes: Vec<i16>,
    /// Which pixels of a row are seeds.
    marks: Vec<bool>,
}

impl Gradients {
    /// For images of `width` x `height` px, at least `4 BORDER` of each.
    pub fn new(width: usize, height: usize) -> Self {
        let (width, height) = (width / REDUCTION, height / REDUCTION);
        Self {
            width,
            height,
            pixels: vec![Pixel::default(); width * height],
            rows: 0..height,
            halved: vec![0; width],
            blurred: std::array::from_fn(|_| vec![0; width]),
            smooth: std::array::from_fn(|_| vec![0; width]),
            sums: std::array::from_fn(|_| vec![0; width]),
            magnitudes: vec![0; width * height],
            marks: vec![false; width],
        }
    }

    /// Makes everything flat that `mask` hides, at half the resolution: no edge leads there.
    pub fn hide(&mut self, mask: &ImageMask) {
        for index in mask.hidden() {
            self.pixels[index] = Pixel::default();
            self.magnitudes[index] = 0;
        }
    }

    /// Marks the pixels along a segment of the image as taken.
    pub fn take(&mut self, segment: &Segment) {
        let nodes = segment.nodes.iter().filter(|node| node.weight > 0.0).map(|node| node.px);
        let mut from = halved_px(&segment.start);
        for to in nodes.chain([segment.end]).map(|px| halved_px(&px)) {
            let step = to - from;
            let steps = step.amax().ceil();
            let across = if step.y.abs() > step.x.abs() { 1 } else { self.width };
            for k in 0..steps as usize {
                let px = from + step * (k as f32 / steps);
                let (x, y) = ((px.x + 0.5) as usize, (px.y + 0.5) as usize);
                if self.rows.contains(&y)
                    && (1..self.width - 1).contains(&x)
                    && (1..self.height - 1).contains(&y)
                {
                    let index = y * self.width + x;
                    for k in [index - across, index, index + across] {
                        self.pixels[k] = self.pixels[k].taken();
                    }
                }
            }
            from = to;
        }
    }

    /// Computes the gradients of an image around `rows`, with no pixel marked, and hands column, row and magnitude of the ridges
    /// in these rows above `threshold` steps to `found`, row by row; of the ridges of one edge only one in `SEED_STEP`.
    ///
    /// # Panics
    /// When the image has less rows or columns than the gradients were made for.
    pub fn compute(
        &mut self,
        image: &ImageView<'_>,
        rows: Range<usize>,
        threshold: i16,
        mut found: impl FnMut(usize, usize, i16),
    ) {
        let (width, height) = (self.width, self.height);
        let last = height - 1;
        self.rows = rows.start.saturating_sub(MARGIN)..(rows.end + MARGIN).min(height);
        for y in self.rows.start.saturating_sub(2)..self.rows.end + 3 {
            if y < height {
                let pair = [image.row(REDUCTION * y), image.row(REDUCTION * y + 1)];
                halve_rows(pair, &mut self.halved);
                blur_row(&self.halved, &mut self.blurred[y % 3]);
            }
            // Smoothed row `y - 1` needs the blurred rows up to `y`; beyond the edge the last row repeats.
            if let Some(centre) = y.checked_sub(1).filter(|&c| c < height) {
                let rows = [centre.saturating_sub(1), centre, (centre + 1).min(last)];
                blur_columns(rows.map(|k| self.blurred[k % 3].as_slice()), &mut self.smooth[centre % 3]);
            }
            // Gradients of row `y - 2` need the smoothed rows up to `y - 1`.
            if let Some(centre) = y.checked_sub(2).filter(|c| *c > 0 && *c < last && self.rows.contains(c)) {
                let rows = [centre - 1, centre, centre + 1].map(|k| self.smooth[k % 3].as_slice());
                let [sum, difference] = &mut self.sums;
                combine_rows(rows, sum, difference);
                let span = centre * width..(centre + 1) * width;
                let (pixels, magnitudes) = (&mut self.pixels[span.clone()], &mut self.magnitudes[span]);
                differentiate(sum, difference, pixels, magnitudes);
            }
            // Ridges of row `y - 3` need the magnitudes up to `y - 2`.
            if let Some(centre) =
                y.checked_sub(3).filter(|c| *c >= BORDER && c + BORDER < height && rows.contains(c))
            {
                self.find_ridges(centre, threshold, &mut found);
            }
        }
    }

    /// Hands ridges of row `y` to `found`: those of steep edges in one row of [`SEED_STEP`], of flat ones in one column of so many.
    fn find_ridges(&mut self, y: usize, threshold: i16, found: &mut impl FnMut(usize, usize, i16)) {
        let Self { width, pixels, magnitudes, marks, .. } = self;
        let [up, row, down] = [y - 1, y, y + 1].map(|k| &magnitudes[k * *width..][..*width]);
        let pixels = &pixels[y * *width..][..*width];
        // Of two equal ones the first is the ridge.
        let is_flat = |x: usize| {
            let m = row[x];
            (m > threshold) & (m > up[x]) & (m >= down[x]) && !pixels[x].is_steep()
        };
        let columns = 0..(*width - BORDER - FIRST_COLUMN).div_ceil(SEED_STEP);
        let columns = columns.map(|k| FIRST_COLUMN + SEED_STEP * k);
        if !y.is_multiple_of(SEED_STEP) {
            columns.filter(|x| is_flat(*x)).for_each(|x| found(x, y, row[x]));
            return;
        }
        let inner = BORDER..*width - BORDER;
        mark_steep(&row[BORDER - 1..], &pixels[inner.clone()], threshold, &mut marks[inner]);
        columns.filter(|x| is_flat(*x)).for_each(|x| marks[x] = true);
        let marked = marks.iter().zip(row).enumerate().filter(|(_, (is_seed, _))| **is_seed);
        marked.for_each(|(x, (_, m))| found(x, y, *m));
    }
}

/// Marks the ridges of steep edges by the magnitudes of a row, which begin before the first pixel.
#[inline(never)]
fn mark_steep(row: &[i16], pixels: &[Pixel], threshold: i16, marks: &mut [bool]) {
    let n = marks.len();
    let ([left, row, right], pixels) = ([0, 1, 2].map(|k| &row[k..k + n]), &pixels[..n]);
    for i in 0..n {
        let m = row[i];
        marks[i] = (m > threshold) & (m > left[i]) & (m >= right[i]) & pixels[i].is_steep();
    }
}

/// Magnitude of a gradient by the absolute values of its components, in steps: `max + 3/8 min`, at most 7 % off the
/// Euclidean norm and exactly proportional to it across one edge.
#[inline(always)]
fn magnitude(ax: i16, ay: i16) -> i16 {
    let (most, least) = (ax.max(ay), ax.min(ay));
    most + (least >> 2) + (least >> 3)
}

/// Sums of two by two pixels, at most `4 * 255`.
fn halve_rows(rows: [&[u8]; 2], out: &mut [u16]) {
    let n = out.len();
    // Two neighbours in one word, the left one in the low byte.
    let [a, b] = rows.map(|row| &row.as_chunks::<2>().0[..n]);
    for i in 0..n {
        let (above, below) = (u16::from_le_bytes(a[i]), u16::from_le_bytes(b[i]));
        out[i] = (above & 0xFF) + (above >> 8) + (below & 0xFF) + (below >> 8);
    }
}

/// Horizontal half of the smoothing: sums of at most `16 * 255`; beyond the edge the last pixel repeats.
fn blur_row(row: &[u16], out: &mut [u16]) {
    let n = row.len();
    let inner = n - 2;
    (out[0], out[n - 1]) = (3 * row[0] + row[1], row[n - 2] + 3 * row[n - 1]);
    let (a, b, c) = (&row[..inner], &row[1..1 + inner], &row[2..2 + inner]);
    let out = &mut out[1..1 + inner];
    for i in 0..inner {
        out[i] = a[i] + 2 * b[i] + c[i];
    }
}

/// Vertical half: 16 steps per grey level.
fn blur_columns(rows: [&[u16]; 3], out: &mut [i16]) {
    let n = out.len();
    let [a, b, c] = rows.map(|r| &r[..n]);
    for i in 0..n {
        // At most 64 * 255, which a u16 holds.
        out[i] = ((a[i] + 2 * b[i] + c[i]) >> 2) as i16;
    }
}

/// Vertical parts of Sobel's operators: `[1 2 1]` and `[-1 0 1]`.
fn combine_rows(rows: [&[i16]; 3], sum: &mut [i16], difference: &mut [i16]) {
    let n = sum.len();
    let [a, b, c] = rows.map(|r| &r[..n]);
    let difference = &mut difference[..n];
    for i in 0..n {
        sum[i] = a[i] + 2 * b[i] + c[i];
        difference[i] = c[i] - a[i];
    }
}

/// Horizontal parts, and the magnitude; the outermost pixels have none.
fn differentiate(sum: &[i16], difference: &[i16], out: &mut [Pixel], magnitudes: &mut [i16]) {
    let inner = sum.len() - 2;
    let (left, right) = (&sum[..inner], &sum[2..2 + inner]);
    let (a, b, c) = (&difference[..inner], &difference[1..1 + inner], &difference[2..2 + inner]);
    let out = &mut out[1..1 + inner];
    let magnitudes = &mut magnitudes[1..1 + inner];
    for i in 0..inner {
        let (gx, gy) = ((right[i] - left[i]) & !1, (a[i] + 2 * b[i] + c[i]) & !1);
        out[i] = Pixel { gx, gy };
        // As `abs`, with an instruction less.
        magnitudes[i] = magnitude(gx.max(-gx), gy.max(-gy));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::GrayImage;

    #[test]
    fn the_steepest_image_does_not_overflow() {
        let (width, height) = (64, 64);
        let pixels = (0..width * height).map(|i| if i % width < 32 { 0 } else { 255 }).collect();
        let image = GrayImage::from_pixels(width, height, pixels).expect("size");
        let mut gradients = Gradients::new(width, height);
        let mut ridges = Vec::new();
        gradients.compute(&image.view(), 0..height / 2, 1000, |x, _, _| ridges.push(x));
        let at_edge = gradients.magnitudes[10 * width / 2 + 15];
        assert!(f32::from(at_edge) / SCALE > 60.0);
        assert!(gradients.magnitudes.iter().all(|&m| m >= 0));
        assert!(!ridges.is_empty() && ridges.iter().all(|&x| x == 15));
    }
}
