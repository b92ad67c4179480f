//! The figures by which a list of errors is summed up, defined as evo defines them.

use serde::Serialize;

/// Statistics of a list of errors, in the unit of the errors (`sse` in its square).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Statistics {
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median; of an even number the mean of the middle two.
    pub median: f64,
    /// Standard deviation, of the population (divided by n).
    pub std: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Sum of squares.
    pub sse: f64,
    /// Number of errors.
    pub count: usize,
}

impl Statistics {
    /// Statistics of `errors`, all finite; `None` of an empty list.
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (min, max) = (*sorted.first()?, *sorted.last()?);
        let n = errors.len() as f64;
        let sse: f64 = errors.iter().map(|e| e * e).sum();
        let mean = errors.iter().sum::<f64>() / n;
        let variance = errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n;
        let half = sorted.len() / 2;
        let median =
            if sorted.len() % 2 == 1 { sorted[half] } else { 0.5 * (sorted[half - 1] + sorted[half]) };
        let rmse = (sse / n).sqrt();
        Some(Self { rmse, mean, median, std: variance.sqrt(), min, max, sse, count: errors.len() })
    }
}
