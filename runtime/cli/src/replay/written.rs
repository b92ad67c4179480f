//! Files that a replay writes at its end.

use super::ReplayArgs;
use anyhow::{Context, Result};
use plumbline_drivers::StampedPose;
use plumbline_drivers::tum::write_tum;
use plumbline_estimator::Estimate;
use plumbline_flight::flight::states::write_states;
use plumbline_flight::flight::{CausalPose, Flown};
use std::fmt::Write as _;
use std::path::Path;

/// First line of a table of covariances.
const COVARIANCE_HEADER: &str = "#timestamp [ns], 6x6 covariance by rows: position x y z [m] in the odometry frame O, attitude x y z \
                                 [rad] about the axes of the body B (R Exp(dtheta)), both against the first pose\n";

/// Writes the files that were asked for.
pub fn write_outputs(
    args: &ReplayArgs,
    flown: &Flown,
    odometry: Option<&[StampedPose]>,
    rows: Option<&[Estimate]>,
) -> Result<()> {
    if let (Some(path), Some(odometry)) = (&args.odometry, odometry) {
        write_tum(path, odometry)?;
    }
    if let Some(path) = &args.covariance {
        write_covariances(path, &flown.poses)?;
    }
    if let Some(path) = &args.final_trajectory {
        write_tum(path, &flown.final_poses())?;
    }
    if let Some(path) = &args.map_trajectory {
        write_tum(path, &flown.poses_in_map())?;
    }
    if let Some(path) = &args.true_trajectory {
        write_tum(path, &flown.truth.poses(flown.poses.iter().map(|pose| pose.stamp)))?;
    }
    match (&args.states, rows) {
        (Some(path), Some(rows)) => write_states(path, rows).with_context(|| format!("{}", path.display())),
        _ => Ok(()),
    }
}

fn write_covariances(path: &Path, poses: &[CausalPose]) -> Result<()> {
    let mut text = String::from(COVARIANCE_HEADER);
    for pose in poses {
        let _ = write!(text, "{}", pose.stamp.as_nanos());
        for value in pose.covariance.transpose().iter() {
            let _ = write!(text, ",{value:.9e}");
        }
        text.push('\n');
    }
    std::fs::write(path, text).with_context(|| format!("{}", path.display()))
}
