//! Quality of a trajectory: the figures of `plumbline evaluate`, the same as `evo_ape` and `evo_rpe`
//! (PyPI `evo`) give for the same files; a test compares them.
//!
//! The way of the data: [`load_trajectory`], [`associate`] by time, [`align`], then absolute errors
//! ([`Statistics`] of position and rotation), [`relative_errors`], and whether the covariances are honest
//! ([`nees`]). [`evaluate`] goes all the way at once.

mod align;
mod associate;
pub mod consistency;
mod delta;
mod drift;
mod error;
mod relative;
mod stats;

#[cfg(test)]
mod evo_tests;
#[cfg(test)]
mod test_noise;

pub use align::{AlignmentMode, Similarity, align, aligned};
pub use associate::{Pairs, associate};
pub use consistency::{Consistency, FlightConsistency, Nees, nees, pose_error};
pub use delta::Delta;
pub use drift::{coverage, path_length_m, yaw_drift_deg_per_min};
pub use error::{EvaluateError, Side};
pub use relative::{RelativeErrors, relative_errors};
pub use stats::Statistics;

use nalgebra::{Matrix3, Vector3};
use plumbline_drivers::euroc::{ground_truth_table, is_of_positions};
use plumbline_drivers::tum::read_tum;
use plumbline_drivers::{DriverError, StampedPose};
use plumbline_flight::flight::truth::read_truth;
use serde::Serialize;
use std::path::Path;

/// Options of a comparison of trajectories.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaluateOptions {
    /// Largest difference of stamps of a pair, s.
    pub max_difference_s: f64,
    /// Freedom of the alignment.
    pub alignment: AlignmentMode,
    /// Distance of relative errors.
    pub delta: Delta,
    /// True if relative errors begin at each pose.
    pub all_pairs: bool,
    /// Addition to the stamps of the estimate before poses are paired, s.
    pub time_offset_s: f64,
}

impl Default for EvaluateOptions {
    /// The defaults of evo, with `evo_ape --align`.
    fn default() -> Self {
        let (alignment, delta) = (AlignmentMode::Se3, Delta::Frames(1));
        Self { max_difference_s: 0.01, alignment, delta, all_pairs: false, time_offset_s: 0.0 }
    }
}

/// All figures of one estimate against its reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Poses of the estimate.
    pub estimate_poses: usize,
    /// Poses of the reference.
    pub reference_poses: usize,
    /// Addition to the stamps of the estimate, s.
    pub time_offset_s: f64,
    /// Pairs by time.
    pub associated: usize,
    /// Share of the reference's time during which there is an estimate.
    pub completion: f64,
    /// Path of the reference over the pairs, m.
    pub path_length_m: f64,
    /// Freedom of the alignment.
    pub alignment: AlignmentMode,
    /// Alignment: from the frame of the estimate to that of the reference.
    #[serde(skip)]
    pub similarity: Similarity,
    /// Absolute errors of position after alignment, m.
    pub ate_m: Statistics,
    /// Absolute errors of rotation after alignment, degrees; none where the alignment is by positions, and these hardly move.
    pub ate_rotation_deg: Option<Statistics>,
    /// Relative errors (after alignment, which changes them by its scale only); none where no poses are
    /// that far apart.
    pub rpe: Option<RelativeErrors>,
    /// Drift of the heading, degrees per minute.
    pub yaw_drift_deg_per_min: Option<f64>,
    /// Excess of the estimate's length, percent; none where the motion does not tell.
    pub scale_error_percent: Option<f64>,
    /// Probable cause of errors that no rigid motion takes away.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub doubt: Option<String>,
}

