//! Quantiles, means and deviations of a few numbers.

use nalgebra::Vector3;

/// The value below which the share `q` lies; not a number for none.
pub(crate) fn quantile(values: &[f64], q: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let mut values = values.to_vec();
    let at = ((values.len() - 1) as f64 * q).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Mean of vectors, and the norm of their standard deviation by axis.
pub(crate) fn mean_and_spread(values: impl Iterator<Item = Vector3<f64>> + Clone) -> (Vector3<f64>, f64) {
    let (sum, count) = values.clone().fold((Vector3::zeros(), 0.0), |(sum, n), v| (sum + v, n + 1.0));
    let mean: Vector3<f64> = sum / count;
    let squares: f64 = values.map(|v| (v - mean).norm_squared()).sum();
    (mean, (squares / count).sqrt())
}
