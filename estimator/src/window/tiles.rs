//! Products of rows, subtracted from a symmetric matrix in tiles of four by four: what eliminating landmarks and
//! factoring have in common, and most of the time of both.

/// Rows and columns of a tile.
pub(super) const LANES: usize = 4;

/// `to -= Y'Y` for the four rows of a matrix that begin at row `at` (a multiple of four), in the tiles of columns given. Sums over
/// the rows of `Y` are made in their order.
#[inline]
pub(super) fn subtract_products<const D: usize, const N: usize>(
    to: &mut [[f64; N]; LANES],
    y: &[[f64; N]; D],
    at: usize,
    tiles: impl Iterator<Item = usize>,
) {
    let [a, b, c, d] = to.each_mut().map(|row| row.as_chunks_mut::<LANES>().0);
    let y = y.each_ref().map(|row| row.as_chunks::<LANES>().0);
    // By a negated factor the sum is added: one instruction less, the same bits.
    let factors = y.map(|row| row[at / LANES].map(|x| -x));
    for n in tiles {
        let from = y.map(|row| row[n]);
        add_sum(&mut a[n], &factors, &from, 0);
        add_sum(&mut b[n], &factors, &from, 1);
        add_sum(&mut c[n], &factors, &from, 2);
        add_sum(&mut d[n], &factors, &from, 3);
    }
}

/// `to += sum of factors[r][lane] * from[r]`.
#[inline(always)]
fn add_sum<const D: usize>(
    to: &mut [f64; LANES],
    factors: &[[f64; LANES]; D],
    from: &[[f64; LANES]; D],
    lane: usize,
) {
    let mut sum = from[0].map(|x| factors[0][lane] * x);
    for r in 1..D {
        for k in 0..LANES {
            sum[k] += factors[r][lane] * from[r][k];
        }
    }
    for k in 0..LANES {
        to[k] += sum[k];
    }
}

/// `to += factor * from`, for rows of whole vectors.
#[inline]
pub(super) fn add_times(to: &mut [f64], factor: f64, from: &[f64]) {
    let from = from.as_chunks::<LANES>().0;
    for (to, from) in to.as_chunks_mut::<LANES>().0.iter_mut().zip(from) {
        for k in 0..LANES {
            to[k] += factor * from[k];
        }
    }
}

/// Scalar product of rows of whole vectors, summed in lanes.
#[inline]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}
