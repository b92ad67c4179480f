//! Dense symmetric systems in fixed memory: accumulate and eliminate. [`super::factorization`] solves them.
//!
//! The matrix is square, row-major, with a fixed stride; only its upper triangle is read or written.
//! Rows are contiguous, so that the inner loops run over neighbouring memory.

use super::state::{MAX_FRAMES, unknown_of_frame};

/// `H d = -b` with `H` symmetric: the normal equations of a step `d`.
#[derive(Clone, Debug)]
pub struct NormalEquations {
    dim: usize,
    stride: usize,
    h: Vec<f64>,
    b: Vec<f64>,
}

impl NormalEquations {
    /// Room for `capacity` unknowns; all of them free and without information.
    pub fn new(capacity: usize) -> Self {
        Self { dim: 0, stride: capacity, h: vec![0.0; capacity * capacity], b: vec![0.0; capacity] }
    }

    /// Number of unknowns in use.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// Uses `dim` unknowns (at most the capacity), all zero.
    pub fn reset(&mut self, dim: usize) {
        self.dim = 0;
        self.grow(dim);
    }

    /// Appends unknowns without information, up to `dim`.
    pub fn grow(&mut self, dim: usize) {
        assert!(dim <= self.stride, "{dim} unknowns exceed the capacity {}", self.stride);
        let old = self.dim;
        for (i, row) in self.h.chunks_exact_mut(self.stride).take(dim).enumerate() {
            row[i.max(old)..dim].fill(0.0);
        }
        self.b[old..dim].fill(0.0);
        self.dim = dim;
    }

