//! The line band descriptor, binary: what the image looks like along a segment.
//!
//! Source: Zhang and Koch, "An efficient and robust line segment matching approach based on LBD descriptor
//! and pairwise geometric consistency", JVCIR 2013, section 3; binary as in their published code: bands
//! compared with each other. The support region is [`BANDS`] bands of [`BAND_ROWS`] rows parallel to the
//! segment. In each row the gradients along and across the segment are summed, positive and negative parts
//! apart; a band is described by mean and standard deviation of the sums of its rows and its neighbours'.
//! Each row is sampled at [`STATIONS`] places from end to end, however long the segment is: a descriptor
//! costs the same for all.

use super::gradient::{BORDER, Gradients, of_word};
use super::segment::{REDUCTION, Segment, halved_px};
use nalgebra::Vector2;
use plumbline_config::Portable;

/// Bands across the segment.
const BANDS: usize = 9;
/// Rows of a band, a pixel of the halved image apart.
const BAND_ROWS: usize = 3;
const ROWS: usize = BANDS * BAND_ROWS;
/// Samples of a row.
const STATIONS: usize = 16;
/// Sums of a row run in so many lanes.
const LANES: usize = STATIONS / 2;
/// Figures of a row: gradient across and along, positive and negative.
const SUMS: usize = 4;
/// Figures of a band: means and standard deviations.
const FIGURES: usize = 2 * SUMS;
/// Pairs of bands that are compared, of the 36 there are.
const PAIRS: usize = 32;

/// 256 comparisons of bands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineDescriptor([u64; 4]);

impl LineDescriptor {
    /// Hamming distance: bits that differ, 0 to 256.
    pub fn hamming(&self, other: &Self) -> u32 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a ^ b).count_ones()).sum()
    }
}

/// Describes segments.
#[derive(Clone, Debug)]
pub struct Describer {
    /// Weight of a row by its distance from the segment.
    row_weight: [f32; ROWS],
    /// Weight of a row within a band and its neighbours.
    band_weight: [f32; 3 * BAND_ROWS],
}

impl Default for Describer {
    fn default() -> Self {
        let gauss = |d: f64, sigma: f64| libm::exp(-0.5 * d * d / (sigma * sigma)) as f32;
        let centred = |k: usize, n: usize| k as f64 - 0.5 * (n as f64 - 1.0);
        Self {
            row_weight: std::array::from_fn(|k| gauss(centred(k, ROWS), 0.5 * ROWS as f64)),
            band_weight: std::array::from_fn(|k| gauss(centred(k, 3 * BAND_ROWS), BAND_ROWS as f64)),
        }
    }
}

impl Describer {
    /// The descriptor of a segment in the rows that `gradients` have of the image.
    #[must_use]
    pub fn describe(&self, gradients: &Gradients, segment: &Segment) -> LineDescriptor {
        let rows = self.row_sums(gradients, segment);
        let bands: [[f32; FIGURES]; BANDS] = std::array::from_fn(|band| self.band(&rows, band));
        let mut words = [0_u64; 4];
        let pairs = (0..BANDS).flat_map(|i| (i + 1..BANDS).map(move |j| (i, j))).take(PAIRS);
        for (k, (i, j)) in pairs.enumerate() {
            words[k / 8] |= u64::from(exceeding(&bands[i], &bands[j])) << (FIGURES * (k % 8));
        }
        LineDescriptor(words)
    }

    /// Sums of the gradients of each row.
    fn row_sums(&self, gradients: &Gradients, segment: &Segment) -> [[f32; SUMS]; ROWS] {
        let along = segment.direction();
        let across = Vector2::new(-along.y, along.x);
        let [from, to] = [gradients.rows.start, gradients.rows.end].map(|row| (REDUCTION * row) as f32);
        let [start, end] = segment.ends_within(from, to).each_ref().map(halved_px);
        let first = start - across * (0.5 * (ROWS as f32 - 1.0));
        let grid = Grid::new(gradients, &first, &((end - start) / (STATIONS - 1) as f32), &across);
        let mut rows = [[0.0; SUMS]; ROWS];
        let mut seen = [[0; STATIONS]; ROWS];
        // All of them before any is read: pixels are written one by one, and read together.
        for (k, seen) in seen.iter_mut().enumerate() {
            let mut places = [0; STATIONS];
            grid.row(k as i32, &mut places);
            for (word, place) in seen.iter_mut().zip(places) {
                *word = gradients.pixels[place as usize].word();
            }
        }
        let (mut gx, mut gy) = ([0.0; STATIONS], [0.0; STATIONS]);
        for (row, (seen, weight)) in rows.iter_mut().zip(seen.iter().zip(self.row_weight)) {
            for (word, (gx, gy)) in seen.iter().zip(gx.iter_mut().zip(&mut gy)) {
                [*gx, *gy] = of_word(*word);
            }
            *row = directed_sums(&gx, &gy, [&across, &along]).map(|sum| sum * weight);
        }
        rows
    }

    /// Mean and standard deviation over the rows of a band and its neighbours.
    fn band(&self, rows: &[[f32; SUMS]; ROWS], band: usize) -> [f32; FIGURES] {
        let first = (band * BAND_ROWS) as isize - BAND_ROWS as isize;
        let (mut mean, mut square, mut weights) = ([0.0_f32; SUMS], [0.0_f32; SUMS], 0.0);
        for (k, &weight) in self.band_weight.iter().enumerate() {
            let Some(row) = usize::try_from(first + k as isize).ok().and_then(|r| rows.get(r)) else {
                continue;
            };
            weights += weight;
            for (i, &value) in row.iter().enumerate() {
                mean[i] += weight * value;
                square[i] += weight * value * value;
            }
        }
        let mut figures = [0.0; FIGURES];
        for i in 0..SUMS {
            let m = mean[i] / weights;
            figures[i] = m;
            figures[SUMS + i] = (square[i] / weights - m * m).at_least(0.0).sqrt();
        }
        figures
    }
}

