//! Drift of an odometry from the truth: path, drift per distance, drift of the heading, completion.

use super::Pairs;
use super::relative::{relative_error, travelled_m};
use plumbline_config::median_by;
use plumbline_drivers::StampedPose;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Lengths of the parts on which drift is measured, as shares of the whole path (Zhang and Scaramuzza
/// 2018, "A tutorial on quantitative trajectory evaluation for visual(-inertial) odometry", section IV).
const PART_SHARES: [f64; 5] = [0.1, 0.2, 0.3, 0.4, 0.5];
/// Parts begin at about this many poses, evenly spread: more would only repeat one another.
const PART_STARTS: usize = 500;
/// On a path shorter than this drift per distance says nothing, m.
const MIN_PATH_M: f64 = 1.0;
/// Heading errors are averaged over this share of the time at either end.
const YAW_END_SHARE: f64 = 0.1;
/// A trajectory is interrupted where its poses are further apart than this many median periods.
const INTERRUPTION_PERIODS: f64 = 3.0;

/// Drift per distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// Mean translation error of a part over its length, percent.
    pub translation_percent: f64,
    /// Mean rotation error of a part over its length, degrees per metre.
    pub rotation_deg_per_m: f64,
}

/// Length of the path, m.
#[must_use]
pub fn path_length_m(poses: &[StampedPose]) -> f64 {
    travelled_m(poses).last().copied().unwrap_or(0.0)
}

/// Mean drift over parts of 10 % to 50 % of the path; `None` where the reference hardly moves.
#[must_use]
pub fn drift(pairs: &Pairs) -> Option<Drift> {
    let travelled = travelled_m(&pairs.reference);
    let whole = travelled.last().copied().filter(|&path| path >= MIN_PATH_M)?;
    let step = (travelled.len() / PART_STARTS).max(1);
    let (mut translation, mut rotation, mut parts) = (0.0, 0.0, 0.0);
    for length in PART_SHARES.map(|share| share * whole) {
        for i in (0..travelled.len()).step_by(step) {
            let j = travelled.partition_point(|&d| d < travelled[i] + length);
            if j >= travelled.len() {
                break;
            }
            let error = relative_error(pairs, i, j);
            translation += error.translation.vector.norm() / length;
            rotation += error.rotation.angle() / length;
            parts += 1.0;
        }
    }
    (parts > 0.0).then(|| Drift {
        translation_percent: 100.0 * translation / parts,
        rotation_deg_per_m: (rotation / parts).to_degrees(),
    })
}

/// Drift of the heading in degrees per minute: the mean error of the last tenth of the time less that of
/// the first. Both frames have z up; a constant difference of heading between them cancels.
/// `None` for fewer than two stamps.
#[must_use]
pub fn yaw_drift_deg_per_min(pairs: &Pairs) -> Option<f64> {
    let (first, last) = (pairs.reference.first()?.stamp, pairs.reference.last()?.stamp);
    let duration = last.seconds_since(first);
    let (mut start, mut end) = (Mean::default(), Mean::default());
    let mut error = 0.0;
    for (estimate, reference) in pairs.estimate.iter().zip(&pairs.reference) {
        let r = (reference.pose.rotation * estimate.pose.rotation.inverse()).to_rotation_matrix();
        // The estimate's heading against the true one, without jumps at half a turn.
        let yaw = -r[(1, 0)].atan2(r[(0, 0)]);
        error += (yaw - error + PI).rem_euclid(TAU) - PI;
        let t = reference.stamp.seconds_since(first);
        if t <= YAW_END_SHARE * duration {
            start.add(t, error);
        }
        if t >= (1.0 - YAW_END_SHARE) * duration {
            end.add(t, error);
        }
    }
    let ((t0, e0), (t1, e1)) = (start.get()?, end.get()?);
    (t1 > t0).then(|| ((e1 - e0) / (t1 - t0) * 60.0).to_degrees())
}

#[derive(Default)]
struct Mean {
    time: f64,
    error: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, time: f64, error: f64) {
        self.time += time;
        self.error += error;
        self.count += 1.0;
    }

    fn get(&self) -> Option<(f64, f64)> {
        (self.count > 0.0).then(|| (self.time / self.count, self.error / self.count))
    }
}

