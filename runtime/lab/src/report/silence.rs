//! Fate of an estimate when a sensor fails without a word: whether it is reported, and what can still be used.

use crate::evaluate::consistency::errors::frame_of;
use crate::evaluate::pose_error;
use plumbline_config::Timestamp;
use plumbline_estimator::{Estimate, HealthBits};
use plumbline_flight::flight::Truth;
use serde::Serialize;

/// Estimates of this quality and better are used.
const QUALITY_TO_USE: i8 = 20;
/// The largest error of an estimate that is used, in standard deviations, and the longest time without a name, s.
pub const MAX_SIGMAS: f64 = 5.0;
/// See [`MAX_SIGMAS`].
pub const MAX_NAMELESS_S: f64 = 1.0;
/// Inertial samples begin this long before the first frame at most, and so do their faults, s.
const LEAD_S: f64 = 0.25;

/// Health bits that name a sensor that failed in silence.
pub const NAMES: [HealthBits; 7] = [
    HealthBits::GYRO_STUCK,
    HealthBits::ACCEL_STUCK,
    HealthBits::LEFT_FROZEN,
    HealthBits::RIGHT_FROZEN,
    HealthBits::IMU_LATE,
    HealthBits::IMAGES_LATE,
    HealthBits::ROTATION_DISPUTED,
];

/// A flight in which a sensor fails in silence from some moment on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SilentFailure {
    /// When each health bit that names a sensor was up first, s since the sensor failed, in words.
    pub named_s: Vec<(&'static str, f64)>,
    /// Share of the frames since then whose estimate may be used: quality 20 and better.
    pub usable: f64,
    /// Their largest error of position or attitude along an axis, in standard deviations.
    pub worst_sigmas: f64,
    /// Their largest error of the position, m.
    pub worst_usable_m: f64,
    /// The largest error of the position of all estimates since then, m.
    pub worst_m: f64,
}

impl SilentFailure {
    /// Judges the estimates `rows` of a flight, in which a sensor fails `begin_s` seconds after `first`; `None` without a pose
    /// whose truth is known.
    #[must_use]
    pub fn of(rows: &[Estimate], truth: &Truth, first: Timestamp, begin_s: f64) -> Option<Self> {
        let start = rows.iter().find_map(|row| Some((*row.pose()?, truth.pose_at(row.stamp)?)))?;
        let pose_o_w = frame_of(&start.0, &start.1);
        let since = |row: &&Estimate| row.stamp.seconds_since(first) >= begin_s - LEAD_S;
        let first_s = |bit: HealthBits| {
            let row = rows.iter().find(|row| row.health.contains(bit))?;
            Some(row.stamp.seconds_since(first) - begin_s)
        };
        let names = HealthBits::NAMES.iter().filter(|(bit, _)| NAMES.contains(bit));
        let mut silence = Self {
            named_s: names.filter_map(|(bit, name)| Some((*name, first_s(*bit)?))).collect(),
            usable: 0.0,
            worst_sigmas: 0.0,
            worst_usable_m: 0.0,
            worst_m: 0.0,
        };
        let mut usable = 0.0;
        for row in rows.iter().filter(since) {
            let (Some(pose_o_b), Some(truth)) = (row.pose(), truth.pose_at(row.stamp)) else { continue };
            let error = pose_error(pose_o_b, &(pose_o_w * truth));
            let error_m = error.fixed_rows::<3>(0).norm();
            silence.worst_m = silence.worst_m.max(error_m);
            if row.quality >= QUALITY_TO_USE {
                usable += 1.0;
                let sigmas = (0..6).map(|k| error[k].abs() / row.covariance[(k, k)].max(1e-12).sqrt());
                silence.worst_sigmas = sigmas.fold(silence.worst_sigmas, f64::max);
                silence.worst_usable_m = silence.worst_usable_m.max(error_m);
            }
        }
        silence.usable = usable / rows.iter().filter(since).count().max(1) as f64;
        Some(silence)
    }

    /// True if estimates that were used were as good as they said, and one of `names` was up within a second, none before.
    #[must_use]
    pub fn is_honest(&self, names: &[&str]) -> bool {
        let is_of_time = |(name, s): &&(&str, f64)| names.contains(name) && *s <= MAX_NAMELESS_S;
        let is_early = self.named_s.iter().any(|(_, s)| *s < -LEAD_S);
        self.worst_sigmas <= MAX_SIGMAS && !is_early && self.named_s.iter().any(|named| is_of_time(&named))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use plumbline_drivers::StampedPose;
    use plumbline_estimator::{NavCovariance, TrackingState};

    /// Ten seconds at 20 Hz, 1 cm and 1 crad sure; from 5 s on off along x by `error_m`, with that quality and health.
    fn silence(error_m: f64, quality: i8, named_from_s: f64) -> SilentFailure {
        let stamp = |k: i64| Timestamp::from_nanos(k * 50_000_000);
        let at = |x: f64| Isometry3::from_parts(Vector3::new(x, 0.0, 0.0).into(), Default::default());
        let truth: Vec<_> = (0..200).map(|k| StampedPose { stamp: stamp(k), pose: at(0.0) }).collect();
        let row = |k: i64| {
            let t = k as f64 * 0.05;
            let is_failed = t >= 5.0;
            let health = if t >= named_from_s { HealthBits::GYRO_STUCK } else { HealthBits::default() };
            let quality = if is_failed { quality } else { 90 };
            Estimate {
                stamp: stamp(k),
                state: TrackingState::Tracking,
                pose_o_b: at(if is_failed { error_m } else { 0.0 }),
                covariance: NavCovariance::identity() * 1e-4,
                quality,
                health,
                ..Estimate::default()
            }
        };
        let rows: Vec<_> = (0..200).map(row).collect();
        SilentFailure::of(&rows, &Truth::of_poses(&truth), stamp(0), 5.0).unwrap()
    }

    #[test]
    fn a_failure_named_in_time_with_errors_within_five_sigma_is_honest() {
        let names = ["gyroscope stuck"];
        let good = silence(0.04, 90, 5.2);
        assert!(
            good.is_honest(&names) && good.usable == 1.0 && (good.worst_sigmas - 4.0).abs() < 1e-9,
            "{good:?}"
        );
        assert!(!good.is_honest(&["IMU late"]), "another sensor");
        assert!(!silence(0.06, 90, 5.2).is_honest(&names), "six standard deviations");
        assert!(silence(0.06, 10, 5.2).is_honest(&names), "and no quality that anybody uses");
        assert!(!silence(0.04, 90, 6.5).is_honest(&names), "too late");
        assert!(!silence(0.04, 90, 3.0).is_honest(&names), "before it failed");
    }
}
