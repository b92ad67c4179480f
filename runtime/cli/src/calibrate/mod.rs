//! `plumbline calibrate`: the sensors before a flight.

mod camera;
mod rig;

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
    /// Calibrate the intrinsics of one or two cameras, and the pose between them, from images of a board (needs a
    /// build with OpenCV: `make calibration`).
    Camera(Box<camera::CameraArgs>),
    /// Calibrate the pose of the cameras on the IMU and their time offset from a recording moved by hand.
    Rig(rig::RigArgs),
}

/// Runs the command.
///
/// # Errors
/// When the recording cannot be used, does not show what is to be calibrated, or the result cannot be written.
pub fn run(args: &CalibrateArgs) -> Result<()> {
    match &args.command {
        CalibrateCommand::Camera(args) => camera::run(args),
        CalibrateCommand::Rig(args) => rig::run(args),
    }
}
