//! An 8-bit Gaussian image pyramid.
//!
//! Level `l + 1` is level `l`, smoothed by the separable binomial filter `[1 4 6 4 1] / 16` (Burt and
//! Adelson 1983) and decimated **at the even pixels**. With pixel centres at integer coordinates a point
//! therefore has exactly the coordinates `x_l = x_0 / 2^l` on level `l`: the filter is symmetric, there is
//! no half-pixel shift.
//!
//! Every level carries a rim of [`PAD`] replicated pixels, so that a patch near the edge can be sampled
//! without a test per pixel.

use plumbline_config::ImageView;

/// Replicated pixels around every level: more than half a patch (7 px) turned by 45 degrees.
pub const PAD: usize = 16;
/// A level whose shorter side is smaller than this holds nothing but blur, px.
const MIN_SIDE: usize = 24;
/// Reach of the filter, px.
const REACH: usize = 2;

/// A borrowed level of a pyramid (or any other piece of an image), rim included.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a> {
    /// Rows without gaps, `columns` pixels each.
    pub pixels: &'a [u8],
    /// Pixels per row.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
    /// Index of pixel `(0, 0)` of the image in `pixels`, in both directions.
    pub origin: usize,
}

/// One level: an image with its rim.
#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Level {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![0; (width + 2 * PAD) * (height + 2 * PAD)] }
    }

    fn stride(&self) -> usize {
        self.width + 2 * PAD
    }

    /// Row `y` of the image, without the rim.
    fn row_mut(&mut self, y: usize) -> &mut [u8] {
        let start = (y + PAD) * self.stride() + PAD;
        &mut self.pixels[start..start + self.width]
    }

    /// Row `y` of the image (`-PAD <= y < height + PAD`), with the rim.
    fn padded_row(&self, y: isize) -> &[u8] {
        let start = (y + PAD as isize) as usize * self.stride();
        &self.pixels[start..start + self.stride()]
    }

    /// Replicates the outermost pixels into the rim.
    fn fill_rim(&mut self) {
        let (stride, width, height) = (self.stride(), self.width, self.height);
        for row in self.pixels.chunks_exact_mut(stride).skip(PAD).take(height) {
            let (first, last) = (row[PAD], row[PAD + width - 1]);
            row[..PAD].fill(first);
            row[PAD + width..].fill(last);
        }
        let (first, last) = (PAD * stride, (PAD + height - 1) * stride);
        for y in 0..PAD {
            self.pixels.copy_within(first..first + stride, y * stride);
            self.pixels.copy_within(last..last + stride, (PAD + height + y) * stride);
        }
    }
}

/// Room for an image while it is smoothed ([`Pyramid::smooth`]).
#[derive(Clone, Debug)]
pub struct Smoothing(Level);

impl Smoothing {
    /// Room for images of `width` x `height` pixels.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self(Level::new(width.max(1), height.max(1)))
    }
}

/// A preallocated pyramid: filled by [`Self::build`], read by [`Self::plane`].
#[derive(Clone, Debug)]
pub struct Pyramid {
    levels: Vec<Level>,
    /// One vertically filtered row, with the filter's reach on both sides; even before odd columns where every second pixel is wanted.
    filtered: Vec<u16>,
}

impl Pyramid {
    /// A pyramid for images of `width` x `height` pixels with at most `levels` levels; levels too small to
    /// be of use are left out, but there is always the first.
    #[must_use]
    pub fn new(width: usize, height: usize, levels: usize) -> Self {
        let mut all = vec![Level::new(width.max(1), height.max(1))];
        while all.len() < levels {
            let (width, height) =
                (all[all.len() - 1].width.div_ceil(2), all[all.len() - 1].height.div_ceil(2));
            if width.min(height) < MIN_SIDE {
                break;
            }
            all.push(Level::new(width, height));
        }
        Self { levels: all, filtered: vec![0; width + 2 * REACH + 2] }
    }

    /// Number of levels.
    pub fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// Width and height of a level in pixels, without its rim.
    pub fn size(&self, level: usize) -> (usize, usize) {
        (self.levels[level].width, self.levels[level].height)
    }

    /// Fills the pyramid with an image; `false`, and nothing is changed, when its size is not the pyramid's.
    pub fn build(&mut self, image: &ImageView<'_>) -> bool {
        let base = &mut self.levels[0];
        if image.width() != base.width || image.height() != base.height {
            return false;
        }
        for (y, row) in image.rows().enumerate() {
            base.row_mut(y).copy_from_slice(row);
        }
        base.fill_rim();
        self.build_levels();
        true
    }

    /// Puts a smoothed image in the place of the one that was taken, by the filter of the pyramid: white noise is a quarter then.
    pub fn smooth(&mut self, workspace: &mut Smoothing) {
        let Smoothing(raw) = workspace;
        if (raw.width, raw.height) != self.size(0) {
            return;
        }
        std::mem::swap(raw, &mut self.levels[0]);
        let span = raw.width + 2 * REACH;
        let base = &mut self.levels[0];
        for y in 0..base.height {
            filter_columns(rows_around(raw, y as isize, span), &mut self.filtered[..span]);
            filter_row(&self.filtered[..span], base.row_mut(y));
        }
        base.fill_rim();
        self.build_levels();
    }

