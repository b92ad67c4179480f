//! Elimination of a landmark from the normal equations (Schur complement), and its back-substitution.

use super::dense::NormalEquations;
use super::state::{GLOBAL_DIM, MAX_VISUAL, visual_of_frame};
use nalgebra::{SMatrix, SVector};

/// Most degrees of freedom of a landmark: those of a line.
pub(super) const MAX_LANDMARK_DIM: usize = 4;
/// Memory of an elimination.
pub(super) type Scratch = [[f64; MAX_VISUAL]; MAX_LANDMARK_DIM];

/// What the elimination of a landmark leaves for its back-substitution.
#[derive(Clone, Debug)]
pub struct Eliminated<const D: usize> {
    /// Inverse of the landmark's own block.
    pub(super) inverse: SMatrix<f64, D, D>,
    /// Gradient by the landmark.
    pub(super) gradient: SVector<f64, D>,
    /// Mixed derivatives by the landmark and by rig and poses.
    pub(super) by_visual: [[f64; MAX_VISUAL]; D],
    /// Whether the landmark took part.
    pub is_used: bool,
}

impl<const D: usize> Eliminated<D> {
    pub(super) fn empty() -> Self {
        Self {
            inverse: SMatrix::zeros(),
            gradient: SVector::zeros(),
            by_visual: [[0.0; MAX_VISUAL]; D],
            is_used: false,
        }
    }

    /// The landmark's step, given that of rig and poses (in visual order).
    #[must_use]
    pub fn step(&self, visual: &[f64]) -> SVector<f64, D> {
        let mut rhs = self.gradient;
        for (k, row) in self.by_visual.iter().enumerate() {
            rhs[k] += row.iter().zip(visual).map(|(w, d)| w * d).sum::<f64>();
        }
        -(self.inverse * rhs)
    }
}

/// Schur complement of one landmark: `V -= Y'Y` with `Y = L^-1 W`, over the frames it spans.
pub(super) fn eliminate<const D: usize>(
    visual: &mut NormalEquations,
    entry: &Eliminated<D>,
    l: &SMatrix<f64, D, D>,
    span: (usize, usize),
    y: &mut Scratch,
) {
    let (start, end) = (visual_of_frame(span.0), visual_of_frame(span.1 + 1));
    let mut z = [0.0; D];
    for r in 0..D {
        let inverse = 1.0 / l[(r, r)];
        let (above, row) = y.split_at_mut(r);
        let row = &mut row[0];
        for range in [0..GLOBAL_DIM, start..end] {
            row[range.clone()].copy_from_slice(&entry.by_visual[r][range.clone()]);
            for (s, above) in above.iter().enumerate() {
                let factor = l[(r, s)];
                for (to, from) in row[range.clone()].iter_mut().zip(&above[range.clone()]) {
                    *to -= factor * from;
                }
            }
            row[range].iter_mut().for_each(|to| *to *= inverse);
        }
        z[r] = (entry.gradient[r] - (0..r).map(|s| l[(r, s)] * z[s]).sum::<f64>()) * inverse;
    }
    for i in (0..GLOBAL_DIM).chain(start..end) {
        let column: [f64; D] = std::array::from_fn(|r| y[r][i]);
        let row = visual.row_mut(i);
        for range in [i..GLOBAL_DIM, start.max(i)..end] {
            if range.start < range.end {
                let to = &mut row[range.start - i..range.end - i];
                subtract_products(to, &column, std::array::from_fn(|r| &y[r][range.clone()]));
            }
        }
        visual.gradient_mut()[i] -= column.iter().zip(&z).map(|(y, z)| y * z).sum::<f64>();
    }
}

/// `to -= sum of column[r] * rows[r]`.
fn subtract_products<const D: usize>(to: &mut [f64], column: &[f64; D], rows: [&[f64]; D]) {
    let n = to.len();
    let rows = rows.map(|row| &row[..n]);
    for k in 0..n {
        let mut sum = 0.0;
        for r in 0..D {
            sum += column[r] * rows[r][k];
        }
        to[k] -= sum;
    }
}

#[cfg(test)]
#[path = "eliminate_tests.rs"]
mod tests;
