//! Drift of an odometry from the truth: path, drift of the heading, completion.

use super::Pairs;
use super::relative::travelled_m;
use plumbline_config::median_by;
use plumbline_drivers::StampedPose;
use std::f64::consts::{PI, TAU};

/// Heading errors are averaged over this share of the time at either end.
const YAW_END_SHARE: f64 = 0.1;
/// A trajectory is interrupted where its poses are further apart than this many median periods.
const INTERRUPTION_PERIODS: f64 = 3.0;

/// Length of the path, m.
pub fn path_length_m(poses: &[StampedPose]) -> f64 {
    travelled_m(poses).last().copied().unwrap_or(0.0)
}

/// Drift of the heading in degrees per minute: the mean error of the last tenth of the time less that of
/// the first. Both frames have z up; a constant difference of heading between them cancels.
/// `None` for fewer than two stamps.
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
    fn coverage_counts_gaps_and_ends() {
        let reference = circle();
        let mut estimate = reference[60..].to_vec(); // begins 6 s late
        estimate.drain(200..290); // and has a gap of 9.1 s
        assert!((coverage(&estimate, &reference) - (60.0 - 6.0 - 9.1) / 60.0).abs() < 1e-9);
        assert!((coverage(&reference, &reference) - 1.0).abs() < 1e-12);
        assert_eq!(coverage(&[], &reference), 0.0);
    }
}
