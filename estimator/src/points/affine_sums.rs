//! Sums of an affine fit over a patch: `J^T v` and `J^T J` for
//! `J = [gx, gy, gx dx, gx dy, gy dx, gy dy]`, with `dx`, `dy` the offset from the centre over its largest
//! value, so that all unknowns are pixels.
//!
//! `J` is never written down: each product of gradients is summed down its columns with the weights `1`, `dy`
//! and `dy²`, and only the column sums are weighted with `1`, `dx` and `dx²`.

use crate::image::patch::{HALF, Patch, SIDE};
use nalgebra::{SMatrix, SVector};

/// Unknowns: translation, then the warp by rows.
pub(super) const UNKNOWNS: usize = 6;
pub(super) type AffineVector = SVector<f32, UNKNOWNS>;
pub(super) type AffineMatrix = SMatrix<f32, UNKNOWNS, UNKNOWNS>;

/// One value per column of the patch.
type Columns = [f32; SIDE];

/// Offset of a sample from the centre along one axis, 1 at the edge.
const OFFSET: Columns = {
    let mut out = [0.0; SIDE];
    let mut i = 0;
    while i < SIDE {
        out[i] = (i as f32 - HALF) / HALF;
        i += 1;
    }
    out
};

/// Adds up in one fixed order.
fn sum(columns: &Columns) -> f32 {
    let mut lanes = [0.0f32; 4];
    for chunk in columns.as_chunks::<4>().0 {
        for k in 0..4 {
            lanes[k] += chunk[k];
        }
    }
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])
}

/// `columns * dx`.
fn by_offset(columns: &Columns) -> Columns {
    std::array::from_fn(|c| columns[c] * OFFSET[c])
}

/// Columns that are summed together, which the compiler makes one vector (or two).
const WIDTH: usize = 8;

/// `J^T v`.
#[inline(never)]
pub(super) fn products(gx: &Patch, gy: &Patch, v: &Patch) -> AffineVector {
    let mut sums = [[0.0; SIDE]; 4];
    add_up_products::<0>(gx, gy, v, &mut sums);
    add_up_products::<{ SIDE - WIDTH }>(gx, gy, v, &mut sums);
    let [x, x_dy, y, y_dy] = &sums;
    AffineVector::from([sum(x), sum(y), sum(&by_offset(x)), sum(x_dy), sum(&by_offset(y)), sum(y_dy)])
}

/// Column sums from the column `FIRST` on: of `gx v` and of `gy v`, each with the weights 1 and `dy`. Those in the middle are
/// summed twice, to the same bits: 8 and 4 columns would take as many instructions. As in [`crate::image::patch::sums`], the
/// samples of a column are the inner loop.
#[inline(always)]
#[allow(clippy::needless_range_loop)]
fn add_up_products<const FIRST: usize>(gx: &Patch, gy: &Patch, v: &Patch, sums: &mut [Columns; 4]) {
    for c in FIRST..FIRST + WIDTH {
        let mut s = [0.0f32; 4];
        for r in 0..SIDE {
            let i = r * SIDE + c;
            let (x, y) = (gx.0[i] * v.0[i], gy.0[i] * v.0[i]);
            s[0] += x;
            s[1] += x * OFFSET[r];
            s[2] += y;
            s[3] += y * OFFSET[r];
        }
        for j in 0..4 {
            sums[j][c] = s[j];
        }
    }
}

/// Sums of a product of gradients with the weights `1, dx, dy, dx², dx dy, dy²`.
#[inline(never)]
fn second_moments(a: &Patch, b: &Patch) -> [f32; 6] {
    let mut sums = [[0.0; SIDE]; 3];
    add_up_moments::<0>(a, b, &mut sums);
    add_up_moments::<{ SIDE - WIDTH }>(a, b, &mut sums);
    let [one, dy1, dy2] = &sums;
    let dx1 = by_offset(one);
    [sum(one), sum(&dx1), sum(dy1), sum(&by_offset(&dx1)), sum(&by_offset(dy1)), sum(dy2)]
}

/// As [`add_up_products`], of `a b` with the weights 1, `dy` and `dy²`.
#[inline(always)]
#[allow(clippy::needless_range_loop)]
fn add_up_moments<const FIRST: usize>(a: &Patch, b: &Patch, sums: &mut [Columns; 3]) {
    for c in FIRST..FIRST + WIDTH {
        let mut s = [0.0f32; 3];
        for r in 0..SIDE {
            let i = r * SIDE + c;
            let p = a.0[i] * b.0[i];
            let by_dy = p * OFFSET[r];
            s[0] += p;
            s[1] += by_dy;
            s[2] += by_dy * OFFSET[r];
        }
        for j in 0..3 {
            sums[j][c] = s[j];
        }
    }
}

/// `J^T J`.
pub(super) fn gram(gx: &Patch, gy: &Patch) -> AffineMatrix {
    /// Gradient and weight (1, dx or dy) of each unknown.
    const UNKNOWN: [(usize, usize); UNKNOWNS] = [(0, 0), (1, 0), (0, 1), (0, 2), (1, 1), (1, 2)];
    /// Place of the product of two weights in the moments.
    const WEIGHT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
    let moments = [second_moments(gx, gx), second_moments(gx, gy), second_moments(gy, gy)];
    AffineMatrix::from_fn(|i, k| {
        let ((a, u), (b, v)) = (UNKNOWN[i], UNKNOWN[k]);
        moments[a + b][WEIGHT[u][v]]
    })
}