    fn build_levels(&mut self) {
        for l in 1..self.levels.len() {
            let (fine, coarse) = self.levels.split_at_mut(l);
            decimate(&fine[l - 1], &mut coarse[0], &mut self.filtered);
            coarse[0].fill_rim();
        }
    }

    /// A level to be sampled from.
    pub fn plane(&self, level: usize) -> Plane<'_> {
        let l = &self.levels[level];
        Plane { pixels: &l.pixels, columns: l.stride(), rows: l.height + 2 * PAD, origin: PAD }
    }
}

/// Row `y` and two on either side, with the filter's reach beyond both ends.
#[inline]
fn rows_around(level: &Level, y: isize, span: usize) -> [&[u8]; 5] {
    let row = |dy: isize| &level.padded_row(y + dy)[PAD - REACH..PAD - REACH + span];
    [row(-2), row(-1), row(0), row(1), row(2)]
}

/// The horizontal half of the filter, at every pixel; rounds.
fn filter_row(filtered: &[u16], out: &mut [u8]) {
    for (pixel, w) in out.iter_mut().zip(filtered.windows(2 * REACH + 1)) {
        let sum =
            u32::from(w[0]) + u32::from(w[4]) + 4 * (u32::from(w[1]) + u32::from(w[3])) + 6 * u32::from(w[2]);
        *pixel = ((sum + 128) >> 8) as u8;
    }
}

fn decimate(fine: &Level, coarse: &mut Level, filtered: &mut [u16]) {
    let pairs = coarse.width + REACH;
    let (even, odd) = filtered.split_at_mut(pairs);
    for y in 0..coarse.height {
        filter_columns_apart(rows_around(fine, 2 * y as isize, 2 * pairs), even, &mut odd[..pairs]);
        filter_row_at_even([even, odd], coarse.row_mut(y));
    }
}

/// A sum by the weights of the filter.
#[inline(always)]
fn weigh(values: [u16; 5]) -> u16 {
    let [a, b, c, d, e] = values.map(std::num::Wrapping);
    (a + e + ((b + d) << 2) + ((c << 1) + (c << 2))).0
}

/// The vertical half of the filter: sums of at most `16 * 255`.
fn filter_columns(rows: [&[u8]; 5], out: &mut [u16]) {
    let n = out.len();
    let rows = rows.map(|r| &r[..n]);
    for i in 0..n {
        out[i] = weigh(rows.map(|row| u16::from(row[i])));
    }
}

/// The vertical half of the filter, even and odd columns apart: the horizontal half then adds whole registers.
fn filter_columns_apart(rows: [&[u8]; 5], even: &mut [u16], odd: &mut [u16]) {
    let n = even.len();
    let odd = &mut odd[..n];
    let rows = rows.map(|row| &row.as_chunks::<2>().0[..n]);
    for i in 0..n {
        let pairs = rows.map(|row| u16::from_le_bytes(row[i]));
        odd[i] = weigh(pairs.map(|pair| pair >> 8));
        // The sums of whole pairs overflow, and are right again without the odd columns.
        even[i] = weigh(pairs).wrapping_sub(odd[i] << 8);
    }
}

/// The horizontal half at every second pixel, the first of which is [`REACH`] pixels from the first of the even ones.
fn filter_row_at_even([even, odd]: [&[u16]; 2], out: &mut [u8]) {
    const HALF: u16 = 128;
    let n = out.len();
    let [a, c, e] = [0, 1, 2].map(|k| &even[k..k + n]);
    let [b, d] = [0, 1].map(|k| &odd[k..k + n]);
    for i in 0..n {
        // At most 256 * 255 + 128, which a u16 holds.
        out[i] = ((weigh([a[i], b[i], c[i], d[i], e[i]]) + HALF) >> 8) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::synthetic::Texture;
    use plumbline_config::GrayImage;

    #[test]
    fn levels_have_the_coordinates_of_the_base_divided_by_powers_of_two() {
        // A ramp stays a ramp under a symmetric filter: its value tells the coordinate.
        let mut image = GrayImage::new(201, 133);
        for (i, p) in image.pixels_mut().iter_mut().enumerate() {
            *p = (20 + i % 201) as u8;
        }
        let mut pyramid = Pyramid::new(201, 133, 3);
        assert!(pyramid.build(&image.view()));
        for level in 0..3 {
            let plane = pyramid.plane(level);
            let (width, _) = pyramid.size(level);
            for x in 4..width - 4 {
                let value = plane.pixels[(PAD + 9) * plane.columns + PAD + x];
                assert_eq!(usize::from(value), 20 + (x << level), "level {level}, x {x}");
            }
        }
    }

    #[test]
    fn a_uniform_image_stays_uniform_at_any_size() {
        for (width, height) in [(64, 64), (65, 63), (97, 50)] {
            let image = GrayImage::from_pixels(width, height, vec![255; width * height]).expect("size");
            let mut pyramid = Pyramid::new(width, height, 4);
            assert!(pyramid.build(&image.view()));
            for level in 0..pyramid.level_count() {
                assert!(pyramid.plane(level).pixels.iter().all(|&p| p == 255));
            }
        }
    }

    #[test]
    fn wrong_sizes_are_refused_and_small_levels_left_out() {
        let mut pyramid = Pyramid::new(96, 64, 4);
        assert_eq!(pyramid.level_count(), 2);
        assert!(!pyramid.build(&GrayImage::new(64, 96).view()));
        assert!(pyramid.build(&Texture::new(1).render(96, 64).view()));
    }
}
