//! Errors of a causal trajectory against the truth at the same times.

use crate::evaluate::consistency::errors::frame_of;
use crate::evaluate::{
    AlignmentMode, Delta, Pairs, align, aligned, nees, path_length_m, pose_error, relative_errors,
    scale_error_percent, yaw_drift_deg_per_min,
};
use nalgebra::Isometry3;
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_flight::flight::{PublishedState, Truth};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Fewest poses with a truth that say anything.
const MIN_POSES: usize = 10;

/// Errors of one flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// Length of the true path, m.
    pub distance_m: f64,
    /// Root mean square position error after SE(3) alignment, m.
    pub ate_rmse_m: f64,
    /// Root mean square position error over the distance, percent.
    pub ate_percent: f64,
    /// Largest position error after alignment, m.
    pub max_error_m: f64,
    /// Excess of the estimate's length, percent; `None` where the positions hardly move, against their errors.
    pub scale_error_percent: Option<f64>,
    /// Root mean square translation error over each second, m; `None` for a flight that is shorter.
    pub rpe_1s_m: Option<f64>,
    /// Growth of the yaw error.
    pub yaw_drift_deg_per_min: Option<f64>,
    /// Mean normalized squared error of the whole pose, as its covariance is published, over its expectation; the truth is
    /// brought to the first pose by position and yaw. [`crate::evaluate::FlightConsistency`] judges its parts.
    pub nees_ratio: Option<f64>,
    /// Largest position error over its standard deviation.
    pub max_error_sigmas: f64,
}

impl Accuracy {
    /// Compares poses with the truth; `None` where it is known for too few.
    pub fn of(poses: &[PublishedState], truth: &Truth) -> Option<Self> {
        let known: Vec<(&PublishedState, Isometry3<f64>)> =
            poses.iter().filter_map(|p| Some((p, truth.pose_at(p.stamp)?))).collect();
        if known.len() < MIN_POSES {
            return None;
        }
        let pairs = Pairs {
            estimate: known.iter().map(|(p, _)| StampedPose { stamp: p.stamp, pose: p.pose_o_b }).collect(),
            reference: known.iter().map(|(p, t)| StampedPose { stamp: p.stamp, pose: *t }).collect(),
        };
        let errors = errors_m(&pairs)?;
        let ate_rmse_m = rms(&errors);
        let distance_m = path_length_m(&pairs.reference);
        let (nees_ratio, max_error_sigmas) = against_covariance(&known);
        Some(Self {
            distance_m,
            ate_rmse_m,
            ate_percent: 100.0 * ate_rmse_m / distance_m.max(1e-9),
            max_error_m: errors.iter().copied().fold(0.0, f64::max),
            scale_error_percent: scale_error_percent(&pairs),
            rpe_1s_m: relative_errors(&pairs, Delta::Seconds(1.0), true).ok().map(|e| e.translation_m.rmse),
            yaw_drift_deg_per_min: yaw_drift_deg_per_min(&pairs),
            nees_ratio,
            max_error_sigmas,
        })
    }
}

/// Error of a truth that was named for a flight of another time.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "--truth: {} is not of {flight}: {known} of {poses} poses have a true one; the truth runs from {} to {} s, the flight from {} to {} \
     s. Give the truth of this flight, on the clock of its inertial samples; between two clocks, `plumbline evaluate --time-offset` \
     compares a trajectory",
    truth.display(), of_truth.0, of_truth.1, of_flight.0, of_flight.1
)]
pub struct ForeignTruth {
    /// File of the truth.
    pub truth: PathBuf,
    /// Name of the flight.
    pub flight: String,
    /// Poses at whose time the truth is known.
    pub known: usize,
    /// Poses of the flight.
    pub poses: usize,
    /// First and last stamp of the truth.
    pub of_truth: (Timestamp, Timestamp),
    /// First and last stamp of the flight.
    pub of_flight: (Timestamp, Timestamp),
}

