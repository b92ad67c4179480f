//! Uniform quintic B-splines (order 6, four continuous derivatives), fitted by least squares.
//!
//! With knots `h` apart, the value on segment `i` at `u = (t - t0) / h - i` is
//! `sum_j N_j(u) c_{i+j}`, `j = 0..6`. The fit minimizes the squared distance to the samples plus a
//! small weight on third differences of the coefficients, which bridges gaps in the samples with a
//! curve of little jerk. The normal equations have half-bandwidth 5 and are solved by banded LDL'.

use plumbline_config::Portable;

/// Coefficients that act on one segment.
pub(super) const ORDER: usize = 6;
/// Weight of the third differences against one sample per segment: small enough not to bend the
/// curve within what 200 Hz samples resolve, large enough to keep a gap solvable.
const THIRD_DIFFERENCE_WEIGHT: f64 = 1e-4;

/// The basis functions times 120, by powers of `u`.
const BASIS: [[f64; 6]; ORDER] = [
    [1.0, -5.0, 10.0, -10.0, 5.0, -1.0],
    [26.0, -50.0, 20.0, 20.0, -20.0, 5.0],
    [66.0, 0.0, -60.0, 0.0, 30.0, -10.0],
    [26.0, 50.0, 20.0, -20.0, -20.0, 10.0],
    [1.0, 5.0, 10.0, 10.0, 5.0, -5.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
];

/// The six weights at `u`, with first and second derivative by `u`.
fn weights(u: f64) -> [[f64; ORDER]; 3] {
    let mut all = [[0.0; ORDER]; 3];
    for (j, a) in BASIS.iter().enumerate() {
        let value = a[0] + u * (a[1] + u * (a[2] + u * (a[3] + u * (a[4] + u * a[5]))));
        let first = a[1] + u * (2.0 * a[2] + u * (3.0 * a[3] + u * (4.0 * a[4] + u * 5.0 * a[5])));
        let second = 2.0 * a[2] + u * (6.0 * a[3] + u * (12.0 * a[4] + u * 20.0 * a[5]));
        all[0][j] = value / 120.0;
        all[1][j] = first / 120.0;
        all[2][j] = second / 120.0;
    }
    all
}

/// A curve in `D` dimensions over `[0, end_s]`.
#[derive(Clone, Debug)]
pub(super) struct Spline<const D: usize> {
    step_s: f64,
    end_s: f64,
    coefficients: Vec<[f64; D]>,
}

/// Value and first two derivatives by time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet<const D: usize> {
    pub(super) value: [f64; D],
    pub(super) first: [f64; D],
    pub(super) second: [f64; D],
}

impl<const D: usize> Spline<D> {
    /// The smoothest curve near `samples` (times in `[0, end_s]`), knots about `step_s` apart.
    pub(super) fn fit(samples: &[(f64, [f64; D])], end_s: f64, step_s: f64) -> Self {
        let segments = (end_s / step_s).ceil().at_least(1.0) as usize;
        let step_s = end_s / segments as f64;
        let mut system = Banded::new(segments + ORDER - 1);
        for (t, value) in samples {
            let (segment, u) = locate(*t, step_s, segments);
            system.add(segment, &weights(u)[0], value, 1.0);
        }
        let weight = THIRD_DIFFERENCE_WEIGHT * samples.len() as f64 / segments as f64;
        for i in 0..segments + ORDER - 4 {
            system.add(i, &[-1.0, 3.0, -3.0, 1.0], &[0.0; D], weight);
        }
        Self { step_s, end_s, coefficients: system.solve() }
    }

    /// The curve at `t_s`, held within its ends.
    pub(super) fn jet(&self, t_s: f64) -> Jet<D> {
        let segments = self.coefficients.len() + 1 - ORDER;
        let (segment, u) = locate(t_s.clamp(0.0, self.end_s), self.step_s, segments);
        let by_order = weights(u);
        let mut out = [[0.0; D]; 3];
        for (j, c) in self.coefficients[segment..segment + ORDER].iter().enumerate() {
            for (row, w) in out.iter_mut().zip(&by_order) {
                for (o, c) in row.iter_mut().zip(c) {
                    *o += w[j] * c;
                }
            }
        }
        let h = 1.0 / self.step_s;
        Jet { value: out[0], first: out[1].map(|v| v * h), second: out[2].map(|v| v * h * h) }
    }
}