/// Share of the reference's time during which there is an estimate: gaps of more than three median periods
/// are missing, as are the time before its first and after its last pose.
#[must_use]
pub fn coverage(estimate: &[StampedPose], reference: &[StampedPose]) -> f64 {
    let nanos = |poses: &[StampedPose]| {
        let mut stamps: Vec<i64> = poses.iter().map(|p| p.stamp.as_nanos()).collect();
        stamps.sort_unstable();
        stamps
    };
    let (estimate, reference) = (nanos(estimate), nanos(reference));
    let (Some(&first), Some(&last)) = (reference.first(), reference.last()) else { return 0.0 };
    let mut gaps: Vec<i64> = estimate.windows(2).map(|two| two[1].saturating_sub(two[0])).collect();
    let usual = median_by(&mut gaps, Ord::cmp).filter(|_| last > first);
    let Some(longest) = usual.map(|gap| gap as f64 * INTERRUPTION_PERIODS) else { return 0.0 };
    let covered = |two: &[i64]| {
        let inside = two[1].min(last).saturating_sub(two[0].max(first));
        if two[1].saturating_sub(two[0]) as f64 <= longest { inside.max(0) as f64 } else { 0.0 }
    };
    estimate.windows(2).map(covered).sum::<f64>() / last.saturating_sub(first) as f64
}

/// Poses over frames: the share of frames that were answered with a pose.
#[must_use]
pub fn completion(poses: u64, frames: u64) -> f64 {
    if frames == 0 { 0.0 } else { poses as f64 / frames as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use plumbline_config::Timestamp;

    /// A circle of 20 m about the origin, flown in a minute at 10 Hz.
    fn circle() -> Vec<StampedPose> {
        (0..=600)
            .map(|i| {
                let a = f64::from(i) / 600.0 * TAU;
                let position = Vector3::new(a.cos(), a.sin(), 0.0) * 20.0 / TAU;
                let pose = Isometry3::new(position, Vector3::z() * a);
                StampedPose { stamp: Timestamp::from_nanos(i64::from(i) * 100_000_000), pose }
            })
            .collect()
    }

    fn with_estimate(change: impl Fn(f64, Isometry3<f64>) -> Isometry3<f64>) -> Pairs {
        let reference = circle();
        let mut estimate = reference.clone();
        for p in &mut estimate {
            p.pose = change(p.stamp.as_nanos() as f64 * 1e-9, p.pose);
        }
        Pairs { estimate, reference }
    }

    fn yaw(angle: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
    }

    #[test]
    fn the_path_of_a_circle() {
        assert!((path_length_m(&circle()) - 20.0).abs() < 1e-3);
        assert_eq!(path_length_m(&[]), 0.0);
    }

    #[test]
    fn a_known_heading_drift_is_found_whatever_the_frames() {
        for offset in [0.0, 1.0, 3.1, -2.0] {
            let pairs = with_estimate(|t, p| {
                Isometry3::from_parts(p.translation, yaw(offset + 0.02 * t) * p.rotation)
            });
            let drift = yaw_drift_deg_per_min(&pairs).unwrap();
            assert!((drift - (0.02 * 60.0_f64).to_degrees()).abs() < 1e-6, "{drift}");
        }
    }

    #[test]
    fn a_scale_error_is_drift_in_percent() {
        let pairs = with_estimate(|_, mut p| {
            p.translation.vector *= 1.02;
            p
        });
        let Drift { translation_percent, rotation_deg_per_m } = drift(&pairs).unwrap();
        // The chord of an arc is shorter than the arc: a little less than 2 %.
        assert!((1.5..2.0).contains(&translation_percent), "{translation_percent}");
        assert!(rotation_deg_per_m < 1e-6);
        let still = with_estimate(|_, p| p);
        let still =
            Pairs { reference: vec![still.reference[0]; 10], estimate: still.estimate[..10].to_vec() };
        assert_eq!(drift(&still), None);
    }

    #[test]
    fn coverage_counts_gaps_and_ends() {
        let reference = circle();
        let mut estimate = reference[60..].to_vec(); // begins 6 s late
        estimate.drain(200..290); // and has a gap of 9.1 s
        assert!((coverage(&estimate, &reference) - (60.0 - 6.0 - 9.1) / 60.0).abs() < 1e-9);
        assert!((coverage(&reference, &reference) - 1.0).abs() < 1e-12);
        assert_eq!(coverage(&[], &reference), 0.0);
        assert_eq!((completion(19, 20), completion(0, 0)), (0.95, 0.0));
    }
}
