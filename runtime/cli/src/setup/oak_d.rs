//! OAK-D: a configuration for what a program of DepthAI records or sends.

use super::{Found, SetupOptions, finish, preset};
use anyhow::Result;
use clap::Args;
use nalgebra::{Isometry3, Translation3};
use plumbline_config::options::rows_from_isometry;

/// Mounting of an IMU with the axes of the left camera, in a camera that looks forward.
const FORWARD: &str = "-90,0,-90";

/// Arguments of `plumbline setup oak-d`.
#[derive(Debug, Args)]
pub struct OakDArgs {
    #[command(flatten)]
    options: SetupOptions,
    /// Intrinsics of the **rectified** images at 640x400, px, and baseline, m, as DepthAI states them (`getCameraIntrinsics`,
    /// `getBaselineDistance`). Default: nominal values, good for a look only.
    #[arg(long, value_name = "FX,FY,CX,CY,BASELINE", value_parser = super::realsense::parse_intrinsics)]
    intrinsics: Option<[f64; 5]>,
}

/// Writes the configuration.
///
/// # Errors
/// When it cannot be written.
pub fn run(args: &OakDArgs) -> Result<()> {
    args.options.check()?;
    let mut config = preset("oak-d", args.options.mounting(FORWARD)?)?;
    let mut notes = Vec::new();
    if let Some([fx, fy, cx, cy, baseline_m]) = args.intrinsics {
        let left = config.camera[0].pose_b_c();
        let right = left * Isometry3::from(Translation3::new(baseline_m, 0.0, 0.0));
        for (camera, pose) in config.camera.iter_mut().zip([left, right]) {
            (camera.focal_px, camera.centre_px) = ([fx, fy], [cx, cy]);
            camera.pose_b_c = rows_from_isometry(&pose);
        }
        notes.push("Intrinsics and baseline: as stated on the command line, of rectified images.".into());
    } else {
        notes.push("Calibration: nominal, of the preset. Give --intrinsics, or calibrate: plumbline calibrate camera.".into());
    }
    notes.push(
        "An OAK-D is no camera of the kernel: record with DepthAI, or send frames by a program: docs/rigs/oak-d.md.".into(),
    );
    let device = "an OAK-D".to_owned();
    finish(
        &args.options,
        Found { device, is_detected: false, config, notes, settings: Vec::new() },
        || Ok(()),
    )
}
