//! Histograms of times in fixed memory, and their percentiles.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize, Serializer};

/// Times are recorded in thousandths of their unit, to three digits.
const PER_UNIT: f64 = 1e3;
/// Largest time, in thousandths: longer ones count as a hundred seconds, or as a tenth of a second of times in microseconds.
const MAX: u64 = 100_000_000;

/// Percentiles of a time, in its unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Largest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
}

/// A histogram of times in fixed memory, of milliseconds or of microseconds. It is serialized as its percentiles.
#[derive(Clone, Debug)]
pub struct Times(Histogram<u64>);

impl Default for Times {
    fn default() -> Self {
        Self(Histogram::new_with_max(MAX, 3).unwrap_or_else(|_| unreachable!("three digits are allowed")))
    }
}

impl Serialize for Times {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.percentiles().serialize(serializer)
    }
}

impl Times {
    /// Times recorded.
    pub fn count(&self) -> u64 {
        self.0.len()
    }

    /// Adds one time.
    pub fn record(&mut self, time: f64) {
        self.0.saturating_record((time * PER_UNIT).round().clamp(1.0, MAX as f64) as u64);
    }

    /// Adds the times of another of the same unit.
    pub fn add(&mut self, other: &Self) {
        // Fails only for values beyond the range, which is the same.
        let _ = self.0.add(&other.0);
    }

    /// The time that the share `q` of all does not exceed.
    pub fn quantile(&self, q: f64) -> f64 {
        if self.count() == 0 { 0.0 } else { self.0.value_at_quantile(q) as f64 / PER_UNIT }
    }

    /// The percentiles, in the unit of the times.
    pub fn percentiles(&self) -> Percentiles {
        if self.0.is_empty() {
            return Percentiles::default();
        }
        let [p50, p95, p99, p999] = [0.5, 0.95, 0.99, 0.999].map(|q| self.quantile(q));
        let (max, mean) = (self.0.max() as f64 / PER_UNIT, self.0.mean() / PER_UNIT);
        Percentiles { p50, p95, p99, p999, max, mean }
    }
}
