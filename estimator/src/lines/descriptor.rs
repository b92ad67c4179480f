//! The line band descriptor, binary: what the image looks like along a segment.
//!
//! Source: Zhang and Koch, "An efficient and robust line segment matching approach based on LBD descriptor
//! and pairwise geometric consistency", JVCIR 2013, section 3; binary as in their published code: bands
//! compared with each other. The support region is [`BANDS`] bands of [`BAND_ROWS`] rows parallel to the
//! segment. In each row the gradients along and across the segment are summed, positive and negative parts
//! apart; a band is described by mean and standard deviation of the sums of its rows and its neighbours'.
//! Each row is sampled at [`STATIONS`] places from end to end, however long the segment is: a descriptor
//! costs the same for all.

use super::gradient::{BORDER, Gradients, Pixel, halved_px};
use super::segment::Segment;
use crate::image::patch::whole;
use nalgebra::Vector2;
use plumbline_config::Portable;

/// Bands across the segment.
const BANDS: usize = 9;
/// Rows of a band, a pixel of the halved image apart.
const BAND_ROWS: usize = 3;
const ROWS: usize = BANDS * BAND_ROWS;
/// Samples of a row.
const STATIONS: usize = 16;
/// Figures of a row: gradient across and along, positive and negative.
const SUMS: usize = 4;
/// Figures of a band: means and standard deviations.
const FIGURES: usize = 2 * SUMS;
/// Pairs of bands that are compared, of the 36 there are.
const PAIRS: usize = 32;

/// 256 comparisons of bands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Descriptor([u64; 4]);

impl Descriptor {
    /// Hamming distance: bits that differ, 0 to 256.
    #[must_use]
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
    /// The descriptor of a segment in the image of `gradients`.
    #[must_use]
    pub fn describe(&self, gradients: &Gradients, segment: &Segment) -> Descriptor {
        let rows = self.row_sums(gradients, segment);
        let bands: [[f32; FIGURES]; BANDS] = std::array::from_fn(|band| self.band(&rows, band));
        let mut words = [0_u64; 4];
        let mut bit = 0;
        for (i, j) in (0..BANDS).flat_map(|i| (i + 1..BANDS).map(move |j| (i, j))).take(PAIRS) {
            for (a, b) in bands[i].iter().zip(&bands[j]) {
                words[bit / 64] |= u64::from(a > b) << (bit % 64);
                bit += 1;
            }
        }
        Descriptor(words)
    }

    /// Sums of the gradients of each row.
    fn row_sums(&self, gradients: &Gradients, segment: &Segment) -> [[f32; SUMS]; ROWS] {
        let along = segment.direction();
        let across = Vector2::new(-along.y, along.x);
        let [start, end] = [&segment.start, &segment.end].map(halved_px);
        let step = (end - start) / (STATIONS - 1) as f32;
        let mut rows = [[0.0; SUMS]; ROWS];
        for (k, (row, weight)) in rows.iter_mut().zip(self.row_weight).enumerate() {
            let offset = k as f32 - 0.5 * (ROWS as f32 - 1.0);
            let samples = sample_row(gradients, start + across * offset, step);
            *row = directed_sums(&samples, &along, &across).map(|sum| sum * weight);
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

/// Gradients at the stations of a row, nearest pixels; beyond the image those at its edge.
fn sample_row(gradients: &Gradients, start: Vector2<f32>, step: Vector2<f32>) -> [[f32; STATIONS]; 2] {
    let width = gradients.width();
    let right = (width - BORDER - 1) as f32;
    let bottom = (gradients.height() - BORDER - 1) as f32;
    let (mut columns, mut rows) = ([0; STATIONS], [0; STATIONS]);
    stations(start.x, step.x, right, &mut columns);
    stations(start.y, step.y, bottom, &mut rows);
    let pixels = gradients.pixels();
    let mut seen = [Pixel::default(); STATIONS];
    for i in 0..STATIONS {
        seen[i] = pixels[(rows[i] * width as i32 + columns[i]) as usize];
    }
    let mut samples = [[0.0; STATIONS]; 2];
    let [gx, gy] = &mut samples;
    components(&seen, gx, gy);
    samples
}

// Functions of their own, whose results lie in memory: where they are many values in registers, the compiler takes them one
// by one.

/// Nearest pixels of the stations along one axis, from [`BORDER`] to `last`.
#[inline(never)]
fn stations(start: f32, step: f32, last: f32, out: &mut [i32; STATIONS]) {
    for (i, out) in out.iter_mut().enumerate() {
        *out = whole((start + step * i as f32).at_least(BORDER as f32).at_most(last) + 0.5);
    }
}

/// The gradients of pixels, by components.
#[inline(never)]
fn components(pixels: &[Pixel; STATIONS], gx: &mut [f32; STATIONS], gy: &mut [f32; STATIONS]) {
    for i in 0..STATIONS {
        gx[i] = f32::from(pixels[i].gradient().0);
    }
    for i in 0..STATIONS {
        gy[i] = f32::from(pixels[i].gradient().1);
    }
}

/// Sums of the positive and negative parts across and along; in lanes, so that the order of the sums is
/// that of the vector unit, written out.
fn directed_sums(
    [gx, gy]: &[[f32; STATIONS]; 2],
    along: &Vector2<f32>,
    across: &Vector2<f32>,
) -> [f32; SUMS] {
    const LANES: usize = 8;
    let mut lanes = [[0.0_f32; LANES]; SUMS];
    for chunk in 0..STATIONS / LANES {
        for lane in 0..LANES {
            let (x, y) = (gx[chunk * LANES + lane], gy[chunk * LANES + lane]);
            let (a, b) = (across.x * x + across.y * y, along.x * x + along.y * y);
            let (left, forward) = (a.at_least(0.0), b.at_least(0.0));
            lanes[0][lane] += left;
            lanes[1][lane] += left - a;
            lanes[2][lane] += forward;
            lanes[3][lane] += forward - b;
        }
    }
    lanes.map(|lane| lane.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::synthetic::Texture;
    use crate::lines::segment::{NODES, Node};

    fn segment(start: (f32, f32), end: (f32, f32)) -> Segment {
        let (start, end) = (Vector2::new(start.0, start.1), Vector2::new(end.0, end.1));
        Segment { start, end, nodes: [Node::default(); NODES], strength: 1.0, support: 1.0 }
    }

    #[test]
    fn a_segment_is_known_again_and_told_from_others() {
        let image = Texture::new(5).render(200, 160);
        let mut gradients = Gradients::new(200, 160);
        gradients.compute(&image.view(), i16::MAX, |_, _, _| {});
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