fn locate(t_s: f64, step_s: f64, segments: usize) -> (usize, f64) {
    let at = t_s / step_s;
    let segment = (at.at_least(0.0) as usize).min(segments - 1);
    (segment, at - segment as f64)
}

/// Symmetric positive definite normal equations with half-bandwidth `ORDER - 1`.
struct Banded<const D: usize> {
    /// `rows[i][k]` is the entry `(i, i - k)`.
    rows: Vec<[f64; ORDER]>,
    right: Vec<[f64; D]>,
}

impl<const D: usize> Banded<D> {
    fn new(size: usize) -> Self {
        // A whisper of regularization keeps a column without any sample solvable.
        let mut row = [0.0; ORDER];
        row[0] = 1e-12;
        Self { rows: vec![row; size], right: vec![[0.0; D]; size] }
    }

    /// Adds the equation `weights . c[first..] = value`.
    fn add(&mut self, first: usize, weights: &[f64], value: &[f64; D], weight: f64) {
        for (a, wa) in weights.iter().enumerate() {
            for (b, wb) in weights[..=a].iter().enumerate() {
                self.rows[first + a][a - b] += weight * wa * wb;
            }
            for (r, v) in self.right[first + a].iter_mut().zip(value) {
                *r += weight * wa * v;
            }
        }
    }

    /// LDL' in place, forward and backward substitution.
    fn solve(mut self) -> Vec<[f64; D]> {
        let n = self.rows.len();
        for i in 0..n {
            for k in (1..ORDER.min(i + 1)).rev() {
                let j = i - k;
                let mut value = self.rows[i][k];
                for m in k + 1..ORDER.min(i + 1) {
                    let l = i - m;
                    value -= self.rows[i][m] * self.rows[j][j - l] * self.rows[l][0];
                }
                self.rows[i][k] = value / self.rows[j][0];
            }
            for k in 1..ORDER.min(i + 1) {
                let (factor, pivot) = (self.rows[i][k], self.rows[i - k][0]);
                self.rows[i][0] -= factor * factor * pivot;
                for d in 0..D {
                    self.right[i][d] -= factor * self.right[i - k][d];
                }
            }
        }
        for i in (0..n).rev() {
            for d in 0..D {
                let mut value = self.right[i][d] / self.rows[i][0];
                for k in 1..ORDER.min(n - i) {
                    value -= self.rows[i + k][k] * self.right[i + k][d];
                }
                self.right[i][d] = value;
            }
        }
        self.right
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(t: f64) -> [f64; 2] {
        [(1.3 * t).sin() + 0.1 * t, (0.7 * t).cos()]
    }

    fn fitted() -> Spline<2> {
        let samples: Vec<_> = (0..=2000).map(|i| f64::from(i) * 0.005).map(|t| (t, wave(t))).collect();
        Spline::fit(&samples, 10.0, 0.06)
    }

    #[test]
    fn a_smooth_curve_is_reproduced_with_its_derivatives() {
        let spline = fitted();
        for i in 1..100 {
            let t = f64::from(i) * 0.1;
            let jet = spline.jet(t);
            assert!((jet.value[0] - wave(t)[0]).abs() < 1e-5);
            assert!((jet.first[0] - (1.3 * (1.3 * t).cos() + 0.1)).abs() < 1e-3);
            assert!((jet.second[1] + 0.49 * (0.7 * t).cos()).abs() < 2e-2);
        }
    }

    #[test]
    fn derivatives_are_those_of_the_value() {
        let (spline, h) = (fitted(), 1e-5);
        for i in 1..300 {
            let t = f64::from(i) * 0.0331;
            let (a, jet, b) = (spline.jet(t - h), spline.jet(t), spline.jet(t + h));
            for d in 0..2 {
                assert!(((b.value[d] - a.value[d]) / (2.0 * h) - jet.first[d]).abs() < 1e-7);
                assert!(((b.first[d] - a.first[d]) / (2.0 * h) - jet.second[d]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_gap_is_bridged() {
        let samples: Vec<_> =
            fitted_times().filter(|t| !(4.0..4.8).contains(t)).map(|t| (t, wave(t))).collect();
        let spline = Spline::fit(&samples, 10.0, 0.06);
        assert!((spline.jet(4.4).value[0] - wave(4.4)[0]).abs() < 0.05);
    }

    fn fitted_times() -> impl Iterator<Item = f64> {
        (0..=2000).map(|i| f64::from(i) * 0.005)
    }
}