    /// Makes this a copy of `other` (of the same capacity) without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        assert_eq!(self.stride, other.stride);
        let dim = other.dim;
        self.dim = dim;
        for (to, from) in
            self.h.chunks_exact_mut(self.stride).zip(other.h.chunks_exact(self.stride)).take(dim)
        {
            to[..dim].copy_from_slice(&from[..dim]);
        }
        self.b[..dim].copy_from_slice(&other.b[..dim]);
    }

    /// Row `i` from the diagonal to the end.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.h[i * self.stride + i..i * self.stride + self.dim]
    }

    /// Row `i` from the diagonal to the end, to be written.
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.h[i * self.stride + i..i * self.stride + self.dim]
    }

    /// `H[i][j]`, either triangle.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        let (i, j) = if i <= j { (i, j) } else { (j, i) };
        self.h[i * self.stride + j]
    }

    /// Adds to `H[i][j]` (and so to `H[j][i]`).
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        let (i, j) = if i <= j { (i, j) } else { (j, i) };
        self.h[i * self.stride + j] += value;
    }

    /// The gradient `b`.
    pub fn gradient(&self) -> &[f64] {
        &self.b[..self.dim]
    }

    /// The gradient `b`, to be written.
    pub fn gradient_mut(&mut self) -> &mut [f64] {
        &mut self.b[..self.dim]
    }

    /// Adds a dense block at `(row, column)`; on the diagonal only its upper triangle counts.
    pub fn add_block<const R: usize, const C: usize>(
        &mut self,
        row: usize,
        column: usize,
        block: &nalgebra::SMatrix<f64, R, C>,
    ) {
        for i in 0..R {
            for j in if row == column { i } else { 0 }..C {
                self.add(row + i, column + j, block[(i, j)]);
            }
        }
    }

    /// `H x` for a full vector, into `out`.
    pub fn multiply(&self, x: &[f64], out: &mut [f64]) {
        out[..self.dim].fill(0.0);
        for i in 0..self.dim {
            let (row, xi) = (&self.row(i)[1..], x[i]);
            let mut sum = self.row(i)[0] * xi;
            for (h, x) in row.iter().zip(&x[i + 1..]) {
                sum += h * x;
            }
            // A loop of its own, in whole vectors.
            for (out, h) in out[i + 1..].iter_mut().zip(row) {
                *out += h * xi;
            }
            out[i] += sum;
        }
    }

    /// Eliminates the unknowns `range` (Schur complement) and closes the gap they leave. An unknown
    /// without information of its own (pivot at most `floor`) is dropped without effect.
    pub fn eliminate(&mut self, range: std::ops::Range<usize>, floor: f64) {
        self.subtract(range.clone(), floor);
        self.close(range);
    }

    /// Unknown `k` becomes `a (x + offset) - offset`: its distance from `-offset` shrinks by the factor `a`
    /// ([`super::rig_walk`]).
    pub fn shrink(&mut self, k: usize, a: f64, offset: f64) {
        // The old unknown is `x' / a + shift`.
        let shift = offset * (1.0 - a) / a;
        for j in 0..self.dim {
            self.b[j] += self.get(j, k) * shift;
            let (row, column) = if j <= k { (j, k) } else { (k, j) };
            self.h[row * self.stride + column] /= if j == k { a * a } else { a };
        }
        self.b[k] /= a;
    }

    /// Lets unknown `k` walk: an independent error of the `variance` given is added to it. The others stay as well known as
    /// they were, and what ties them to `k` weakens ([`super::rig_walk`]).
    pub fn walk(&mut self, k: usize, variance: f64) {
        let mut column = [0.0; MAX_UNKNOWNS];
        for (j, c) in column.iter_mut().enumerate().take(self.dim) {
            *c = self.get(k, j);
        }
        // Equations that are not positive there have no covariance to add to, and must stay seen as such.
        if column[k] > 0.0 {
            self.subtract_outer(&column, variance / (1.0 + variance * column[k]), self.b[k]);
        }
    }

    /// The Schur complement of the unknowns `range`; what is left in their own rows has no meaning.
    fn subtract(&mut self, range: std::ops::Range<usize>, floor: f64) {
        let mut column = [0.0; MAX_UNKNOWNS];
        for k in range.clone() {
            let pivot = self.get(k, k);
            for (j, c) in column.iter_mut().enumerate().take(self.dim) {
                *c = if range.contains(&j) && j <= k { 0.0 } else { self.get(k, j) };
            }
            if pivot > floor {
                self.subtract_outer(&column, 1.0 / pivot, self.b[k]);
            }
        }
    }

    fn subtract_outer(&mut self, column: &[f64; MAX_UNKNOWNS], inverse_pivot: f64, gradient: f64) {
        for i in 0..self.dim {
            let ci = column[i] * inverse_pivot;
            if ci == 0.0 {
                continue;
            }
            let row = &mut self.h[i * self.stride + i..i * self.stride + self.dim];
            for (h, c) in row.iter_mut().zip(&column[i..self.dim]) {
                *h -= ci * c;
            }
            self.b[i] -= ci * gradient;
        }
    }

    /// Removes the unknowns `range` without any effect on the others.
    fn close(&mut self, range: std::ops::Range<usize>) {
        let gap = range.len();
        let (stride, dim) = (self.stride, self.dim);
        for i in 0..dim - gap {
            let from_row = if i < range.start { i } else { i + gap };
            for j in i..dim - gap {
                let from_column = if j < range.start { j } else { j + gap };
                self.h[i * stride + j] = self.h[from_row * stride + from_column];
            }
            self.b[i] = self.b[from_row];
        }
        self.dim = dim - gap;
    }
}

/// Largest number of unknowns of any system here: rig and [`MAX_FRAMES`] frames.
pub const MAX_UNKNOWNS: usize = unknown_of_frame(MAX_FRAMES);

#[cfg(test)]
pub(super) mod tests {
    use super::super::factorization::tests::solution;
    use super::*;

    /// A well-conditioned symmetric system of `n` unknowns.
    pub(in crate::window) fn system(n: usize) -> NormalEquations {
        let mut eq = NormalEquations::new(n + 3);
        eq.reset(n);
        for i in 0..n {
            for j in i..n {
                eq.add(i, j, 1.0 / (1.0 + (j - i) as f64).powi(2));
            }
            eq.add(i, i, 1.0);
            eq.gradient_mut()[i] = (i as f64).sin();
        }
        eq
    }

    #[test]
    fn elimination_leaves_the_solution_of_the_others_as_it_was() {
        let mut eq = system(12);
        let whole = solution(&eq);
        eq.eliminate(4..7, 1e-12);
        let rest = solution(&eq);
        assert_eq!(eq.dim(), 9);
        for (k, x) in rest.iter().enumerate() {
            assert!((x - whole[if k < 4 { k } else { k + 3 }]).abs() < 1e-12);
        }
    }
}
