//! Paired differences: two variants flown over the same flights, and how far the mean of their differences can be trusted.
//!
//! Flights differ from each other by far more than variants do; the difference on each flight does not. The interval is
//! that of the bootstrap over flights (Efron and Tibshirani 1993, chapter 13), with its percentiles moved outwards for few
//! flights as in Hesterberg 2015, "What teachers should know about the bootstrap", section 5.3: without that an interval of
//! eight flights is a quarter too narrow.

use plumbline_config::Random;
use serde::{Deserialize, Serialize};

/// Resamplings of the flights. Percentiles move by less than a fiftieth of the interval from one seed to another.
const RESAMPLINGS: usize = 10_000;
/// Seed of the resamplings: the same flights give the same interval.
const SEED: u64 = 1;
/// Normal quantile of 97.5 %.
const Z_975: f64 = 1.959_963_984_540_054;

/// One figure of two variants over the same flights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairedDifference {
    /// Number of flights whose figure is known of both.
    pub flights: usize,
    /// Mean of the first variant.
    pub base_mean: f64,
    /// Mean of the second.
    pub mean: f64,
    /// Mean of the differences, second less first.
    pub difference: f64,
    /// Its interval of 95 %.
    pub difference_95: [f64; 2],
    /// Mean of the second over that of the first.
    pub ratio: f64,
    /// Its interval of 95 %.
    pub ratio_95: [f64; 2],
}

impl PairedDifference {
    /// Compares `(first, second)` of each flight; `None` for fewer than two flights.
    #[must_use]
    pub fn of(pairs: &[(f64, f64)]) -> Option<Self> {
        let flights = pairs.len();
        if flights < 2 {
            return None;
        }
        let (base_mean, mean) = means(pairs.iter());
        let mut random = Random::new(SEED);
        let (mut differences, mut ratios) = (Vec::new(), Vec::new());
        for _ in 0..RESAMPLINGS {
            let (base, other) = means((0..flights).map(|_| &pairs[random.below(flights)]));
            differences.push(other - base);
            ratios.push(other / base);
        }
        let tail = tail_share(flights);
        Some(Self {
            flights,
            base_mean,
            mean,
            difference: mean - base_mean,
            difference_95: interval(differences, tail),
            ratio: mean / base_mean,
            ratio_95: interval(ratios, tail),
        })
    }

    /// True if the interval of the difference lies on one side of zero.
    #[must_use]
    pub fn is_significant(&self) -> bool {
        self.difference_95[0] > 0.0 || self.difference_95[1] < 0.0
    }
}

fn means<'a>(pairs: impl ExactSizeIterator<Item = &'a (f64, f64)>) -> (f64, f64) {
    let count = pairs.len() as f64;
    let (base, other) = pairs.fold((0.0, 0.0), |(a, b), (x, y)| (a + x, b + y));
    (base / count, other / count)
}

/// Share of the resamplings beyond either end of the interval: `Phi(-sqrt(n / (n - 1)) t)`, with `t` the quantile of 97.5 %
/// of Student's distribution with `n - 1` degrees of freedom.
fn tail_share(flights: usize) -> f64 {
    let n = flights as f64;
    let (df, z) = (n - 1.0, Z_975);
    // Cornish-Fisher expansion (Abramowitz and Stegun 26.7.5): 2 % small for three degrees of freedom, exact for many.
    let t = z
        + (z.powi(3) + z) / (4.0 * df)
        + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * df * df)
        + (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / (384.0 * df.powi(3));
    normal_tail((n / df).sqrt() * t)
}

/// Share of a normal distribution above `x`, at least 0, to 1e-7 (Abramowitz and Stegun 26.2.17).
fn normal_tail(x: f64) -> f64 {
    const B: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let t = 1.0 / (1.0 + 0.231_641_9 * x);
    let polynomial = B.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt() * polynomial
}

/// The ends between which all but `tail` of the values on either side lie.
fn interval(mut values: Vec<f64>, tail: f64) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    let low = (tail * last as f64).floor() as usize;
    [values[low], values[last - low]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::test_noise::Noise;

    /// Flights that differ by 100 % among themselves; the second variant is better by 10 %, give or take 3 %.
    fn flights(noise: &mut Noise, count: usize, gain: f64) -> Vec<(f64, f64)> {
        let flight = |noise: &mut Noise| {
            let base = 1.0 + 2.0 * noise.uniform();
            (base, base * (1.0 - gain + 0.03 * noise.normal()))
        };
        (0..count).map(|_| flight(noise)).collect()
    }

    #[test]
    fn a_small_gain_is_told_from_large_differences_between_flights() {
        let result = PairedDifference::of(&flights(&mut Noise::new(1), 12, 0.1)).unwrap();
        assert!(result.is_significant() && result.difference < 0.0, "{result:?}");
        assert!((0.87..0.93).contains(&result.ratio), "{result:?}");
        assert!(result.ratio_95[0] < result.ratio && result.ratio < result.ratio_95[1]);
        assert!((result.mean / result.base_mean - result.ratio).abs() < 1e-12);
        assert_eq!(PairedDifference::of(&flights(&mut Noise::new(1), 12, 0.1)), Some(result));
        assert!(PairedDifference::of(&[(1.0, 2.0)]).is_none());
    }

    #[test]
    fn the_interval_of_eight_flights_holds_the_truth_in_95_of_100() {
        let mut noise = Noise::new(5);
        let held = (0..400).filter(|_| {
            let result = PairedDifference::of(&flights(&mut noise, 8, 0.0)).unwrap();
            result.difference_95[0] <= 0.0 && 0.0 <= result.difference_95[1]
        });
        let share = held.count() as f64 / 400.0;
        assert!((0.92..=0.98).contains(&share), "{share}");
    }

    #[test]
    fn tails_widen_for_few_flights() {
        assert!((tail_share(100_000) - 0.025).abs() < 1e-4);
        // t of seven degrees of freedom is 2.365: Phi(-2.528).
        assert!((tail_share(8) - 0.00574).abs() < 2e-4, "{}", tail_share(8));
    }
}
