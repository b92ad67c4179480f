//! Drift of a recording without ground truth: flown there and back, each way by an estimator of its own.
//!
//! Both ways pass the same places, so each is a measurement of the same path. The error of a part of the path is estimated by the
//! difference of the two, divided by the square root of two: errors of equal size that are independent add in squares.
//! The figure is [`Drift`] over parts of 10 % to 50 % of the path (Zhang and Scaramuzza 2018), with the way back as the truth.
//!
//! The error at the end ([`Closure`]) is one draw of a random variable, and errors that are even in time cancel in it. It is the
//! figure that others report. On the flights of the tests it is down to a fifth of the true one (docs/experiments.md).
//!
//! Errors that both ways share are in neither figure: those of the scale, of the lenses and of the baseline.

use crate::evaluate::consistency::errors::frame_of;
use crate::evaluate::{Drift, Pairs, drift, path_length_m};
use nalgebra::{Isometry3, Matrix3, SMatrix, Vector3};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_flight::flight::{CausalPose, Truth};
use serde::Serialize;
use std::f64::consts::FRAC_1_SQRT_2;

/// Fewest common poses that say anything.
const MIN_POSES: usize = 10;
/// Between poses of the way back further apart than this nothing is interpolated, s.
const MAX_GAP_S: f64 = 0.2;
/// Rotations further apart than half a turn less this cannot be interpolated, rad.
const HALF_TURN_SLACK: f64 = 1e-6;

/// Drift of a recording that is flown there and back.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shuttle {
    /// Poses that both ways have.
    pub poses: usize,
    /// Path one way, m.
    pub distance_m: f64,
    /// Resets on the way there and on the way back.
    pub resets: [u32; 2],
    /// Drift of one way, from the difference of both; `None` on a path shorter than a metre.
    pub drift: Option<Drift>,
    /// Error at the end of the way back.
    pub closure: Closure,
    /// True drift of each way, where the truth is known.
    pub truth: Option<[Drift; 2]>,
    /// Told drift over the true one (the root mean square of both ways).
    pub told_over_true: Option<f64>,
}

/// Error at the end of the way back, with the two ways joined at the turn by position and heading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Closure {
    /// Position error, m.
    pub position_m: f64,
    /// Standard deviation of the position error by the covariances of both ways, m.
    pub position_sigma_m: f64,
    /// Position error over its standard deviation.
    pub position_sigmas: f64,
    /// Position error over the path there and back, percent.
    pub percent: f64,
    /// Heading error, degrees.
    pub yaw_deg: f64,
    /// Standard deviation of the heading error, degrees.
    pub yaw_sigma_deg: f64,
}

/// Pose and covariance of position and attitude.
#[derive(Clone, Copy, Debug)]
struct Known {
    pose: Isometry3<f64>,
    covariance: SMatrix<f64, 6, 6>,
}

impl Known {
    fn of(pose: &CausalPose) -> Self {
        Self { pose: pose.pose_o_b, covariance: pose.covariance }
    }

    /// Variance of the heading, rad².
    fn yaw_variance(&self) -> f64 {
        let up_b = self.pose.rotation.inverse() * Vector3::z();
        (up_b.transpose() * self.covariance.fixed_view::<3, 3>(3, 3) * up_b)[0].max(0.0)
    }
}

impl Shuttle {
    /// Compares the way there with the way back, whose stamps are `mirrored` to those of the way there. `None` if they have too few
    /// poses in common.
    #[must_use]
    pub fn of(
        there: &[CausalPose],
        back: &[CausalPose],
        mirrored: impl Fn(Timestamp) -> Timestamp,
        truth: &Truth,
    ) -> Option<Self> {
        let back: Vec<CausalPose> = back
            .iter()
            .rev()
            .map(|pose| CausalPose { stamp: mirrored(pose.stamp), ..pose.clone() })
            .collect();
        let both: Vec<(Timestamp, Known, Known)> = there
            .iter()
            .filter_map(|pose| Some((pose.stamp, Known::of(pose), interpolated(&back, pose.stamp)?)))
            .collect();
        let (Some(home), Some(turn)) = (both.first(), both.last()) else { return None };
        if both.len() < MIN_POSES {
            return None;
        }
        let stamped = |of: fn(&(Timestamp, Known, Known)) -> Isometry3<f64>| -> Vec<StampedPose> {
            both.iter().map(|pair| StampedPose { stamp: pair.0, pose: of(pair) }).collect()
        };
        let (estimate, reference) = (stamped(|pair| pair.1.pose), stamped(|pair| pair.2.pose));
        let distance_m = 0.5 * (path_length_m(&estimate) + path_length_m(&reference));
        let truth = against_truth(&estimate, &reference, truth);
        let drift = drift(&Pairs { estimate, reference }).map(|difference| Drift {
            translation_percent: FRAC_1_SQRT_2 * difference.translation_percent,
            rotation_deg_per_m: FRAC_1_SQRT_2 * difference.rotation_deg_per_m,
        });
        let resets = [there, &back].map(|poses| {
            let counters = poses.iter().map(|pose| pose.reset_counter);
            counters.clone().max().unwrap_or(0) - counters.min().unwrap_or(0)
        });
        let told_over_true = drift.zip(truth).map(|(told, [a, b])| {
            let square = |drift: Drift| drift.translation_percent * drift.translation_percent;
            told.translation_percent / (0.5 * (square(a) + square(b))).sqrt()
        });
        let closure = Closure::of(&[home.1, turn.1], &[turn.2, home.2], distance_m);
        Some(Self { poses: both.len(), distance_m, resets, drift, closure, truth, told_over_true })
    }
}

