//! Commands to a vehicle, from the command line.

use super::access::AccessArgs;
use super::say;
use anyhow::{Result, anyhow};
use clap::Args;
use plumbline_ground::command;
use plumbline_link::net::{Endpoints, Mode};
use zenoh::Session;

/// The vehicle, and how it is reached.
#[derive(Debug, Args)]
pub struct RemoteArgs {
    /// Name of the vehicle.
    pub vehicle: String,
    /// Connect to the vehicle or a router; may be repeated.
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub connect: Vec<String>,
    /// Own identity.
    #[command(flatten)]
    pub access: AccessArgs,
}

impl RemoteArgs {
    /// Gives a command to the vehicle, and says what it replied.
    ///
    /// # Errors
    /// When the vehicle is out of reach, refuses, or does not answer.
    pub fn give(&self, order: impl AsyncFnOnce(&Session, &str) -> Result<String, String>) -> Result<()> {
        let mode = if self.connect.len() == 1 { Mode::Client } else { Mode::Peer };
        let endpoints = Endpoints { mode, ..self.access.endpoints(&self.vehicle, &[], &self.connect) };
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let outcome = runtime.block_on(async {
            let session = endpoints.open().await?;
            let outcome = match command::find(&session, &self.vehicle).await {
                true => order(&session, &self.vehicle).await,
                false => {
                    Err("no vehicle of that name is on this network; is it flying, and are our keys good?"
                        .into())
                }
            };
            let _ = session.close().await;
            Ok::<_, anyhow::Error>(outcome)
        })?;
        let done = outcome.map_err(|reason| anyhow!("{}: {reason}", self.vehicle))?;
        say(format_args!("{}: {done}", self.vehicle));
        Ok(())
    }
}
