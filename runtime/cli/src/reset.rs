//! `plumbline reset`: starts the estimate of a vehicle anew, from afar.

use super::checks::choice;
use super::remote::RemoteArgs;
use anyhow::Result;
use clap::Args;
use plumbline_ground::command::{self, ResetWords};

/// Extents of a reset.
const KINDS: [(&str, &str, ResetWords); 2] = [
    ("soft", "Restart at the present pose", ResetWords::Soft),
    ("hard", "Restart at the origin, in a new odometry frame", ResetWords::Hard),
];

/// Arguments of `plumbline reset`.
#[derive(Debug, Args)]
pub struct ResetArgs {
    /// The vehicle.
    #[command(flatten)]
    pub remote: RemoteArgs,
    /// Kind of reset: soft keeps the pose; hard restarts at the origin.
    #[arg(long, value_parser = choice(KINDS), default_value = "soft")]
    pub kind: ResetWords,
}

/// Runs the command.
///
/// # Errors
/// When the vehicle refuses or does not answer.
pub fn run(args: &ResetArgs) -> Result<()> {
    let kind = args.kind;
    args.remote.give(async |session, vehicle| command::reset(session, vehicle, kind).await)
}
