//! Factorization of dense symmetric systems in fixed memory, their solution, and what it tells of covariances.

use super::dense::{MAX_UNKNOWNS, NormalEquations};
use super::state::{FRAME_DIM, POSE_DIM, RIG_DIM, unknown_of_frame};
use super::tiles::{LANES, add_times, dot, subtract_products};
use nalgebra::SMatrix;

/// Columns of the factor's rows.
const COLUMNS: usize = MAX_UNKNOWNS.next_multiple_of(LANES);

/// `H = U'U` of a damped copy of the normal equations, in fixed memory.
///
/// Velocities and biases of a frame meet those of its neighbours and few poses; what a pivot does not meet costs nothing.
/// So they are factored first, then what meets everything. The newest frame comes last, whole: its covariance is asked for.
#[derive(Clone, Debug)]
pub struct Factor {
    /// Unknowns of the system last factored; 0 before the first, and after one that could not be.
    pub(super) dim: usize,
    u: Vec<[f64; COLUMNS]>,
    /// Unknowns in the order in which they are factored.
    order: Vec<usize>,
    /// Unknowns that are held at zero, and take no part.
    held: std::ops::Range<usize>,
}

impl Factor {
    /// Room for `capacity` unknowns, at most [`MAX_UNKNOWNS`]. Those of `held` stay at zero, whatever the equations say of them.
    pub fn new(capacity: usize, held: std::ops::Range<usize>) -> Self {
        let u = vec![[0.0; COLUMNS]; capacity.next_multiple_of(LANES)];
        Self { dim: 0, u, order: Vec::with_capacity(capacity), held }
    }

    /// Factors `H + damping diag(H)`; unknowns without any information are held at zero. `false` when the
    /// matrix is not positive definite: then nothing is factored, and `dim` is 0.
    pub fn compute(&mut self, equations: &NormalEquations, damping: f64) -> bool {
        self.dim = 0;
        self.load(equations, damping);
        let tiles = self.order.len().div_ceil(LANES);
        let mut met = heapless::Vec::<usize, { COLUMNS / LANES }>::new();
        let mut rest = &mut self.u.as_chunks_mut::<LANES>().0[..tiles];
        while let Some((pivots, below)) = rest.split_first_mut() {
            let n = tiles - below.len() - 1;
            if !factor_pivots(pivots, n * LANES, tiles * LANES) {
                return false;
            }
            met.clear();
            met.extend((n + 1..tiles).filter(|tile| is_met(pivots, *tile)));
            for (k, &tile) in met.iter().enumerate() {
                subtract_products(&mut below[tile - n - 1], pivots, tile * LANES, met[k..].iter().copied());
            }
            rest = below;
        }
        self.dim = equations.dim();
        true
    }

    /// Copies the upper triangle of the damped equations in the order of the factor, filled up to whole tiles with unknowns
    /// that meet no other.
    fn load(&mut self, equations: &NormalEquations, damping: f64) {
        let held = self.held.clone();
        self.order.clear();
        self.order.extend(order_of(equations.dim()).filter(|k| !held.contains(k)));
        let dim = self.order.len();
        let end = dim.next_multiple_of(LANES);
        for (i, row) in self.u[..end].iter_mut().enumerate() {
            row[i / LANES * LANES..end].fill(0.0);
            if let Some(&unknown) = self.order.get(i) {
                for (to, other) in row[i..dim].iter_mut().zip(&self.order[i..]) {
                    *to = equations.get(unknown, *other);
                }
            }
            if row[i] == 0.0 {
                row[i] = 1.0;
            }
            row[i] += damping * row[i];
        }
    }

    /// Unknowns that take part.
    fn factored(&self) -> usize {
        if self.dim == 0 { 0 } else { self.order.len() }
    }

    /// Covariance of the last `N` unknowns, the last block of the inverse of `H`; `None` where there are fewer. It needs
    /// no more than the last corner of the factor: `(U'U)⁻¹` ends in `V V'`, with `V` the inverse of that corner.
    pub fn last_covariance<const N: usize>(&self) -> Option<SMatrix<f64, N, N>> {
        let first = self.factored().checked_sub(N)?;
        let corner = SMatrix::<f64, N, N>::from_fn(|i, j| match i <= j {
            true => self.u[first + i][first + j],
            false => 0.0,
        });
        let inverse = corner.solve_upper_triangular(&SMatrix::<f64, N, N>::identity())?;
        Some(inverse * inverse.transpose())
    }

