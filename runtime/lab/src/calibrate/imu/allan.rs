//! The overlapping Allan variance of a rate, octave by octave.
//!
//! With the integral `x_k` of the rate, `n + 1` values `dt` apart, and averages over `tau = m dt`,
//! `sigma²(tau) = sum (x_{k+2m} - 2 x_{k+m} + x_k)² / (2 tau² (n + 1 - 2m))` (Riley, NIST SP 1065, section 5.2.4).
//! White noise of density `N` gives `N² / tau`, a bias that walks by `K` gives `K² tau / 3`.

/// Averages are formed over at most this part of the recording: of longer ones there are too few.
const LONGEST_PART: usize = 4;

/// The Allan variance over one averaging time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllanPoint {
    /// Averaging time, s.
    pub tau_s: f64,
    /// Samples in an average.
    pub samples: usize,
    /// Allan variance, in the square of the rate's unit.
    pub variance: f64,
    /// Equivalent degrees of freedom, assuming white noise.
    pub freedom_white: f64,
    /// Equivalent degrees of freedom, assuming a random walk.
    pub freedom_walk: f64,
}

impl AllanPoint {
    /// Allan deviation, in the unit of the rate.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        self.variance.sqrt()
    }
}

/// The Allan variance of `rate`, whose samples are `dt_s` apart, over 1, 2, 4 ... samples; empty for fewer than eight.
#[must_use]
pub fn allan_variance(rate: &[f64], dt_s: f64) -> Vec<AllanPoint> {
    let integral = integrated(rate);
    let octaves = std::iter::successors(Some(1_usize), |m| m.checked_mul(2));
    let longest = rate.len() / LONGEST_PART;
    octaves.take_while(|m| *m <= longest && rate.len() >= 8).map(|m| point(&integral, m, dt_s)).collect()
}

/// Sums of the samples so far, about their mean: differences of second order do not see it, and small numbers are exact.
fn integrated(rate: &[f64]) -> Vec<f64> {
    let mean = rate.iter().sum::<f64>() / rate.len().max(1) as f64;
    let mut sum = 0.0;
    let mut integral = Vec::with_capacity(rate.len() + 1);
    integral.push(sum);
    for value in rate {
        sum += value - mean;
        integral.push(sum);
    }
    integral
}

fn point(integral: &[f64], m: usize, dt_s: f64) -> AllanPoint {
    let count = integral.len() - 2 * m;
    let squares = integral[2 * m..]
        .iter()
        .zip(&integral[m..])
        .zip(integral)
        .map(|((last, middle), first)| (last - 2.0 * middle + first).powi(2));
    // The integral is in samples: tau is m of them.
    let variance = squares.sum::<f64>() / (2.0 * (m * m) as f64 * count as f64);
    let (freedom_white, freedom_walk) = freedoms(integral.len() as f64, m as f64);
    AllanPoint { tau_s: m as f64 * dt_s, samples: m, variance, freedom_white, freedom_walk }
}

/// Equivalent degrees of freedom for `n` values of the integral and averages of `m` samples: white noise and random walk
/// of the rate (NIST SP 1065, table 5).
fn freedoms(n: f64, m: f64) -> (f64, f64) {
    let white = (1.5 * (n - 1.0) / m - 2.0 * (n - 2.0) / n) * 4.0 * m * m / (4.0 * m * m + 5.0);
    let walk = (n - 2.0) / m * ((n - 1.0).powi(2) - 3.0 * m * (n - 1.0) + 4.0 * m * m) / (n - 3.0).powi(2);
    (white.max(1.0), walk.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_series_has_the_variance_that_is_reckoned_by_hand() {
        // Averages of 1: differences of neighbours 1, -2, 3, -4, 5, -6, 7: sum of squares 140, halved, over 7.
        let rate = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0];
        let points = allan_variance(&rate, 0.5);
        assert_eq!(points.len(), 2);
        assert!((points[0].variance - 10.0).abs() < 1e-12 && points[0].tau_s == 0.5);
        // Averages of 2: 0.5, 0, 0.5, 0, 0.5, 0, 0.5, two apart: no difference at all.
        assert!(points[1].variance.abs() < 1e-12 && points[1].tau_s == 1.0);
    }

    #[test]
    fn a_constant_has_none_and_a_ramp_grows_with_the_averaging_time() {
        assert!(allan_variance(&[3.7; 100], 0.01).iter().all(|p| p.variance < 1e-20));
        let ramp: Vec<f64> = (0..4096).map(|k| 0.002 * f64::from(k)).collect();
        for point in allan_variance(&ramp, 0.01) {
            // A drift of d a second: sigma² = d² tau² / 2.
            let expected = 0.5 * (0.2 * point.tau_s).powi(2);
            assert!((point.variance / expected - 1.0).abs() < 1e-6, "{point:?}");
        }
    }

    #[test]
    fn too_little_has_no_variance() {
        assert!(allan_variance(&[1.0; 7], 0.01).is_empty() && allan_variance(&[], 0.01).is_empty());
    }
}
