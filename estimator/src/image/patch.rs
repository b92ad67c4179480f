//! Square patches sampled by bilinear interpolation, and sums over them.
//!
//! A patch has [`SIDE`] x [`SIDE`] samples one pixel apart, symmetric about its centre (which lies between
//! the middle samples). Sums run in 16 independent lanes that are added up in one fixed order, so the
//! compiler may use vector registers of any width and the bits stay the same.

use super::Plane;
use nalgebra::{Matrix2, Vector2};
use plumbline_config::Portable;

/// Samples along a side of a patch: wide enough for an affine fit, small enough to lie on one surface;
/// `SIDE * SIDE` is a multiple of [`LANES`].
pub const SIDE: usize = 12;
/// Samples of a patch.
pub const AREA: usize = SIDE * SIDE;
/// Side of a patch with a rim of one sample, from which central differences are taken.
pub const FRAMED: usize = SIDE + 2;
/// Distance of the outermost samples from the centre, px.
pub const HALF: f32 = (SIDE as f32 - 1.0) / 2.0;
/// Independent lanes of a sum: two AVX2 registers, so that additions overlap.
pub const LANES: usize = 16;

/// Samples of a patch, row by row.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub struct Patch(pub [f32; AREA]);

impl Patch {
    /// All samples zero.
    pub const ZERO: Self = Self([0.0; AREA]);

    /// `sum_i self_i * other_i`.
    #[inline(never)]
    pub fn dot(&self, other: &Self) -> f32 {
        let [sum] = sums(|i| [self.0[i] * other.0[i]]);
        sum
    }

    /// `sum_i self_i`.
    #[inline(never)]
    pub fn sum(&self) -> f32 {
        let [sum] = sums(|i| [self.0[i]]);
        sum
    }

    /// Becomes the part of a square of samples that begins at a column and a row.
    pub fn cut<const N: usize>(&mut self, samples: &[[f32; N]; N], [column, row]: [usize; 2]) {
        for (to, from) in self.rows_mut().iter_mut().zip(&samples[row..row + SIDE]) {
            to.copy_from_slice(&from[column..][..SIDE]);
        }
    }

    /// Takes the mean out, and returns it.
    pub fn centre(&mut self) -> f32 {
        let mean = self.sum() * (1.0 / AREA as f32);
        self.0.iter_mut().for_each(|x| *x -= mean);
        mean
    }

    /// Rows, to be written.
    fn rows_mut(&mut self) -> &mut [[f32; SIDE]] {
        self.0.as_chunks_mut::<SIDE>().0
    }
}

/// Sums of `K` values of a sample over all samples, in [`LANES`] lanes. The samples of one lane are summed in the inner loop,
/// so that the compiler unrolls it and makes a vector of several lanes; with the lanes inside, it takes the sums apart. Its
/// callers are not inlined: this must not depend on what stands around it.
#[inline(always)]
#[allow(clippy::needless_range_loop)]
pub fn sums<const K: usize>(values: impl Fn(usize) -> [f32; K]) -> [f32; K] {
    let mut lanes = [[0.0f32; LANES]; K];
    for k in 0..LANES {
        let mut sums = [0.0f32; K];
        for i in 0..AREA / LANES {
            let values = values(i * LANES + k);
            for j in 0..K {
                sums[j] += values[j];
            }
        }
        for j in 0..K {
            lanes[j][k] = sums[j];
        }
    }
    lanes.map(sum_lanes)
}

/// Adds the lanes up pairwise: one fixed order.
fn sum_lanes(lanes: [f32; LANES]) -> f32 {
    let mut eight = [0.0f32; LANES / 2];
    for k in 0..LANES / 2 {
        eight[k] = lanes[k] + lanes[k + LANES / 2];
    }
    let four = [eight[0] + eight[4], eight[1] + eight[5], eight[2] + eight[6], eight[3] + eight[7]];
    (four[0] + four[2]) + (four[1] + four[3])
}

/// Values of a row that are worked out together, needed or not: two AVX2 registers.
const WIDE: usize = 16;
/// Lines whose neighbours are read before any of them is blended.
const BLOCK: usize = 4;