impl Closure {
    /// First and last pose of the way there, and of the way back.
    fn of([start, far]: &[Known; 2], [turned, home]: &[Known; 2], distance_m: f64) -> Self {
        let frame = frame_of(&far.pose, &turned.pose);
        let end = frame * home.pose;
        let error = end.translation.vector - start.pose.translation.vector;
        // The error of the heading at the turn swings the whole way back: (e_z x l) dpsi, with dpsi = e_z' R dtheta.
        let lever = Vector3::z().cross(&(end.translation.vector - far.pose.translation.vector));
        let up_b = far.pose.rotation.inverse() * Vector3::z();
        let mut by_far = SMatrix::<f64, 3, 6>::zeros();
        by_far.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
        by_far.fixed_view_mut::<3, 3>(0, 3).copy_from(&(lever * up_b.transpose()));
        let turn = frame.rotation.to_rotation_matrix().into_inner();
        let of_home: Matrix3<f64> = turn * home.covariance.fixed_view::<3, 3>(0, 0) * turn.transpose();
        let covariance = by_far * far.covariance * by_far.transpose() + of_home;
        let position_sigma_m = covariance.trace().max(0.0).sqrt();
        let offset = frame_of(&start.pose, &end).rotation;
        Self {
            position_m: error.norm(),
            position_sigma_m,
            position_sigmas: error.norm() / position_sigma_m.max(1e-9),
            percent: 100.0 * error.norm() / (2.0 * distance_m).max(1e-9),
            yaw_deg: offset.angle().to_degrees(),
            yaw_sigma_deg: (far.yaw_variance() + home.yaw_variance()).sqrt().to_degrees(),
        }
    }
}

/// True drift of each way over the common poses.
fn against_truth(there: &[StampedPose], back: &[StampedPose], truth: &Truth) -> Option<[Drift; 2]> {
    let of = |poses: &[StampedPose]| {
        let known = poses.iter().filter_map(|p| {
            // A truth of few poses is not interpolated.
            let pose =
                truth.state_at(p.stamp).map(|state| state.pose_w_b).or_else(|| truth.pose_at(p.stamp))?;
            Some((*p, StampedPose { stamp: p.stamp, pose }))
        });
        let (estimate, reference): (Vec<_>, Vec<_>) = known.unzip();
        (estimate.len() >= MIN_POSES).then(|| drift(&Pairs { estimate, reference })).flatten()
    };
    Some([of(there)?, of(back)?])
}

