//! Trust in an estimate: whether it deserves what its covariance asks for, while something goes wrong and after it.

use crate::evaluate::consistency::errors::frame_of;
use crate::evaluate::{nees, pose_error};
use plumbline_config::Timestamp;
use plumbline_flight::flight::{CausalPose, Truth};
use serde::Serialize;
use std::ops::Range;

/// Time after a fault in which its frames still show it, s.
const AFTERMATH_S: f64 = 1.0;
/// "Five seconds after" is a second around that, s.
const AFTER_S: Range<f64> = 4.5..5.5;
/// An estimate whose normalized squared error is beyond this has not recovered, and its largest share while it lasts.
pub const MAX_NEES_AFTER: f64 = 3.0;
/// See [`MAX_NEES_AFTER`].
pub const MAX_NEES_DURING: f64 = 10.0;
/// Poses further apart than this have a time without a pose between them, s.
const POSE_GAP_S: f64 = 0.15;

/// Agreement of errors and covariances about a fault. Normalized squared errors (NEES) of position and attitude are
/// given over their expectation, the truth brought to the first pose of the flight by position and yaw.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trust {
    /// Mean NEES while it lasts and a second longer; none without a pose in that time.
    pub nees_during: Option<f64>,
    /// The largest in that time.
    pub worst_nees_during: Option<f64>,
    /// Mean NEES five seconds after its end; none without a pose there.
    pub nees_after: Option<f64>,
    /// From its end until there is a pose in every frame, and NEES stays below [`MAX_NEES_AFTER`], s; none if that is
    /// never.
    pub recovery_s: Option<f64>,
    /// Largest error of the position from its beginning on, m.
    pub worst_error_m: f64,
    /// Largest error of the attitude, degrees.
    pub worst_error_deg: f64,
}

/// A pose against the truth.
struct Judged {
    time_s: f64,
    error_m: f64,
    error_deg: f64,
    nees: f64,
}

impl Trust {
    /// About a fault of `span_s`, s since `first`; `None` without a pose whose truth is known.
    #[must_use]
    pub fn of(poses: &[CausalPose], truth: &Truth, first: Timestamp, span_s: &Range<f64>) -> Option<Self> {
        let judged = judged(poses, truth, first)?;
        let within = |span: Range<f64>| judged.iter().filter(move |pose| span.contains(&pose.time_s));
        let during = span_s.start..span_s.end + AFTERMATH_S;
        let after = span_s.end + AFTER_S.start..span_s.end + AFTER_S.end;
        let since = || within(span_s.start..f64::INFINITY);
        Some(Self {
            nees_during: mean(within(during.clone()).map(|pose| pose.nees)),
            worst_nees_during: within(during).map(|pose| pose.nees).reduce(f64::max),
            nees_after: mean(within(after).map(|pose| pose.nees)),
            recovery_s: recovery_s(&judged, span_s.end),
            worst_error_m: since().map(|pose| pose.error_m).fold(0.0, f64::max),
            worst_error_deg: since().map(|pose| pose.error_deg).fold(0.0, f64::max),
        })
    }

    /// True if the errors were consistent with the covariance.
    #[must_use]
    pub fn is_deserved(&self) -> bool {
        let during = self.nees_during.is_none_or(|nees| nees <= MAX_NEES_DURING);
        during && self.nees_after.is_some_and(|nees| nees <= MAX_NEES_AFTER)
    }
}

fn judged(poses: &[CausalPose], truth: &Truth, first: Timestamp) -> Option<Vec<Judged>> {
    let start = poses.iter().find_map(|pose| Some((pose.pose_o_b, truth.pose_at(pose.stamp)?)))?;
    let pose_o_w = frame_of(&start.0, &start.1);
    let judge = |pose: &CausalPose| {
        let error = pose_error(&pose.pose_o_b, &(pose_o_w * truth.pose_at(pose.stamp)?));
        Some(Judged {
            time_s: pose.stamp.seconds_since(first),
            error_m: error.fixed_rows::<3>(0).norm(),
            error_deg: error.fixed_rows::<3>(3).norm().to_degrees(),
            // A covariance that is none deserves no trust at all.
            nees: nees(&error, &pose.covariance).map_or(f64::INFINITY, |nees| nees / 6.0),
        })
    };
    Some(poses.iter().filter_map(judge).collect())
}

fn recovery_s(judged: &[Judged], end_s: f64) -> Option<f64> {
    let last = judged.last().filter(|pose| pose.time_s > end_s && pose.nees <= MAX_NEES_AFTER)?;
    let gaps = judged.windows(2).filter(|pair| pair[1].time_s - pair[0].time_s > POSE_GAP_S);
    let back = gaps.map(|pair| pair[1].time_s);
    let wrong = judged.iter().filter(|pose| pose.nees > MAX_NEES_AFTER).map(|pose| pose.time_s);
    let recovered = back.chain(wrong).filter(|time_s| *time_s <= last.time_s).fold(end_s, f64::max);
    Some(recovered - end_s)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Matrix6, Vector3};
    use plumbline_drivers::StampedPose;

    /// Twenty seconds of poses at 20 Hz, 1 cm sure, which are off along x by what `error_m` says; `None` is no pose.
    fn trust(error_m: impl Fn(f64) -> Option<f64>) -> Trust {
        let stamp = |k: i64| Timestamp::from_nanos(k * 50_000_000);
        let at = |x: f64| Isometry3::from_parts(Vector3::new(x, 0.0, 0.0).into(), Default::default());
        let truth: Vec<_> = (0..400).map(|k| StampedPose { stamp: stamp(k), pose: at(0.0) }).collect();
        let pose = |k: i64| {
            Some(CausalPose {
                stamp: stamp(k),
                pose_o_b: at(error_m(k as f64 * 0.05)?),
                covariance: Matrix6::identity() * 1e-4,
                reset_counter: 0,
                pose_m_o: None,
            })
        };
        let poses: Vec<_> = (0..400).filter_map(pose).collect();
        Trust::of(&poses, &Truth::of_poses(&truth), stamp(0), &(5.0..7.0)).unwrap()
    }

    #[test]
    fn an_error_within_its_covariance_deserves_trust() {
        let trust = trust(|t| Some(if t < 4.0 { 0.0 } else { 0.02 }));
        // 2² over six degrees of freedom.
        assert!((trust.nees_after.unwrap() - 4.0 / 6.0).abs() < 1e-9 && trust.is_deserved());
        assert_eq!((trust.recovery_s, trust.worst_error_m), (Some(0.0), 0.02));
    }

    #[test]
    fn an_error_that_the_covariance_denies_does_not() {
        let jump =
            |from_s: f64, to_s: f64| move |t: f64| Some(if (from_s..to_s).contains(&t) { 0.1 } else { 0.0 });
        let lasting = trust(jump(5.0, 99.0));
        assert!(!lasting.is_deserved() && lasting.recovery_s.is_none(), "{lasting:?}");
        let passing = trust(jump(5.0, 9.0));
        assert!(!passing.is_deserved() && (passing.recovery_s.unwrap() - 1.95).abs() < 0.01, "{passing:?}");
        assert!(passing.nees_after.unwrap() < 1e-9);
    }

    #[test]
    fn a_time_without_a_pose_is_one_to_recover_from() {
        let trust = trust(|t| (!(6.0..8.0).contains(&t)).then_some(0.0));
        assert!((trust.recovery_s.unwrap() - 1.0).abs() < 0.01 && trust.is_deserved());
    }
}
