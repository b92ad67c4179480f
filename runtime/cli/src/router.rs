//! `plumbline router`: a Zenoh router for vehicles and ground stations that cannot reach each other directly.

use super::access::AccessArgs;
use super::{Usage, say, stop_on_signal, supervisor};
use anyhow::Result;
use clap::Args;
use plumbline_link::net::{Endpoints, Mode, audit, diagnosis, security};
use rustix::process::{Resource, Rlimit, setrlimit};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Refusals are said this often.
const CHORES_PERIOD: Duration = Duration::from_millis(200);
/// Data that the process may have, bytes: 512 MB for its 160 links, three times what they hold that behave, and what it has
/// without any. Beyond it the process ends; its supervisor starts it again (docs/security.md).
const MAX_DATA_BYTES: u64 = 576_000_000;

/// Arguments of `plumbline router`.
#[derive(Debug, Args)]
pub struct RouterArgs {
    /// Listen on this endpoint, such as tcp/127.0.0.1:7447 or tls/0.0.0.0:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Connect to another router; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Exchange routes with other routers, also with those that connect here. Default: only with --connect.
    #[arg(long)]
    pub routes: bool,
    /// Own identity, and peers that are accepted.
    #[command(flatten)]
    pub access: AccessArgs,
}

/// Runs the command.
///
/// # Errors
/// When an endpoint cannot be used.
pub fn run(args: &RouterArgs) -> Result<()> {
    supervisor::begin_work()?;
    if args.listen.is_empty() {
        return Err(
            Usage("no endpoint to listen on: give --listen, such as tcp/127.0.0.1:7447".into()).into()
        );
    }
    let endpoints = Endpoints {
        mode: Mode::Router,
        routes: args.routes || !args.connect.is_empty(),
        ..args.access.endpoints("*", &args.listen, &args.connect)
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let limit = Rlimit { current: Some(MAX_DATA_BYTES), maximum: Some(MAX_DATA_BYTES) };
    setrlimit(Resource::Data, limit)?;
    let session = runtime.block_on(endpoints.open())?;
    if let Some(exposure) = security::exposure(&endpoints) {
        tracing::warn!("{exposure}");
    }
    say(format_args!("routing on {}; Ctrl-C ends it", args.listen.join(", ")));
    let stop = stop_on_signal()?;
    let mut routes = diagnosis::DroppedRoutes::default();
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(CHORES_PERIOD);
        audit::log_refusals();
        diagnosis::report_failures();
        routes.report();
    }
    let _ = runtime.block_on(async { session.close().await });
    Ok(())
}