/// Pose of `poses`, in order of time, at `stamp`; `None` where there is none close by. Each way refines the time offset of its own, so
/// the stamps of a frame differ by some tenths of a millisecond.
fn interpolated(poses: &[CausalPose], stamp: Timestamp) -> Option<Known> {
    let after = poses.partition_point(|pose| pose.stamp < stamp);
    let next = poses.get(after);
    if let Some(next) = next.filter(|next| next.stamp == stamp) {
        return Some(Known::of(next));
    }
    let before = after.checked_sub(1).and_then(|k| poses.get(k));
    let (Some(a), Some(b)) = (before, next) else {
        // The last frame of one way may be stamped just beyond that of the other.
        let end = before.or(next)?;
        return (end.stamp.seconds_since(stamp).abs() < 2e-3).then(|| Known::of(end));
    };
    let gap_s = b.stamp.seconds_since(a.stamp);
    let share = stamp.seconds_since(a.stamp) / gap_s;
    let nearer = if share < 0.5 { a } else { b };
    let pose = a.pose_o_b.try_lerp_slerp(&b.pose_o_b, share, HALF_TURN_SLACK)?;
    (gap_s <= MAX_GAP_S).then_some(Known { pose, covariance: nearer.covariance })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix6, Translation3, UnitQuaternion};

    const STEP_NS: i64 = 50_000_000;

    /// A circle of 20 m that ends where it began, at 20 Hz for 30 s, with an error of the heading that grows to `yaw_rad`.
    fn flight(yaw_rad: f64, scale: f64) -> Vec<CausalPose> {
        let pose = |k: i64| {
            let share = k as f64 / 600.0;
            let a = share * std::f64::consts::TAU;
            let position = Vector3::new(a.sin(), 1.0 - a.cos(), 0.0) * scale * 20.0 / std::f64::consts::TAU;
            let turn = |angle| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let drifted = turn(share * yaw_rad);
            Isometry3::from_parts(Translation3::from(drifted * position), drifted * turn(a))
        };
        (0..=600)
            .map(|k| CausalPose {
                stamp: Timestamp::from_nanos(k * STEP_NS),
                pose_o_b: pose(k),
                covariance: Matrix6::identity() * 1e-4,
                reset_counter: 0,
                pose_m_o: None,
            })
            .collect()
    }

    fn mirrored(stamp: Timestamp) -> Timestamp {
        Timestamp::from_nanos(1200 * STEP_NS - stamp.as_nanos())
    }

    /// `poses` as a flight in the other direction, in a frame of its own, has them.
    fn reversed(poses: &[CausalPose]) -> Vec<CausalPose> {
        let frame = Isometry3::new(Vector3::new(3.0, -2.0, 1.0), Vector3::z() * 2.0);
        let back = |p: &CausalPose| CausalPose {
            stamp: mirrored(p.stamp),
            pose_o_b: frame * p.pose_o_b,
            ..p.clone()
        };
        poses.iter().rev().map(back).collect()
    }

    #[test]
    fn two_ways_that_agree_have_no_drift_and_close() {
        let there = flight(0.0, 1.0);
        let shuttle = Shuttle::of(&there, &reversed(&there), mirrored, &Truth::None).unwrap();
        assert_eq!((shuttle.poses, shuttle.resets, shuttle.truth), (601, [0, 0], None));
        assert!((shuttle.distance_m - 20.0).abs() < 1e-3);
        assert!(shuttle.drift.unwrap().translation_percent < 1e-9 && shuttle.closure.position_m < 1e-9);
        // 1 cm on each axis there and back; the heading has no lever, for the circle closes.
        assert!((shuttle.closure.position_sigma_m - 0.06_f64.sqrt() * 0.1).abs() < 1e-3, "{shuttle:?}");
    }

    #[test]
    fn equal_and_opposite_drift_is_told_and_is_that_of_one_way_times_root_two() {
        let (there, back, true_path) = (flight(0.02, 1.0), reversed(&flight(-0.02, 1.0)), flight(0.0, 1.0));
        let poses = |p: &CausalPose| StampedPose { stamp: p.stamp, pose: p.pose_o_b };
        let truth = Truth::of_poses(&true_path.iter().map(poses).collect::<Vec<_>>());
        let shuttle = Shuttle::of(&there, &back, mirrored, &truth).unwrap();
        let [a, b] = shuttle.truth.unwrap();
        assert!(
            a.translation_percent > 0.01 && (a.translation_percent / b.translation_percent - 1.0).abs() < 0.1
        );
        let ratio = shuttle.told_over_true.unwrap();
        assert!((ratio - 2.0_f64.sqrt()).abs() < 0.01, "{ratio}");
        // Both turn away by 0.02 rad over the circle: 0.04 rad when joined at the turn.
        assert!((shuttle.closure.yaw_deg - 0.04_f64.to_degrees()).abs() < 1e-6, "{shuttle:?}");
    }

    #[test]
    fn an_error_of_the_scale_cancels() {
        let (there, true_path) = (flight(0.0, 1.02), flight(0.0, 1.0));
        let poses = |p: &CausalPose| StampedPose { stamp: p.stamp, pose: p.pose_o_b };
        let truth = Truth::of_poses(&true_path.iter().map(poses).collect::<Vec<_>>());
        let shuttle = Shuttle::of(&there, &reversed(&there), mirrored, &truth).unwrap();
        assert!(
            shuttle.told_over_true.unwrap() < 1e-6 && shuttle.truth.unwrap()[0].translation_percent > 1.0
        );
    }

    #[test]
    fn stamps_that_differ_by_the_time_offset_are_interpolated_and_gaps_are_left_out() {
        let there = flight(0.0, 1.0);
        let mut back = reversed(&there);
        back.drain(100..110);
        let shuttle = Shuttle::of(&there, &back, mirrored, &Truth::None).unwrap();
        assert_eq!(shuttle.poses, 591);
        let early = |stamp: Timestamp| mirrored(stamp).plus_nanos(300_000);
        let shuttle = Shuttle::of(&there, &reversed(&there), early, &Truth::None).unwrap();
        assert!(shuttle.poses >= 600 && shuttle.closure.position_m < 1e-3, "{shuttle:?}");
        assert!(Shuttle::of(&there[..5], &reversed(&there), mirrored, &Truth::None).is_none());
    }
}
