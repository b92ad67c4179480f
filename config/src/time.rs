//! Time as data: integer nanoseconds, never floating-point seconds, never a clock.

use serde::{Deserialize, Serialize};
use std::fmt;

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// A point on the sensors' common time axis, in integer nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Timestamp(i64);

impl Timestamp {
    /// The earliest representable stamp.
    pub const MIN: Self = Self(i64::MIN);
    /// The latest representable stamp.
    pub const MAX: Self = Self(i64::MAX);

    /// The stamp `nanos` after the origin of the time axis.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the origin of the time axis.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// `self - earlier` in seconds (negative when `earlier` is later).
    #[must_use]
    #[inline]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }

    /// `self - earlier` in nanoseconds, saturating.
    #[must_use]
    #[inline]
    pub const fn nanos_since(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }

    /// The stamp `nanos` later, saturating.
    #[must_use]
    #[inline]
    pub const fn plus_nanos(self, nanos: i64) -> Self {
        Self(self.0.saturating_add(nanos))
    }

    /// The stamp `seconds` later, rounded to the nearest nanosecond.
    #[must_use]
    #[inline]
    pub fn plus_seconds(self, seconds: f64) -> Self {
        self.plus_nanos((seconds * NANOS_PER_SECOND as f64).round() as i64)
    }
}

impl fmt::Display for Timestamp {
    /// Seconds with nine decimals, exactly (the TUM format's time column).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let nanos = self.0.unsigned_abs();
        let per_second = NANOS_PER_SECOND.unsigned_abs();
        write!(f, "{sign}{}.{:09}", nanos / per_second, nanos % per_second)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_is_exact_to_the_nanosecond() {
        assert_eq!(Timestamp::from_nanos(1_403_715_273_262_142_976).to_string(), "1403715273.262142976");
        assert_eq!(Timestamp::from_nanos(-5).to_string(), "-0.000000005");
    }

    #[test]
    fn seconds_round_to_the_nearest_nanosecond() {
        let stamp = Timestamp::from_nanos(10);
        assert_eq!(stamp.plus_seconds(0.1 + 0.2), Timestamp::from_nanos(300_000_010));
        assert_eq!(Timestamp::MAX.plus_nanos(1), Timestamp::MAX);
    }
}
