//! Vectors of three components in four lanes, the last of them without meaning: what is done for each observation is done in
//! whole vectors. Sums are made in the order in which nalgebra makes them.

use nalgebra::{Matrix3, Vector3};

/// A vector of three components and one lane more.
pub(super) type Quad = [f64; 4];

/// The vector with nothing in the last lane.
#[inline(always)]
pub(super) fn quad(v: &Vector3<f64>) -> Quad {
    [v.x, v.y, v.z, 0.0]
}

/// Rotations by a matrix and by its transpose.
#[derive(Clone, Debug)]
pub(super) struct QuadMatrix {
    columns: [Quad; 3],
    rows: [Quad; 3],
}

impl QuadMatrix {
    /// Columns and rows of `matrix`.
    pub(super) fn of(matrix: &Matrix3<f64>) -> Self {
        let column = |k: usize| [matrix[(0, k)], matrix[(1, k)], matrix[(2, k)], 0.0];
        let row = |k: usize| [matrix[(k, 0)], matrix[(k, 1)], matrix[(k, 2)], 0.0];
        Self { columns: [0, 1, 2].map(column), rows: [0, 1, 2].map(row) }
    }

    /// The matrix times `v`.
    #[inline(always)]
    pub(super) fn times(&self, v: &Quad) -> Quad {
        combined(&self.columns, v)
    }

    /// Its transpose times `v`.
    #[inline(always)]
    pub(super) fn transpose_times(&self, v: &Quad) -> Quad {
        combined(&self.rows, v)
    }
}

#[inline(always)]
fn combined(parts: &[Quad; 3], v: &Quad) -> Quad {
    let mut sum = [0.0; 4];
    for k in 0..4 {
        sum[k] = parts[0][k] * v[0] + parts[1][k] * v[1] + parts[2][k] * v[2];
    }
    sum
}

/// `a x b`.
#[inline(always)]
pub(super) fn cross(a: &Quad, b: &Quad) -> Quad {
    let turned = |v: &Quad| [v[1], v[2], v[0], v[3]];
    let (a_next, b_next) = (turned(a), turned(b));
    let mut out = [0.0; 4];
    for k in 0..4 {
        // In the order z, x, y: one turn less.
        out[k] = a[k] * b_next[k] - a_next[k] * b[k];
    }
    turned(&out)
}

/// `v s`.
#[inline(always)]
pub(super) fn scaled(v: &Quad, s: f64) -> Quad {
    v.map(|x| x * s)
}

/// `a b`.
#[inline(always)]
pub(super) fn dot3(a: &Quad, b: &Quad) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
