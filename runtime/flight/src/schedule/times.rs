//! Histograms of times in fixed memory, and their percentiles.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// Times are recorded in microseconds up to ten seconds, to three digits; longer ones count as ten.
const MAX_US: u64 = 10_000_000;
/// Hand-out times are recorded in nanoseconds up to a tenth of a second.
const MAX_NS: u64 = 100_000_000;

/// Percentiles of a time, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
}

/// A histogram of times in fixed memory.
#[derive(Clone, Debug)]
pub struct Times {
    histogram: Histogram<u64>,
    per_unit: f64,
    max: u64,
}

/// Histogram of times in milliseconds.
impl Default for Times {
    fn default() -> Self {
        Self::new(MAX_US, 1e3)
    }
}

impl Times {
    fn new(max: u64, per_unit: f64) -> Self {
        let histogram =
            Histogram::new_with_max(max, 3).unwrap_or_else(|_| unreachable!("three digits are allowed"));
        Self { histogram, per_unit, max }
    }

    /// Histogram of times in microseconds.
    #[must_use]
    pub fn of_us() -> Self {
        Self::new(MAX_NS, 1e3)
    }

    /// Times recorded.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// Adds one time.
    pub fn record(&mut self, time: f64) {
        let ticks = (time * self.per_unit).round().clamp(1.0, self.max as f64) as u64;
        self.histogram.saturating_record(ticks);
    }

    /// Adds the times of another of the same unit.
    pub fn add(&mut self, other: &Self) {
        // Fails only for values beyond the range, which is the same.
        let _ = self.histogram.add(&other.histogram);
    }

    /// The time that the share `q` of all does not exceed.
    #[must_use]
    pub fn quantile(&self, q: f64) -> f64 {
        if self.count() == 0 { 0.0 } else { self.histogram.value_at_quantile(q) as f64 / self.per_unit }
    }

    /// The percentiles, in the unit of the times.
    #[must_use]
    pub fn percentiles(&self) -> Percentiles {
        let h = &self.histogram;
        if h.is_empty() {
            return Percentiles::default();
        }
        let at = |q: f64| self.quantile(q);
        let (max, mean) = (h.max() as f64 / self.per_unit, h.mean() / self.per_unit);
        Percentiles { p50: at(0.5), p95: at(0.95), p99: at(0.99), max, mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_times() {
        let mut times = Times::default();
        (1..=100).for_each(|k| times.record(f64::from(k)));
        let p = times.percentiles();
        assert!((p.p50 - 50.0).abs() < 0.1 && (p.p99 - 99.0).abs() < 0.1 && (p.max - 100.0).abs() < 0.1);
        times.record(1e9);
        assert!((times.percentiles().max - 10_000.0).abs() < 10.0);
    }
}