/// The stations of all rows in an image: their nearest pixels; beyond the image those at its edge.
struct Grid {
    /// Coordinates of the first station, per axis, in parts of a pixel. The following fields are the steps along and
    /// across, and the last pixel.
    first: [i32; 2],
    along: [i32; 2],
    across: [i32; 2],
    last: [i32; 2],
    width: i32,
}

impl Grid {
    /// Bits of a part of a pixel.
    const FRACTION: u32 = 12;

    fn new(gradients: &Gradients, first: &Vector2<f32>, along: &Vector2<f32>, across: &Vector2<f32>) -> Self {
        let parts = |v: &Vector2<f32>| [v.x, v.y].map(|v| (v * (1 << Self::FRACTION) as f32) as i32);
        let last = [gradients.width, gradients.height].map(|side| (side - BORDER - 1) as i32);
        let half = Vector2::new(0.5, 0.5);
        Self {
            first: parts(&(first + half)),
            along: parts(along),
            across: parts(across),
            last,
            width: gradients.width as i32,
        }
    }

    /// Indices of the pixels of a row.
    #[inline(never)]
    fn row(&self, row: i32, out: &mut [i32; STATIONS]) {
        let from = [0, 1].map(|axis| self.first[axis] + self.across[axis] * row);
        for (i, out) in out.iter_mut().enumerate() {
            let [x, y] = [0, 1].map(|axis| {
                let parts = from[axis] + self.along[axis] * i as i32;
                (parts >> Self::FRACTION).max(BORDER as i32).min(self.last[axis])
            });
            *out = y * self.width + x;
        }
    }
}

// Functions of their own, whose results lie in memory: where they are many values in registers, the compiler takes them one
// by one.

/// The component of the gradients along an axis, its magnitude, and both added up by lanes. A loop for each: with more than
/// one outcome it is not made a vector's.
#[inline(never)]
fn project(
    gx: &[f32; STATIONS],
    gy: &[f32; STATIONS],
    axis: &Vector2<f32>,
    [sums, sizes]: [&mut [f32; LANES]; 2],
) {
    let (mut components, mut magnitudes) = ([0.0; STATIONS], [0.0; STATIONS]);
    for k in 0..STATIONS {
        components[k] = axis.x * gx[k] + axis.y * gy[k];
    }
    for k in 0..STATIONS {
        magnitudes[k] = components[k].abs();
    }
    for k in 0..LANES {
        sums[k] = components[k] + components[k + LANES];
    }
    for k in 0..LANES {
        sizes[k] = magnitudes[k] + magnitudes[k + LANES];
    }
}

/// The sum of the lanes, in the order of a vector unit.
fn sum(lanes: &[f32; LANES]) -> f32 {
    let [a, b, c, d]: [f32; LANES / 2] = std::array::from_fn(|k| lanes[k] + lanes[k + LANES / 2]);
    (a + c) + (b + d)
}

/// Sums of the positive and negative parts of the gradients across and along.
fn directed_sums(gx: &[f32; STATIONS], gy: &[f32; STATIONS], axes: [&Vector2<f32>; 2]) -> [f32; SUMS] {
    let mut out = [0.0; SUMS];
    for (parts, axis) in out.as_chunks_mut::<2>().0.iter_mut().zip(axes) {
        let (mut sums, mut sizes) = ([0.0; LANES], [0.0; LANES]);
        project(gx, gy, axis, [&mut sums, &mut sizes]);
        let (sum, size) = (sum(&sums), sum(&sizes));
        *parts = [0.5 * (size + sum), 0.5 * (size - sum)];
    }
    out
}

/// Comparison of the figures of two bands: a bit for each that exceeds its counterpart.
#[inline(never)]
fn exceeding(a: &[f32; FIGURES], b: &[f32; FIGURES]) -> u8 {
    let mut bits = [0_u32; FIGURES];
    for k in 0..FIGURES {
        bits[k] = u32::from(a[k] > b[k]) << k;
    }
    bits.iter().fold(0, |all, bit| all | bit) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::synthetic::Texture;
    use crate::lines::segment::{NODES, SegmentNode};

    fn segment(start: (f32, f32), end: (f32, f32)) -> Segment {
        let (start, end) = (Vector2::new(start.0, start.1), Vector2::new(end.0, end.1));
        Segment { start, end, nodes: [SegmentNode::default(); NODES], strength: 1.0, support: 1.0 }
    }

    #[test]
    fn a_segment_is_known_again_and_told_from_others() {
        let image = Texture::new(5).render(200, 160);
        let mut gradients = Gradients::new(200, 160);
        gradients.compute(&image.view(), 0..80, i16::MAX, |_, _, _| {});
        let describer = Describer::default();
        let describe = |s: &Segment| describer.describe(&gradients, s);
        let one = describe(&segment((60.0, 60.0), (120.0, 80.0)));
        let nudged = describe(&segment((60.5, 60.3), (121.0, 80.4)));
        let elsewhere = describe(&segment((60.0, 100.0), (120.0, 115.0)));
        assert!(one.hamming(&nudged) < 40, "{}", one.hamming(&nudged));
        assert!(one.hamming(&elsewhere) > 60, "{}", one.hamming(&elsewhere));
        assert_eq!(one.hamming(&one), 0);
    }

    #[test]
    fn a_segment_at_the_edge_is_described_without_leaving_the_image() {
        let gradients = Gradients::new(64, 64);
        let _ = Describer::default().describe(&gradients, &segment((1.0, 1.0), (62.9, 62.9)));
    }
}
