//! The even grid of time on which a sensor samples: its period, and sequence numbers that show gaps.

use plumbline_config::{Timestamp, median_by};

/// A gap longer than this many periods means that a sample is missing between its ends.
const GAP_PERIODS: f64 = 1.5;

/// Median distance of neighbouring stamps, ns; `None` below two stamps.
pub(crate) fn median_period_ns(stamps: impl Iterator<Item = Timestamp> + Clone) -> Option<i64> {
    let mut gaps: Vec<i64> = stamps.clone().zip(stamps.skip(1)).map(|(a, b)| b.nanos_since(a)).collect();
    median_by(&mut gaps, Ord::cmp)
}

/// Increment of the sequence number over a gap of `gap_ns`: 1 where nothing is missing.
pub(crate) fn steps(gap_ns: i64, period_ns: Option<i64>) -> u64 {
    match period_ns {
        Some(period) if period > 0 => {
            let periods = gap_ns as f64 / period as f64;
            if periods > GAP_PERIODS { periods.round() as u64 } else { 1 }
        }
        _ => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_counts_what_is_missing_in_it() {
        let stamps = [0, 50, 100, 250, 300].map(Timestamp::from_nanos);
        let period = median_period_ns(stamps.into_iter());
        assert_eq!(period, Some(50));
        assert_eq!([20, 50, 74, 76, 149, 151].map(|gap| steps(gap, period)), [1, 1, 1, 2, 3, 3]);
        assert_eq!(steps(7, None), 1);
        assert_eq!(median_period_ns(std::iter::once(stamps[0])), None);
    }
}