/// Samples an upright `N` x `N` grid of pixel distance, `N <= 16`, centred at `centre` (image coordinates of
/// the plane), less `level`; `false` when it leaves the plane.
pub fn sample_upright<const N: usize>(
    plane: &Plane<'_>,
    centre: &Vector2<f32>,
    level: f32,
    out: &mut [[f32; N]; N],
) -> bool {
    let shift = plane.origin as f32 - (N as f32 - 1.0) / 2.0;
    let (x, y) = (centre.x + shift, centre.y + shift);
    // Written so that a NaN fails.
    let inside = x >= 0.0
        && y >= 0.0
        && x + WIDE.max(N) as f32 + 1.0 < plane.columns as f32
        && y + (N as f32) < plane.rows as f32;
    if !inside {
        return false;
    }
    let (column, row) = (whole(x), whole(y));
    let (fx, fy) = (x - column as f32, y - row as f32);
    let from = row as usize * plane.columns + column as usize;
    let row = |k: usize| &plane.pixels[from + k * plane.columns..][..=N];
    let mut above: [f32; N] = interpolated(row(0), fx);
    for (k, line) in out.iter_mut().enumerate() {
        let below = interpolated(row(k + 1), fx);
        for i in 0..N {
            line[i] = above[i] + fy * (below[i] - above[i]) - level;
        }
        above = below;
    }
    true
}

/// Values between neighbours of a row.
#[inline(always)]
fn interpolated<const N: usize>(row: &[u8], fx: f32) -> [f32; N] {
    let mut out = [0.0; N];
    for i in 0..N {
        let a = f32::from(row[i]);
        out[i] = a + fx * (f32::from(row[i + 1]) - a);
    }
    out
}

/// As [`sample_upright`], with the grid's offsets `d` from the centre taken to the offsets `warp * d`.
pub fn sample_warped<const N: usize>(
    plane: &Plane<'_>,
    centre: &Vector2<f32>,
    warp: &Matrix2<f32>,
    out: &mut [[f32; N]; N],
) -> bool {
    const { assert!(N <= WIDE) };
    let half = (N as f32 - 1.0) / 2.0;
    let (x, y) = (centre.x + plane.origin as f32, centre.y + plane.origin as f32);
    let reach_x = half * (warp[(0, 0)].abs() + warp[(0, 1)].abs());
    let reach_y = half * (warp[(1, 0)].abs() + warp[(1, 1)].abs());
    // One pixel for the interpolation and a hair for its rounding.
    let inside = x >= reach_x
        && y >= reach_y
        && x + reach_x + 1.01 < plane.columns as f32
        && y + reach_y + 1.01 < plane.rows as f32;
    if !inside {
        return false;
    }
    // Neighbours are written one by one and read together: what is read at once after it was written would be waited for.
    let mut lines = [Line::EMPTY; BLOCK];
    for (block, out) in out.chunks_mut(BLOCK).enumerate() {
        for (k, line) in lines.iter_mut().enumerate().take(out.len()) {
            let dy = (block * BLOCK + k) as f32 - half;
            let middle = [x + warp[(0, 1)] * dy, y + warp[(1, 1)] * dy];
            line.read::<N>(plane, middle, [warp[(0, 0)], warp[(1, 0)]]);
        }
        for (line, out) in lines.iter().zip(out) {
            line.blend(out);
        }
    }
    true
}

/// The whole part of a coordinate from 0 to 2²², as the conversion of the language gives it. That one takes care of all other
/// numbers too, one lane at a time.
#[inline(always)]
pub(crate) fn whole(x: f32) -> i32 {
    /// From here on the numbers of 24 bits are the whole ones.
    const WHOLE: f32 = (1 << 23) as f32;
    ((x.floor() + WHOLE).to_bits() & 0x7F_FFFF) as i32
}

/// Samples along a line: of each the neighbours above and below, the left one in the low byte, and the place between them.
#[derive(Clone, Copy)]
struct Line {
    above: [u16; WIDE],
    below: [u16; WIDE],
    fx: [f32; WIDE],
    fy: [f32; WIDE],
}

impl Line {
    const EMPTY: Self = Self { above: [0; WIDE], below: [0; WIDE], fx: [0.0; WIDE], fy: [0.0; WIDE] };

    /// Reads `N` samples along a line through `middle` (plane coordinates) in steps of `step`.
    #[inline(always)]
    fn read<const N: usize>(&mut self, plane: &Plane<'_>, middle: [f32; 2], step: [f32; 2]) {
        let half = (N as f32 - 1.0) / 2.0;
        let mut start = [0u32; WIDE];
        for (i, start) in start.iter_mut().enumerate() {
            let d = i as f32 - half;
            let (x, y) = ((middle[0] + step[0] * d).at_least(0.0), (middle[1] + step[1] * d).at_least(0.0));
            let (column, row) = (whole(x), whole(y));
            (self.fx[i], self.fy[i]) = (x - column as f32, y - row as f32);
            *start = row as u32 * plane.columns as u32 + column as u32;
        }
        // Two neighbours in one load each.
        let under = &plane.pixels[plane.columns..];
        let over = &plane.pixels[..under.len()];
        for (i, start) in start.iter().enumerate().take(N) {
            let pair = *start as usize..*start as usize + 2;
            let (over, under) = (&over[pair.clone()], &under[pair]);
            self.above[i] = u16::from_le_bytes([over[0], over[1]]);
            self.below[i] = u16::from_le_bytes([under[0], under[1]]);
        }
    }

