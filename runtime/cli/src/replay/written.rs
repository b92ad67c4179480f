//! Files that a replay writes at its end.

use super::ReplayArgs;
use anyhow::{Context, Result};
use plumbline_drivers::StampedPose;
use plumbline_drivers::tum::write_tum;
use plumbline_estimator::Estimate;
use plumbline_flight::flight::Flown;
use plumbline_record::columns::write_states;

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
