//! `plumbline reset`: starts the estimate of a vehicle anew, from afar.

use super::remote::RemoteArgs;
use crate::ground::command::{self, ResetWords};
use anyhow::Result;
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};

/// Arguments of `plumbline reset`.
#[derive(Debug, Args)]
pub struct ResetArgs {
    /// The vehicle.
    #[command(flatten)]
    pub remote: RemoteArgs,
    /// Kind of reset: soft keeps the pose; hard restarts at the origin.
    #[arg(long, value_enum, default_value = "soft")]
    pub kind: ResetWords,
}

/// Runs the command.
///
/// # Errors
/// When the vehicle refuses or does not answer.
pub fn run(args: &ResetArgs) -> Result<()> {
    args.remote.give(async |session, vehicle| command::reset(session, vehicle, args.kind).await)
}

impl ValueEnum for ResetWords {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Soft, Self::Hard]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(match self {
            Self::Soft => PossibleValue::new("soft").help("A new start that keeps the pose"),
            Self::Hard => PossibleValue::new("hard").help("A new start at the origin"),
        })
    }
}
