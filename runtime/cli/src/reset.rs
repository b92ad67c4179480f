//! `plumbline reset`: starts the estimate of a vehicle anew, from afar.

use super::remote::RemoteArgs;
use anyhow::Result;
use clap::{Args, ValueEnum};
use plumbline_ground::command::{self, ResetWords};

/// Arguments of `plumbline reset`.
#[derive(Debug, Args)]
pub struct ResetArgs {
    /// The vehicle.
    #[command(flatten)]
    pub remote: RemoteArgs,
    /// Kind of reset: soft keeps the pose; hard restarts at the origin.
    #[arg(long, value_enum, default_value = "soft")]
    pub kind: ResetArg,
}

/// Extent of a reset.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ResetArg {
    /// Restart at the present pose.
    Soft,
    /// Restart at the origin, in a new odometry frame.
    Hard,
}

/// Runs the command.
///
/// # Errors
/// When the vehicle refuses or does not answer.
pub fn run(args: &ResetArgs) -> Result<()> {
    let kind = match args.kind {
        ResetArg::Soft => ResetWords::Soft,
        ResetArg::Hard => ResetWords::Hard,
    };
    args.remote.give(async |session, vehicle| command::reset(session, vehicle, kind).await)
}
