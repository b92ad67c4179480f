//! Files that a replay writes at its end.

use super::ReplayArgs;
use crate::Usage;
use anyhow::{Context, Result};
use plumbline_drivers::StampedPose;
use plumbline_drivers::tum::write_tum;
use plumbline_estimator::Estimate;
use plumbline_flight::flight::states::write_states;
use plumbline_flight::flight::{CausalPose, Flown, Truth};
use std::fmt::Write as _;
use std::path::Path;

/// First line of a table of covariances.
const COVARIANCE_HEADER: &str = "#timestamp [ns], 6x6 covariance by rows: position x y z [m] in the odometry frame O, attitude x y z \
                                 [rad] about the axes of the body B (R Exp(dtheta)), both against the first pose\n";

/// Writes the odometry and the covariances, where they were asked for.
pub fn write_trajectories(
    args: &ReplayArgs,
    poses: &[CausalPose],
    odometry: Option<&[StampedPose]>,
) -> Result<()> {
    if let (Some(path), Some(odometry)) = (&args.odometry, odometry) {
        write_tum(path, odometry)?;
    }
    if let Some(path) = &args.covariance {
        write_covariances(path, poses)?;
    }
    Ok(())
}

/// Writes the trajectories of the map that were asked for.
pub fn write_map_outputs(args: &ReplayArgs, flown: &Flown) -> Result<()> {
    if let Some(path) = &args.final_trajectory {
        write_tum(path, &flown.final_poses())?;
    }
    if let Some(path) = &args.map_trajectory {
        write_tum(path, &flown.poses_in_map())?;
    }
    Ok(())
}

/// Writes the table of the states, and draws them.
pub fn write_state_outputs(args: &ReplayArgs, rows: &[Estimate], truth: &Truth) -> Result<()> {
    if let Some(path) = &args.states {
        write_states(path, rows).with_context(|| format!("{}", path.display()))?;
    }
    match &args.plot {
        Some(path) => draw(&args.dataset, rows, truth, path),
        None => Ok(()),
    }
}

#[cfg(feature = "lab")]
pub fn check_plot(path: &Path) -> Result<(), Usage> {
    plumbline_lab::plot::check_name(path).map_err(|e| Usage(format!("--plot: {e}")))
}

#[cfg(not(feature = "lab"))]
pub fn check_plot(_: &Path) -> Result<(), Usage> {
    Err(crate::left_out::refusal("--plot", "lab"))
}

#[cfg(feature = "lab")]
fn draw(name: &str, rows: &[Estimate], truth: &Truth, path: &Path) -> Result<()> {
    use plumbline_lab::plot;

    match crate::plot::flown_subject(name, rows, truth)? {
        Some(subject) => Ok(plot::write(&subject, path, plot::SIZE_PX)?),
        // The end of the run says that there is no pose.
        None => Ok(()),
    }
}

/// Never: such a run was refused before it began.
#[cfg(not(feature = "lab"))]
fn draw(_: &str, _: &[Estimate], _: &Truth, _: &Path) -> Result<()> {
    Ok(())
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
