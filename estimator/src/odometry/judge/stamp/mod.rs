//! The error of a frame's stamp, by how far its images are along the motion that the inertial samples predict.
//!
//! An image that was taken `e` after its stamp shows the vehicle where it is `e` later: with `d` the pose by the images less the predicted
//! one (turn in `B`, way in `O`), `J = [w; v]` the rates of both and `S` the covariance of the difference,
//!
//! ```text
//! d = J e + noise        I = J' S^-1 J        e = (J' S^-1 d + m / s²) / (I + 1 / s²)
//! ```
//!
//! Before the frame is seen, `e` is a slow part `m`, as of an exposure that follows the light, and jitter, which
//! is learnt from frame to frame; while no frame shows an error, stamps are taken as they are. A correction moves
//! the time of the frame's state, so that the motion between two states is that between their images, and nothing has to excuse it.
//!
//! A wrong gyroscope turns about other axes than the vehicle, or by more than a stamp can be off: then nothing is corrected
//! ([`correction`]).

mod correction;
pub(super) mod noise;

pub(super) use correction::Correction;
use noise::LEAST_SIGMA_S;
use plumbline_config::{Portable, Timestamp};

/// Random walk of the slow part, s/√s: 3 ms within a second or two.
const WALK_S: f64 = 2e-3;
/// The slow part is pulled to zero in this time, s, as the time offset of the rig takes over what is constant.
const FORGETS_S: f64 = 20.0;
/// An error shows from [`SHOWS_S`] on where it is seen to the first number; jitter is then taken for the second, s.
const TELLS_TO_BEGIN_S: f64 = 7e-4;
const FIRST_JITTER_S: f64 = 2.5e-3;
/// Gain by which the jitter follows an error that is seen to [`LEAST_SIGMA_S`].
const JITTER_GAIN: f64 = 0.15;
/// Corrections end where jitter and slow part are below this, s.
const ENDS_S: f64 = 3e-4;

/// Time of an image after its stamp, s, with its variance, s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct TimeError {
    pub(super) value: f64,
    pub(super) variance: f64,
}

impl TimeError {
    /// This error and an independent sight of the same one.
    fn combined(&self, other: &Self) -> Self {
        let information = 1.0 / self.variance + 1.0 / other.variance;
        let value = (self.value / self.variance + other.value / other.variance) / information;
        Self { value, variance: 1.0 / information }
    }
}

/// Errors of stamps: the slow part, the jitter, and that of the newest frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StampErrors {
    /// Slow part, s, and when it was that.
    slow: TimeError,
    at: Option<Timestamp>,
    /// Variance of the jitter, s²; 0 while stamps are taken as they are.
    jitter_variance: f64,
    /// Variance of the time of the newest state, s².
    newest_variance: f64,
}

impl StampErrors {
    /// True while stamps are corrected.
    fn is_active(&self) -> bool {
        self.jitter_variance > 0.0
    }

    /// Variance of the time of the newest state, s²; `None` while stamps are not corrected.
    pub(super) fn newest_variance(&self) -> Option<f64> {
        self.is_active().then_some(self.newest_variance)
    }

    /// Begins to correct stamps, which are off by jitter of `jitter_s`.
    fn begin(&mut self, stamp: Timestamp, jitter_s: f64) {
        let slow = TimeError { value: 0.0, variance: WALK_S.squared() };
        *self = Self { slow, at: Some(stamp), jitter_variance: jitter_s.squared(), newest_variance: 0.0 };
    }

    /// The error of the frame of `stamp` before it is seen; that of any frame while stamps are taken as they are.
    fn expect(&mut self, stamp: Timestamp) -> TimeError {
        if !self.is_active() {
            return TimeError { value: 0.0, variance: FIRST_JITTER_S.squared() };
        }
        let dt_s = self.at.map_or(0.0, |at| stamp.seconds_since(at)).clamp(0.0, FORGETS_S);
        let kept = 1.0 - dt_s / FORGETS_S;
        self.slow.value *= kept;
        self.slow.variance = self.slow.variance * kept.squared() + WALK_S.squared() * dt_s;
        self.at = Some(stamp);
        TimeError { value: self.slow.value, variance: self.slow.variance + self.jitter_variance }
    }

    /// Takes the error that was seen, with the variance of the sight alone; ends the corrections where errors are small.
    fn add(&mut self, seen: TimeError) {
        let off = seen.value - self.slow.value;
        if seen.variance < LEAST_SIGMA_S.squared() {
            let jitter = (off.squared() - seen.variance - self.slow.variance).at_least(0.0);
            self.jitter_variance += JITTER_GAIN * (jitter - self.jitter_variance);
        }
        let noise = seen.variance + self.jitter_variance;
        let gain = self.slow.variance / (self.slow.variance + noise);
        self.slow.value += gain * off;
        self.slow.variance *= 1.0 - gain;
        if self.jitter_variance < ENDS_S.squared() && self.slow.value.abs() < ENDS_S {
            self.jitter_variance = 0.0;
        } else {
            self.jitter_variance = self.jitter_variance.at_least(ENDS_S.squared());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::noise::tests::drawn;
    use super::*;

    #[test]
    fn corrections_begin_with_jitter_and_end_where_it_is_gone() {
        let at = |k: i64| Timestamp::from_nanos(k * 50_000_000);
        let mut errors = StampErrors::default();
        assert_eq!(errors.newest_variance(), None);
        errors.begin(at(0), 2e-3);
        assert!(errors.newest_variance().is_some());
        let seen = |value| TimeError { value, variance: 1e-8 };
        for k in 1..100 {
            let _ = errors.expect(at(k));
            errors.add(seen(2e-3 * drawn(k as i32)));
        }
        let jitter_s = errors.jitter_variance.sqrt();
        assert!((1e-3..3e-3).contains(&jitter_s) && errors.slow.value.abs() < 1.5e-3, "{errors:?}");
        for k in 100..200 {
            let _ = errors.expect(at(k));
            errors.add(seen(0.0));
        }
        assert_eq!(errors.newest_variance(), None);
    }

    #[test]
    fn the_slow_part_is_followed() {
        let at = |k: i64| Timestamp::from_nanos(k * 50_000_000);
        let late = |k: i64| 3e-3 * libm::sin(k as f64 * 0.05 * 0.8);
        let mut errors = StampErrors::default();
        errors.begin(at(0), 1e-3);
        for k in 1..200 {
            let expected = errors.expect(at(k));
            if k > 40 {
                assert!((expected.value - late(k)).abs() < 1.5e-3, "{k}: {expected:?} of {}", late(k));
            }
            errors.add(TimeError { value: late(k), variance: 2.5e-7 });
        }
    }
}
