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
        self.globals = globals_in_use(equations.has_lenses);
        // What it does not meet (a camera that does not see it, a heading that it does not tell) stays as it is.
        let inverse = std::array::from_fn(|r| 1.0 / self.lower[(r, r)]);
        let mut met = heapless::Vec::<_, { MAX_MOTIONS / LANES }>::new();
        for n in (0..self.globals / LANES).chain(start..end) {
            if self.divide(n, &inverse) {
                let _ = met.push(n);
            }
        }
        let rows = equations.rows.as_chunks_mut::<LANES>().0;
        for (k, &n) in met.iter().enumerate() {
            subtract_products(&mut rows[n], &self.rows, n * LANES, met[k..].iter().copied());
        }
    }

    /// A tile of columns of `W` becomes one of `L⁻¹W`, by the `inverse` of the diagonal; whether any of it is not zero.
    #[inline]
    fn divide(&mut self, n: usize, inverse: &[f64; D]) -> bool {
        let (mut tile, mut is_met) = ([[0.0; LANES]; D], false);
        for (r, row) in self.rows.iter_mut().enumerate() {
            let row = &mut row.as_chunks_mut::<LANES>().0[n];
            let mut x = *row;
            // All of them, without an end at the first: many at a time.
            is_met = x.iter().fold(is_met, |is_met, x| is_met | (*x != 0.0));
            for (s, above) in tile.iter().enumerate().take(r) {
                for k in 0..LANES {
                    x[k] -= self.lower[(r, s)] * above[k];
                }
            }
            x.iter_mut().for_each(|x| *x *= inverse[r]);
            (tile[r], *row) = (x, x);
        }
        is_met
    }
}
