//! The inverse discrete cosine transform of a block, in whole numbers (T.81, A.3.3).
//!
//! Columns, then rows, eight of them at a time; each splits into an even and an odd half. Constants have 12 bits behind
//! the point, what lies between the passes has 3: the result is at most one off the transform in real numbers.

use super::BLOCK;

/// Bits of the constants behind the point.
const BITS: u32 = 12;
/// Bits behind the point between the passes.
const BETWEEN: u32 = 3;
/// Coefficients of images of 8 bits are within 1024; what is beyond this is damage.
const MAX_COEFFICIENT: i32 = 1 << 12;
/// And no sum between the passes is beyond this.
const MAX_BETWEEN: i32 = (1 << 15) - 1;
/// cos(k pi / 16).
const COS: [i32; 8] = [4096, 4017, 3784, 3406, 2896, 2276, 1567, 799];

/// Place in the block of each coefficient in the order of the data (T.81, figure A.6).
#[rustfmt::skip]
const ZIGZAG: [u8; 64] = [
     0,  1,  8, 16,  9,  2,  3, 10, 17, 24, 32, 25, 18, 11,  4,  5,
    12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13,  6,  7, 14, 21, 28,
    35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51,
    58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
];

/// The coefficients of a block, row by row.
pub(super) struct Block([[i32; BLOCK]; BLOCK]);

impl Default for Block {
    fn default() -> Self {
        Self([[0; BLOCK]; BLOCK])
    }
}

impl Block {
    /// Sets the coefficient that is number `k` in the data, in steps.
    #[inline]
    pub(super) fn set(&mut self, k: usize, steps: i32, step: u16) {
        let place = usize::from(ZIGZAG[k & 63]);
        let value = steps.saturating_mul(step.into()).clamp(-MAX_COEFFICIENT, MAX_COEFFICIENT);
        self.0[place / BLOCK][place % BLOCK] = value;
    }
}

/// Writes the pixels of a block to `out`, rows `stride` apart; `last` is the last coefficient, in the order of the data,
/// that is not 0.
pub(super) fn inverse_dct(block: &Block, last: usize, out: &mut [u8], stride: usize) {
    if last == 0 {
        let level = pixel(block.0[0][0] * (1 << (BITS + BETWEEN - 1)));
        out.chunks_mut(stride).take(BLOCK).for_each(|row| row[..BLOCK].fill(level));
        return;
    }
    let columns = pass(&block.0);
    let between = columns.map(|row| {
        row.map(|sum| {
            let rounded = (sum + (1 << (BITS - BETWEEN - 1))) >> (BITS - BETWEEN);
            rounded.clamp(-MAX_BETWEEN, MAX_BETWEEN)
        })
    });
    let rows = transposed(&pass(&transposed(&between)));
    for (row, out) in rows.iter().zip(out.chunks_mut(stride)) {
        for (sum, pixel_out) in row.iter().zip(&mut out[..BLOCK]) {
            *pixel_out = pixel(*sum);
        }
    }
}

/// A pixel of a sum with `BITS + BETWEEN` bits behind the point, and a quarter to be taken of it.
#[inline]
fn pixel(sum: i32) -> u8 {
    const SHIFT: u32 = BITS + BETWEEN + 2;
    (((sum + (1 << (SHIFT - 1))) >> SHIFT) + 128).clamp(0, 255) as u8
}

fn transposed(rows: &[[i32; BLOCK]; BLOCK]) -> [[i32; BLOCK]; BLOCK] {
    std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i]))
}

/// Twice the one-dimensional transform down all columns, with [`BITS`] more behind the point.
#[inline]
fn pass(x: &[[i32; BLOCK]; BLOCK]) -> [[i32; BLOCK]; BLOCK] {
    let mut out = [[0; BLOCK]; BLOCK];
    for i in 0..BLOCK {
        let sum = (x[0][i] + x[4][i]) * COS[4];
        let difference = (x[0][i] - x[4][i]) * COS[4];
        let turned = x[2][i] * COS[2] + x[6][i] * COS[6];
        let back = x[2][i] * COS[6] - x[6][i] * COS[2];
        let even = [sum + turned, difference + back, difference - back, sum - turned];
        let [a, b, c, d] = [x[1][i], x[3][i], x[5][i], x[7][i]];
        let odd = [
            a * COS[1] + b * COS[3] + c * COS[5] + d * COS[7],
            a * COS[3] - b * COS[7] - c * COS[1] - d * COS[5],
            a * COS[5] - b * COS[1] + c * COS[7] + d * COS[3],
            a * COS[7] - b * COS[5] + c * COS[3] - d * COS[1],
        ];
        for n in 0..4 {
            out[n][i] = even[n] + odd[n];
            out[7 - n][i] = even[n] - odd[n];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// As the standard writes it, in real numbers.
    fn reference(block: &Block) -> [[f64; 8]; 8] {
        let scale = |k: usize| if k == 0 { 0.5f64.sqrt() } else { 1.0 };
        let wave = |n: usize, k: usize| scale(k) * ((2 * n + 1) as f64 * k as f64 * PI / 16.0).cos();
        std::array::from_fn(|y| {
            std::array::from_fn(|x| {
                let sum: f64 =
                    (0..64).map(|p| f64::from(block.0[p / 8][p % 8]) * wave(y, p / 8) * wave(x, p % 8)).sum();
                (sum / 4.0 + 128.0).clamp(0.0, 255.0)
            })
        })
    }

    fn pixels(block: &Block, last: usize) -> [[u8; 8]; 8] {
        let mut out = [0; 8 * 11];
        inverse_dct(block, last, &mut out, 11);
        std::array::from_fn(|y| std::array::from_fn(|x| out[y * 11 + x]))
    }

    proptest! {
        #[test]
        fn pixels_are_those_of_the_real_transform(
            levels in prop::collection::vec((0..64usize, -150..150i32), 0..16), dc in -1024..1016i32,
        ) {
            let mut block = Block::default();
            block.set(0, dc, 1);
            let mut last = 0;
            for (k, level) in levels.into_iter().filter(|(k, _)| *k > 0) {
                block.set(k, level, 1);
                last = last.max(k);
            }
            let (ours, real) = (pixels(&block, last), reference(&block));
            for (ours, real) in ours.as_flattened().iter().zip(real.as_flattened()) {
                prop_assert!((f64::from(*ours) - real).abs() <= 1.0, "{} {}", ours, real);
            }
        }

        #[test]
        fn no_coefficients_are_too_much(levels in prop::collection::vec(any::<i32>(), 64), step in any::<u16>()) {
            let mut block = Block::default();
            for (k, level) in levels.iter().enumerate() {
                block.set(k, *level, step);
            }
            pixels(&block, 63);
        }
    }

    #[test]
    fn a_block_without_detail_is_flat() {
        let mut block = Block::default();
        block.set(0, 10, 16);
        assert_eq!(pixels(&block, 0), [[148; 8]; 8]);
        assert_eq!(pixels(&block, 63), [[148; 8]; 8]);
    }
}
