//! `plumbline calibrate`: the sensors before a flight.

mod camera;

use anyhow::Result;
use clap::{Args, Subcommand};

/// Arguments of `plumbline calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    command: CalibrateCommand,
}

#[derive(Debug, Subcommand)]
enum CalibrateCommand {
    /// Find intrinsics and the pose between two cameras by images of a board (needs a build with OpenCV: `make
    /// calibration`).
    Camera(Box<camera::CameraArgs>),
}

/// Runs the command.
///
/// # Errors
/// When there is no calibration, or it cannot be written.
pub fn run(args: &CalibrateArgs) -> Result<()> {
    match &args.command {
        CalibrateCommand::Camera(args) => camera::run(args),
    }
}