/// Compares an estimate with its reference.
///
/// # Errors
/// When they have too little in common, or the alignment is not determined.
pub fn evaluate(
    estimate: &[StampedPose],
    reference: &[StampedPose],
    options: &EvaluateOptions,
) -> Result<Evaluation, EvaluateError> {
    let time_offset_s = options.time_offset_s;
    let by_clock_of_reference =
        |p: &StampedPose| StampedPose { stamp: p.stamp.plus_seconds(time_offset_s), ..*p };
    let estimate: Vec<StampedPose> = estimate.iter().map(by_clock_of_reference).collect();
    let pairs = associate(&estimate, reference, options.max_difference_s)?;
    let similarity = align(&pairs, options.alignment)?;
    let aligned_pairs = aligned(&pairs, &similarity);
    let (ate_m, ate_rotation_deg) = absolute_errors(&aligned_pairs)?;
    let rpe = match relative_errors(&aligned_pairs, options.delta, options.all_pairs) {
        Err(EvaluateError::NoPairs(_)) => None,
        other => Some(other?),
    };
    // A scale that is wrong is no error of the rotation.
    let residual_m = best_fit(&pairs).map_or(ate_m.rmse, |(_, residual_m)| residual_m);
    let tells_rotation = Spread::of(&pairs.reference).tells_rotation(options.alignment, residual_m);
    Ok(Evaluation {
        estimate_poses: estimate.len(),
        reference_poses: reference.len(),
        time_offset_s,
        associated: pairs.len(),
        completion: coverage(&estimate, reference),
        path_length_m: path_length_m(&pairs.reference),
        alignment: options.alignment,
        similarity,
        ate_m,
        ate_rotation_deg: Some(ate_rotation_deg).filter(|_| tells_rotation),
        rpe,
        yaw_drift_deg_per_min: yaw_drift_deg_per_min(&pairs),
        scale_error_percent: scale_error_percent(&pairs),
        doubt: doubt(&pairs),
    })
}

/// Excess of the estimate's length, percent; `None` where the reference hardly moves, against the errors of positions.
pub fn scale_error_percent(pairs: &Pairs) -> Option<f64> {
    let (scale, residual_m) = best_fit(pairs)?;
    let error = 100.0 * (1.0 / scale - 1.0);
    (Spread::of(&pairs.reference).tells_scale(residual_m) && error.is_finite()).then_some(error)
}

/// Probable cause where only a reflection, or only another unit, brings the reference onto the estimate.
pub fn doubt(pairs: &Pairs) -> Option<String> {
    const FEWER: f64 = 0.2;
    const UNITS: [(&str, f64); 3] = [("millimetres", 1e3), ("centimetres", 1e2), ("kilometres", 1e-3)];
    let (scale, residual_m) = best_fit(pairs)?;
    let mut mirrored = pairs.clone();
    mirrored.estimate.iter_mut().for_each(|pose| pose.pose.translation.vector.y *= -1.0);
    let spread_m = Spread::of(&pairs.reference).sigmas_m[2];
    if let Some((_, reflected_m)) = best_fit(&mirrored)
        && reflected_m < FEWER * residual_m
        && spread_m > reflected_m
    {
        return Some(format!(
            "mirrored, the estimate fits to {reflected_m:.3} m instead of {residual_m:.3} m: the reference has left-handed axes (one \
             negated, or two exchanged); write it with right-handed ones"
        ));
    }
    let unit = UNITS.iter().find(|(_, factor)| (scale / factor - 1.0).abs() < FEWER);
    unit.map(|(unit, _)| {
        format!("the reference is {scale:.0} times as long: it is in {unit}; metres are expected")
    })
}

/// Scale of the similarity that fits best, and the root mean square error of positions that is left with it, m.
fn best_fit(pairs: &Pairs) -> Option<(f64, f64)> {
    let similarity = align(pairs, AlignmentMode::Sim3).ok()?;
    let (errors_m, _) = absolute_errors(&aligned(pairs, &similarity)).ok()?;
    Some((similarity.scale, errors_m.rmse))
}

/// Distance of positions from their mean, along the directions in which they are spread most.
struct Spread {
    /// Standard deviations, the largest first, m.
    sigmas_m: [f64; 3],
}