    /// Interpolates.
    #[inline(always)]
    fn blend<const N: usize>(&self, out: &mut [f32; N]) {
        let mut all = [0.0; WIDE];
        for (i, blended) in all.iter_mut().enumerate() {
            let between = |pair: u16| {
                let left = (pair & 0xFF) as f32;
                left + self.fx[i] * ((pair >> 8) as f32 - left)
            };
            let (top, bottom) = (between(self.above[i]), between(self.below[i]));
            *blended = top + self.fy[i] * (bottom - top);
        }
        out.copy_from_slice(&all[..N]);
    }
}

/// Samples a patch upright, less `level`; `false` when it leaves the plane.
pub fn sample_patch(plane: &Plane<'_>, centre: &Vector2<f32>, level: f32, out: &mut Patch) -> bool {
    out.rows_mut().first_chunk_mut::<SIDE>().is_some_and(|rows| sample_upright(plane, centre, level, rows))
}

/// The inner patch of a framed one, and its gradient by central differences (grey levels per px).
pub fn split_framed(framed: &[[f32; FRAMED]; FRAMED], intensity: &mut Patch, gradient: [&mut Patch; 2]) {
    let [gx, gy] = gradient.map(Patch::rows_mut);
    for (r, intensity) in intensity.rows_mut().iter_mut().enumerate() {
        let (above, row, below) = (&framed[r], &framed[r + 1], &framed[r + 2]);
        intensity.copy_from_slice(&row[1..=SIDE]);
        for c in 0..SIDE {
            gx[r][c] = 0.5 * (row[c + 2] - row[c]);
        }
        for c in 0..SIDE {
            gy[r][c] = 0.5 * (below[c + 1] - above[c + 1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Pyramid, synthetic::Texture};

    #[test]
    fn both_samplers_agree_and_meet_the_texture() {
        let texture = Texture::new(3);
        let mut pyramid = Pyramid::new(120, 90, 1);
        assert!(pyramid.build(&texture.render(120, 90).view()));
        let plane = pyramid.plane(0);
        let centre = Vector2::new(50.3, 41.8);
        let (mut upright, mut warped) = ([[0.0; SIDE]; SIDE], [[0.0; SIDE]; SIDE]);
        assert!(sample_upright(&plane, &centre, 0.0, &mut upright));
        assert!(sample_warped(&plane, &centre, &Matrix2::identity(), &mut warped));
        for (r, (a, b)) in upright.iter().zip(&warped).enumerate() {
            for c in 0..SIDE {
                let truth =
                    texture.at(f64::from(centre.x + c as f32 - HALF), f64::from(centre.y + r as f32 - HALF));
                assert!((a[c] - b[c]).abs() < 1e-2, "{} {}", a[c], b[c]);
                // Rounding to 8 bits and the curvature of the texture.
                assert!((f64::from(a[c]) - truth).abs() < 3.0, "{} {truth}", a[c]);
            }
        }
    }

    #[test]
    fn leaving_the_plane_is_reported() {
        let mut pyramid = Pyramid::new(64, 64, 1);
        assert!(pyramid.build(&Texture::new(3).render(64, 64).view()));
        let plane = pyramid.plane(0);
        let mut patch = Patch::ZERO;
        for bad in [f32::NAN, f32::INFINITY, -20.0, 90.0, 1e30, f32::NEG_INFINITY] {
            assert!(!sample_patch(&plane, &Vector2::new(bad, 30.0), 0.0, &mut patch));
            assert!(!sample_patch(&plane, &Vector2::new(30.0, bad), 0.0, &mut patch));
            let mut rows = [[0.0; SIDE]; SIDE];
            assert!(!sample_warped(&plane, &Vector2::new(30.0, bad), &Matrix2::identity(), &mut rows));
            assert!(!sample_warped(
                &plane,
                &Vector2::new(30.0, 30.0),
                &Matrix2::from_element(bad),
                &mut rows
            ));
        }
        assert!(sample_patch(&plane, &Vector2::new(-9.0, 72.0), 0.0, &mut patch));
    }
}
