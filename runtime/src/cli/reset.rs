//! `plumbline reset`: starts the estimate of a vehicle anew, from afar.

use super::access::AccessArgs;
use super::say;
use crate::ground::command::{self, ResetWords};
use crate::net::{Endpoints, Mode};
use anyhow::{Result, anyhow};
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};

/// Arguments of `plumbline reset`.
#[derive(Debug, Args)]
pub struct ResetArgs {
    /// The vehicle.
    pub vehicle: String,
    /// soft: a new start that keeps the pose; hard: a new start at the origin.
    #[arg(long, value_enum, default_value = "soft")]
    pub kind: ResetWords,
    /// Connect to the vehicle or a router; may be repeated.
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub connect: Vec<String>,
    /// Who we are.
    #[command(flatten)]
    pub access: AccessArgs,
}

/// Runs the command.
///
/// # Errors
/// When the vehicle refuses or does not answer.
pub fn run(args: &ResetArgs) -> Result<()> {
    let mode = if args.connect.len() == 1 { Mode::Client } else { Mode::Peer };
    let endpoints = Endpoints { mode, ..args.access.endpoints(&args.vehicle, &[], &args.connect) };
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let outcome = runtime.block_on(async {
        let session = endpoints.open().await?;
        let outcome = match command::find(&session, &args.vehicle).await {
            true => command::reset(&session, &args.vehicle, args.kind).await,
            false => {
                Err("no vehicle of that name is on this network; is it flying, and are our keys good?".into())
            }
        };
        let _ = session.close().await;
        Ok::<_, anyhow::Error>(outcome)
    })?;
    let done = outcome.map_err(|reason| anyhow!("{}: {reason}", args.vehicle))?;
    say(format_args!("{}: {done}", args.vehicle));
    Ok(())
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
