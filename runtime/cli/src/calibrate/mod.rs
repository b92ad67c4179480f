//! `plumbline calibrate`: the sensors before a flight.

mod camera;
mod imu;
mod live;
mod output;
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
    /// Find intrinsics and the pose between two cameras by images of a board (needs a build with OpenCV: `make
    /// calibration`).
    Camera(Box<camera::CameraArgs>),
    /// Noise of the inertial sensor, of a recording at rest: densities and bias walks by the Allan deviation.
    Imu(imu::ImuArgs),
    /// Place and attitude of the cameras on the IMU and their time offset, of a recording moved by hand.
    Rig(rig::RigArgs),
}

/// Runs the command.
///
/// # Errors
/// When the recording cannot be used, does not show what is to be calibrated, or the result cannot be written.
pub fn run(args: &CalibrateArgs) -> Result<()> {
    match &args.command {
        CalibrateCommand::Camera(args) => camera::run(args),
        CalibrateCommand::Imu(args) => imu::run(args),
        CalibrateCommand::Rig(args) => rig::run(args),
    }
}
