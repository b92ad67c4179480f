//! Elimination of a landmark from the normal equations (Schur complement), and its back-substitution.

use super::motions::{GLOBALS, MAX_MOTIONS, MotionEquations, MotionRow, globals_in_use, motion_of_frame};
use super::tiles::{LANES, dot, subtract_products};
use nalgebra::{SMatrix, SVector};

/// Most degrees of freedom of a landmark: those of a line.
pub(super) const MAX_LANDMARK_DIM: usize = 4;

/// Remains of a landmark's elimination, for its back-substitution.
#[derive(Clone, Debug)]
pub struct Eliminated<const D: usize> {
    /// Factor `L` of the landmark's own block `LL'`.
    lower: SMatrix<f64, D, D>,
    /// `W`, the mixed derivatives by the landmark and by the motions, with the gradient in the column of the residual; once
    /// it is eliminated `L⁻¹W`.
    pub(super) rows: [MotionRow; D],
    /// The columns in use of the frames that see it.
    frames: (usize, usize),
    /// Columns in use before those of the frames.
    globals: usize,
    /// True if the landmark took part.
    pub is_used: bool,
}

impl<const D: usize> Eliminated<D> {
    pub(super) fn empty() -> Self {
        let rows = [[0.0; MAX_MOTIONS]; D];
        Self { lower: SMatrix::zeros(), rows, frames: (GLOBALS, GLOBALS), globals: GLOBALS, is_used: false }
    }

    /// Starts anew, with `dim` columns.
    pub(super) fn reset(&mut self, dim: usize) {
        self.is_used = false;
        for row in &mut self.rows {
            row[GLOBALS..dim.next_multiple_of(LANES)].fill(0.0);
        }
    }

    /// The landmark's step, given those of the motions, with a one for the residual.
    #[must_use]
    pub fn step(&self, motions: &MotionRow) -> SVector<f64, D> {
        let ((start, end), globals) = (self.frames, self.globals);
        let mut x = SVector::<f64, D>::zeros();
        for (x, row) in x.iter_mut().zip(&self.rows) {
            *x = -(dot(&row[..globals], &motions[..globals]) + dot(&row[start..end], &motions[start..end]));
        }
        for k in (0..D).rev() {
            for i in k + 1..D {
                x[k] -= self.lower[(i, k)] * x[i];
            }
            x[k] /= self.lower[(k, k)];
        }
        x
    }

    /// Eliminates a landmark of the frames `first` to `last` whose mixed derivatives have been summed, and whose own block
    /// is `own`: `V -= Y'Y` with `Y = L⁻¹W`. Without effect where the block is not positive definite.
    pub(super) fn eliminate(
        &mut self,
        equations: &mut MotionEquations,
        own: SMatrix<f64, D, D>,
        (first, last): (usize, usize),
    ) {
        let Some(cholesky) = own.cholesky() else { return };
        self.is_used = true;
        self.lower = cholesky.l();
        let (start, end) = (motion_of_frame(first) / LANES, motion_of_frame(last + 1).div_ceil(LANES));
        self.frames = (start * LANES, end * LANES);
        self.globals = globals_in_use(equations.has_lenses());
        self.divide(start, end);
        let globals = self.globals / LANES;
        let rows = equations.rows.as_chunks_mut::<LANES>().0;
        for (n, to) in rows[..globals].iter_mut().enumerate() {
            subtract_products(to, &self.rows, n * LANES, (n..globals).chain(start..end));
        }
        for (n, to) in rows[..end].iter_mut().enumerate().skip(start) {
            subtract_products(to, &self.rows, n * LANES, n..end);
        }
    }

    /// `W` becomes `L⁻¹W`, in the tiles of the globals and those from `start` to `end`.
    fn divide(&mut self, start: usize, end: usize) {
        let inverse: [f64; D] = std::array::from_fn(|r| 1.0 / self.lower[(r, r)]);
        for n in (0..self.globals / LANES).chain(start..end) {
            let mut tile = [[0.0; LANES]; D];
            for (r, row) in self.rows.iter_mut().enumerate() {
                let row = &mut row.as_chunks_mut::<LANES>().0[n];
                tile[r] = *row;
                for s in 0..r {
                    let before = tile[s];
                    for (value, before) in tile[r].iter_mut().zip(before) {
                        *value -= self.lower[(r, s)] * before;
                    }
                }
                for value in &mut tile[r] {
                    *value *= inverse[r];
                }
                *row = tile[r];
            }
        }
    }
}

#[cfg(test)]
#[path = "eliminate_tests.rs"]
mod tests;