    /// Variance of unknown `k` (below `dim`); `memory` has room for all unknowns. It is the squared norm of
    /// `U'⁻¹ e_k`.
    pub fn variance(&self, k: usize, memory: &mut [f64]) -> f64 {
        let x = &mut memory[..self.factored()];
        x.fill(0.0);
        let place = self.order.iter().position(|unknown| *unknown == k).unwrap_or(0);
        x[place] = 1.0;
        self.solve_lower(x, place);
        x[place..].iter().map(|x| x * x).sum()
    }

    /// Solves `H x = rhs` in place.
    pub fn solve(&self, x: &mut [f64]) {
        let dim = self.factored();
        let mut memory = [0.0; COLUMNS];
        let y = &mut memory[..dim];
        for (y, unknown) in y.iter_mut().zip(&self.order) {
            *y = x[*unknown];
        }
        self.solve_lower(y, 0);
        for i in (0..dim).rev() {
            let row = &self.u[i];
            // Whole vectors, then what is left of them at either end.
            let first = (i + 1).next_multiple_of(LANES).min(dim);
            let last = (dim / LANES * LANES).max(first);
            let mut sum = dot(&row[first..last], &y[first..last]);
            for j in (i + 1..first).chain(last..dim) {
                sum += row[j] * y[j];
            }
            y[i] = (y[i] - sum) / row[i];
        }
        let end = self.held.end.min(x.len());
        if self.held.start < end {
            x[self.held.start..end].fill(0.0);
        }
        for (y, unknown) in y.iter().zip(&self.order) {
            x[*unknown] = *y;
        }
    }

    /// Solves `U' x = rhs` in place, where `rhs` is zero before `first`.
    fn solve_lower(&self, x: &mut [f64], first: usize) {
        let dim = self.factored();
        for i in first..dim {
            let row = &self.u[i][..dim];
            x[i] /= row[i];
            let xi = x[i];
            if xi != 0.0 {
                for (x, u) in x[i + 1..dim].iter_mut().zip(&row[i + 1..]) {
                    *x -= u * xi;
                }
            }
        }
    }
}

/// Unknowns in the order in which they are factored; the last frame's come last. What is no window of frames keeps its order.
fn order_of(dim: usize) -> impl Iterator<Item = usize> {
    let frames = dim.saturating_sub(RIG_DIM) / FRAME_DIM;
    let before = if dim == unknown_of_frame(frames) { frames.saturating_sub(1) } else { 0 };
    let parts =
        |from: usize, to: usize| (0..before).map(unknown_of_frame).flat_map(move |at| at + from..at + to);
    let moving = parts(POSE_DIM, FRAME_DIM);
    moving.chain(0..RIG_DIM.min(dim)).chain(parts(0, POSE_DIM)).chain(unknown_of_frame(before)..dim)
}

/// True if four pivots meet a tile of columns.
fn is_met(pivots: &[[f64; COLUMNS]; LANES], tile: usize) -> bool {
    pivots.iter().any(|row| row.as_chunks::<LANES>().0[tile] != [0.0; LANES])
}

/// Makes four rows of `H`, from row `at`, those of the factor; `false` where a pivot is not positive.
fn factor_pivots(rows: &mut [[f64; COLUMNS]; LANES], at: usize, end: usize) -> bool {
    for r in 0..LANES {
        let (above, row) = rows.split_at_mut(r);
        let row = &mut row[0][at..end];
        for above in above {
            add_times(row, -above[at + r], &above[at..end]);
        }
        let pivot = row[r];
        // A NaN pivot must fail as well.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let scale = 1.0 / pivot.sqrt();
        for x in row {
            *x *= scale;
        }
    }
    true
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::dense::tests::system;
    use super::*;

    pub(in crate::window) fn solution(eq: &NormalEquations) -> Vec<f64> {
        let mut factor = Factor::new(eq.dim(), 0..0);
        assert!(factor.compute(eq, 0.0));
        let mut x: Vec<f64> = eq.gradient().iter().map(|b| -b).collect();
        factor.solve(&mut x);
        x
    }

    #[test]
    fn an_indefinite_matrix_is_a_value_not_a_panic() {
        let mut eq = system(5);
        eq.add(2, 2, -10.0);
        assert!(!Factor::new(8, 0..0).compute(&eq, 0.0));
        eq.add(2, 2, f64::NAN);
        assert!(!Factor::new(8, 0..0).compute(&eq, 0.0));
    }

    #[test]
    fn unknowns_without_information_stay_at_zero() {
        let mut eq = system(5);
        eq.grow(8);
        let x = solution(&eq);
        assert_eq!(&x[5..], &[0.0; 3]);
    }
}