impl Spread {
    /// Smallest ratio of the spread to the error of positions from which on they tell a rotation or a scale: at it, both are
    /// wrong by a fifth of a radian and of the scale.
    const TELLING: f64 = 5.0;

    fn of(poses: &[StampedPose]) -> Self {
        let n = poses.len().max(1) as f64;
        let positions = || poses.iter().map(|p| p.pose.translation.vector);
        let mean = positions().sum::<Vector3<f64>>() / n;
        let covariance = positions().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / n;
        let mut variances: [f64; 3] = covariance.symmetric_eigenvalues().into();
        variances.sort_by(|a, b| b.total_cmp(a));
        Self { sigmas_m: variances.map(|variance| variance.max(0.0).sqrt()) }
    }

    /// True if a rotation about any axis moves positions by more than their errors, so that an alignment by them finds it.
    fn tells_rotation(&self, alignment: AlignmentMode, residual_m: f64) -> bool {
        let sigma_m = match alignment {
            AlignmentMode::None | AlignmentMode::Origin => return true,
            AlignmentMode::Yaw => self.sigmas_m[0],
            AlignmentMode::Se3 | AlignmentMode::Sim3 => self.sigmas_m[1],
        };
        sigma_m > Self::TELLING * residual_m
    }

    fn tells_scale(&self, residual_m: f64) -> bool {
        self.sigmas_m[0] > Self::TELLING * residual_m
    }
}

/// Absolute errors of pairs that are in one frame: distances in metres, rotation angles in degrees.
///
/// # Errors
/// When there are no pairs.
pub fn absolute_errors(pairs: &Pairs) -> Result<(Statistics, Statistics), EvaluateError> {
    let both = || pairs.estimate.iter().map(|p| p.pose).zip(pairs.reference.iter().map(|p| p.pose));
    let distances: Vec<f64> =
        both().map(|(x, y)| (x.translation.vector - y.translation.vector).norm()).collect();
    let angles: Vec<f64> = both().map(|(x, y)| x.rotation.angle_to(&y.rotation).to_degrees()).collect();
    let statistics = Statistics::of(&distances).zip(Statistics::of(&angles));
    statistics.ok_or(EvaluateError::TooFew { found: 0, needed: 1 })
}

/// Reads a trajectory: a TUM file (plain or gzip), a EuRoC ground truth table (`.csv`), or a EuRoC data
/// set, of which the ground truth is taken.
///
/// # Errors
/// When it cannot be read, or the data set has no ground truth.
pub fn load_trajectory(path: &Path) -> Result<Vec<StampedPose>, EvaluateError> {
    if !path.exists() {
        let message = if path.to_string_lossy().starts_with("sim:") {
            "is a simulated flight, which holds no trajectory; `plumbline replay sim:room --trajectory out.tum` writes one, and \
             its report holds the errors"
        } else {
            "does not exist; give a trajectory file (TUM) or a data set with ground truth"
        };
        return Err(DriverError::Refused { path: path.into(), message: message.into() }.into());
    }
    if path.is_dir() {
        let missing =
            |message: &str| Err(DriverError::Refused { path: path.into(), message: message.into() }.into());
        return match ground_truth_table(path) {
            Some(table) if is_of_positions(&table) => missing(
                "has its ground truth in leica0/data.csv, which holds positions without attitudes; give a trajectory file (TUM) \
                 or a data set whose truth has both",
            ),
            Some(table) => truth_poses(&table),
            None => missing(
                "holds no mav0/state_groundtruth_estimate0/data.csv (nor mocap0, vicon0); give a trajectory file or a data set \
                 with ground truth",
            ),
        };
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
        return truth_poses(path);
    }
    Ok(read_tum(path)?)
}

fn truth_poses(path: &Path) -> Result<Vec<StampedPose>, EvaluateError> {
    let states = read_truth(path)?;
    Ok(states.iter().map(|s| StampedPose { stamp: s.stamp, pose: s.pose_w_b }).collect())
}

#[cfg(test)]
mod tests;