impl ForeignTruth {
    /// Refuses a truth, read from `file`, that is known for too few poses of a flight; a flight without poses has another trouble.
    ///
    /// # Errors
    /// When it is of another time.
    pub fn check(flight: &str, poses: &[PublishedState], truth: &Truth, file: &Path) -> Result<(), Self> {
        let span = |stamps: Vec<Timestamp>| Some((*stamps.iter().min()?, *stamps.iter().max()?));
        let known = poses.iter().filter(|pose| truth.pose_at(pose.stamp).is_some()).count();
        let true_poses = truth.poses(poses.iter().map(|pose| pose.stamp));
        let of_truth = span(true_poses.iter().map(|pose| pose.stamp).collect());
        let of_flight = span(poses.iter().map(|pose| pose.stamp).collect());
        match of_truth.zip(of_flight) {
            Some((of_truth, of_flight)) if known < MIN_POSES => Err(Self {
                truth: file.to_owned(),
                flight: flight.to_owned(),
                known,
                poses: poses.len(),
                of_truth,
                of_flight,
            }),
            _ => Ok(()),
        }
    }
}

/// Root mean square position error of poses after SE(3) alignment, m; `None` where the truth is known for too few.
pub fn ate_rmse_m(poses: &[StampedPose], truth: &Truth) -> Option<f64> {
    let known = poses.iter().filter_map(|p| Some((*p, truth.pose_at(p.stamp)?)));
    let (estimate, reference): (Vec<_>, Vec<_>) =
        known.map(|(p, t)| (p, StampedPose { stamp: p.stamp, pose: t })).unzip();
    let pairs = Pairs { estimate, reference };
    (pairs.estimate.len() >= MIN_POSES).then(|| errors_m(&pairs).map(|errors| rms(&errors))).flatten()
}

/// Position errors after alignment, m.
fn errors_m(pairs: &Pairs) -> Option<Vec<f64>> {
    let fitted = aligned(pairs, &align(pairs, AlignmentMode::Se3).ok()?);
    let error =
        |(e, r): (&StampedPose, &StampedPose)| (e.pose.translation.vector - r.pose.translation.vector).norm();
    Some(fitted.estimate.iter().zip(&fitted.reference).map(error).collect())
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Mean NEES over its expectation, and the largest position error in standard deviations, the truth brought to the first pose by
/// position and yaw.
fn against_covariance(known: &[(&PublishedState, Isometry3<f64>)]) -> (Option<f64>, f64) {
    let (first, truth) = &known[0];
    let origin = frame_of(&first.pose_o_b, truth);
    let (mut sum, mut count, mut max_error_sigmas) = (0.0, 0.0, 0.0_f64);
    for (pose, truth) in known {
        let error = pose_error(&pose.pose_o_b, &(origin * truth));
        let sigma_m = pose.covariance.fixed_view::<3, 3>(0, 0).trace().max(0.0).sqrt();
        max_error_sigmas = max_error_sigmas.max(error.fixed_rows::<3>(0).norm() / sigma_m.max(1e-9));
        if let Some(value) = nees(&error, &pose.covariance.fixed_view::<6, 6>(0, 0).into_owned()) {
            sum += value / 6.0;
            count += 1.0;
        }
    }
    ((count > 0.0).then(|| sum / count), max_error_sigmas)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truth_of_another_time_is_refused_with_both_spans() {
        let poses = |from_s: i64| {
            (0..40).map(move |k| StampedPose {
                stamp: Timestamp::from_nanos(from_s * 1_000_000_000 + k * 50_000_000),
                pose: Isometry3::translation(k as f64, 0.0, 0.0),
            })
        };
        let flown: Vec<PublishedState> = poses(100)
            .map(|p| PublishedState { stamp: p.stamp, pose_o_b: p.pose, ..PublishedState::default() })
            .collect();
        let check = |from_s| {
            let truth = Truth::of_poses(&poses(from_s).collect::<Vec<_>>());
            ForeignTruth::check("V1_01_easy", &flown, &truth, Path::new("other.tum"))
        };
        assert_eq!((check(100), check(101)), (Ok(()), Ok(())));
        let words = check(500).unwrap_err().to_string();
        for part in [
            "other.tum",
            "V1_01_easy",
            "0 of 40",
            "500.000000000 to 501.950000000 s",
            "100.000000000 to 101.95",
        ] {
            assert!(words.contains(part), "{part}: {words}");
        }
        assert_eq!(ForeignTruth::check("no pose", &[], &Truth::of_poses(&[]), Path::new("x")), Ok(()));
    }
}
