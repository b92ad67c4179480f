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

fn row(patch: &Patch, r: usize) -> &Columns {
    &patch.0.as_chunks::<SIDE>().0[r]
}

/// Adds the products of two rows, with the weights 1 and `dy`. A function of its own, whose sums lie in memory: where they
/// are many values in registers, the compiler takes them one by one.
#[inline(never)]
fn add_weighted([one, by_dy]: [&mut Columns; 2], a: &Columns, b: &Columns, dy: f32) {
    let mut p = [0.0; SIDE];
    for c in 0..SIDE {
        p[c] = a[c] * b[c];
    }
    for c in 0..SIDE {
        one[c] += p[c];
    }
    for c in 0..SIDE {
        by_dy[c] += p[c] * dy;
    }
}

/// `J^T v`.
pub(super) fn products(gx: &Patch, gy: &Patch, v: &Patch) -> AffineVector {
    let (mut x, mut x_dy) = ([0.0f32; SIDE], [0.0f32; SIDE]);
    let (mut y, mut y_dy) = ([0.0f32; SIDE], [0.0f32; SIDE]);
    for (r, dy) in OFFSET.iter().enumerate() {
        let v = row(v, r);
        add_weighted([&mut x, &mut x_dy], row(gx, r), v, *dy);
        add_weighted([&mut y, &mut y_dy], row(gy, r), v, *dy);
    }
    AffineVector::from([sum(&x), sum(&y), sum(&by_offset(&x)), sum(&x_dy), sum(&by_offset(&y)), sum(&y_dy)])
}

/// As [`add_weighted`], with the weights 1, `dy` and `dy²`.
#[inline(never)]
fn add_moments([one, dy1, dy2]: [&mut Columns; 3], a: &Columns, b: &Columns, dy: f32) {
    let mut p = [0.0; SIDE];
    for c in 0..SIDE {
        p[c] = a[c] * b[c];
    }
    for c in 0..SIDE {
        one[c] += p[c];
    }
    p.iter_mut().for_each(|p| *p *= dy);
    for c in 0..SIDE {
        dy1[c] += p[c];
    }
    for c in 0..SIDE {
        dy2[c] += p[c] * dy;
    }
}

/// Sums of a product of gradients with the weights `1, dx, dy, dx², dx dy, dy²`.
fn second_moments(a: &Patch, b: &Patch) -> [f32; 6] {
    let (mut one, mut dy1, mut dy2) = ([0.0f32; SIDE], [0.0f32; SIDE], [0.0f32; SIDE]);
    for (r, dy) in OFFSET.iter().enumerate() {
        add_moments([&mut one, &mut dy1, &mut dy2], row(a, r), row(b, r), *dy);
    }
    let dx1 = by_offset(&one);
    [sum(&one), sum(&dx1), sum(&dy1), sum(&by_offset(&dx1)), sum(&by_offset(&dy1)), sum(&dy2)]
}

/// `J^T J`.
pub(super) fn gram(gx: &Patch, gy: &Patch) -> AffineMatrix {
    /// Which gradient an unknown belongs to, and its weight: 1, dx or dy.
    const UNKNOWN: [(usize, usize); UNKNOWNS] = [(0, 0), (1, 0), (0, 1), (0, 2), (1, 1), (1, 2)];
    /// Place of the product of two weights in the moments.
    const WEIGHT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
    let moments = [second_moments(gx, gx), second_moments(gx, gy), second_moments(gy, gy)];
    AffineMatrix::from_fn(|i, k| {
        let ((a, u), (b, v)) = (UNKNOWN[i], UNKNOWN[k]);
        moments[a + b][WEIGHT[u][v]]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::patch::AREA;
    use crate::image::synthetic::Random;

    #[test]
    fn the_sums_are_those_of_the_written_out_jacobian() {
        let mut random = Random(4);
        let mut patch = || Patch(std::array::from_fn(|_| random.range(-20.0, 20.0) as f32));
        let (gx, gy, v) = (patch(), patch(), patch());
        let jacobian = |i: usize| {
            let (dx, dy) = (OFFSET[i % SIDE], OFFSET[i / SIDE]);
            let (x, y) = (gx.0[i], gy.0[i]);
            AffineVector::from([x, y, x * dx, x * dy, y * dx, y * dy])
        };
        let expected: AffineVector = (0..AREA).map(|i| jacobian(i) * v.0[i]).sum();
        assert!((products(&gx, &gy, &v) - expected).amax() < 0.05);
        let expected: AffineMatrix = (0..AREA).map(|i| jacobian(i) * jacobian(i).transpose()).sum();
        assert!((gram(&gx, &gy) - expected).amax() < 0.05);
    }
}
