//! `plumbline ground`: watch vehicles from afar, in the browser and in the terminal.

use super::access::AccessArgs;
mod in_terminal;

use super::{check_outputs, say, stop_on_signal, supervisor};
use anyhow::{Context, Result, bail};
use clap::Args;
use plumbline_ground::connection::StationSession;
use plumbline_ground::fleet::Fleet;
use plumbline_ground::{self as ground, foxglove, web};
use plumbline_link::net::{Endpoints, Mode, NetError, audit, diagnosis, security};
use rustix::process::{Resource, Rlimit, setrlimit};

use parking_lot::Mutex;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Period of the check for the command's end while the connection is opened.
const LOOK: Duration = Duration::from_millis(100);
/// Timeout at the end for what still goes on.
const END_PATIENCE: Duration = Duration::from_millis(300);
/// Data that the process may have, bytes: 25 MB for each of 64 vehicles whose tracks and maps are full. Beyond it the process
/// ends; its supervisor starts it again (docs/security.md).
const MAX_DATA_BYTES: u64 = 1_600_000_000;
/// Endpoint to connect to if none is given.
const DEFAULT_CONNECT: &str = "tcp/127.0.0.1:7447";

/// Arguments of `plumbline ground`.
#[derive(Debug, Args)]
pub struct GroundArgs {
    /// Connect to a vehicle or router, such as tcp/192.168.1.7:7447; may be repeated.
    /// [default: tcp/127.0.0.1:7447, unless --listen is given]
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Listen for vehicles on this endpoint, such as tcp/0.0.0.0:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Show this vehicle only.
    #[arg(long, default_value = "*")]
    pub vehicle: String,
    /// Serve the web page at this address.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    pub http: SocketAddr,
    /// Name by which other hosts may open the page and the Foxglove server, in addition to this host's addresses and host
    /// name; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub http_name: Vec<String>,
    /// Do not serve the web page.
    #[arg(long, conflicts_with = "http")]
    pub no_http: bool,
    /// Serve Foxglove (a WebSocket) at this address, such as 127.0.0.1:8765. Default: not served.
    #[arg(long, value_name = "ADDRESS")]
    pub foxglove: Option<SocketAddr>,
    /// Allow commands from the page even if other hosts can open it.
    #[arg(long)]
    pub allow_commands: bool,
    /// Disable commands from the page.
    #[arg(long, conflicts_with = "allow_commands")]
    pub no_commands: bool,
    /// Print one line per second and vehicle instead of the terminal view.
    #[arg(long)]
    pub plain: bool,
    /// Print a JSON object for each state received.
    #[arg(long, conflicts_with = "plain")]
    pub json: bool,
    /// At the end, write counts of received and lost messages, and their delays (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
    /// Stop after this time, seconds. Default: run until SIGINT or SIGTERM.
    #[arg(long)]
    pub duration: Option<f64>,
    /// Own identity, and peers that are accepted.
    #[command(flatten)]
    pub access: AccessArgs,
}

impl GroundArgs {
    fn endpoints(&self) -> Endpoints {
        let is_silent = self.connect.is_empty() && self.listen.is_empty();
        let connect = if is_silent { vec![DEFAULT_CONNECT.to_owned()] } else { self.connect.clone() };
        let is_client = self.listen.is_empty() && connect.len() == 1;
        let mode = if is_client { Mode::Client } else { Mode::Peer };
        Endpoints { mode, ..self.access.endpoints(&self.vehicle, &self.listen, &connect) }
    }

    /// The page gives commands where only this host can open it, unless told otherwise.
    fn gives_commands(&self) -> bool {
        !self.no_commands && (self.allow_commands || self.http.ip().is_loopback())
    }
}

/// Runs the command.
///
/// # Errors
/// When the network cannot be reached, the page not be served, or the terminal not be used.
pub fn run(args: &GroundArgs) -> Result<()> {
    supervisor::begin_work()?;
    let limit = Rlimit { current: Some(MAX_DATA_BYTES), maximum: Some(MAX_DATA_BYTES) };
    setrlimit(Resource::Data, limit)?;
    check_outputs(&args.report)?;
    let endpoints = args.endpoints();
    endpoints.check()?;
    if let Some(exposure) = security::exposure(&endpoints) {
        tracing::warn!("{exposure}");
    }
    let page = if args.no_http { None } else { Some(web::bind(args.http)?) };
    let foxglove = args.foxglove.map(foxglove::bind).transpose()?;
    let fleet = Arc::new(Mutex::new(Fleet::default()));
    let stop = stop_on_signal()?;
    let end = args.duration.map(|s| supervisor::begun() + Duration::from_secs_f64(s.clamp(0.0, 1e6)));
    let is_over = || {
        audit::log_refusals();
        diagnosis::report_failures();
        stop.load(Ordering::Relaxed) || end.is_some_and(|end| Instant::now() >= end)
    };
    let station = Background::start()?;
    let Some(line) = station.open(&endpoints, &fleet, args.json, &is_over)? else { return Ok(()) };
    let mut about = String::new();
    if let Some(page) = page {
        let address = station.serve(page, &fleet, &line, (args.gives_commands(), &args.http_name))?;
        about = format!("page: http://{address}");
        if !args.json {
            say(format_args!("the page is at http://{address}"));
        }
    }
    if let Some(listener) = foxglove {
        let serving = foxglove::serve(listener, Arc::clone(&fleet), line.clone(), &args.http_name);
        let address = station.runtime().block_on(serving)?;
        about.push_str(&format!("{}foxglove: ws://{address}", if about.is_empty() { "" } else { ", " }));
        if !args.json {
            say(format_args!("Foxglove is served at ws://{address}"));
        }
    }
    let outcome = if args.json {
        ground::wait(&is_over);
        Ok(())
    } else {
        show(args, &fleet, &about, &is_over)
    };
    if let Some(path) = &args.report {
        ground::report::write(path, &fleet.lock()).with_context(|| format!("{}", path.display()))?;
    }
    station.close(&line);
    outcome?;
    if args.duration.is_some() && !stop.load(Ordering::Relaxed) && fleet.lock().vehicles.is_empty() {
        let cause = diagnosis::newest_failure().unwrap_or_else(|| {
            "is a vehicle flying with --publish, and does it reach the same network?".into()
        });
        bail!("no vehicle received: {cause}");
    }
    Ok(())
}

/// Shows the fleet: the view where there is a terminal, else lines.
fn show(
    args: &GroundArgs,
    fleet: &Mutex<Fleet>,
    about: &str,
    is_over: &impl Fn() -> bool,
) -> std::io::Result<()> {
    if args.plain || !std::io::IsTerminal::is_terminal(&std::io::stdout()) {
        return ground::print_lines(fleet, is_over);
    }
    in_terminal::show(fleet, about, is_over)
}

/// The threads of the network and of the page. However the command ends, they end soon after: Zenoh waits for its first
/// connection without letting go of its thread.
pub(super) struct Background(Option<tokio::runtime::Runtime>);

impl Background {
    pub(super) fn start() -> std::io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        Ok(Self(Some(runtime)))
    }

    fn runtime(&self) -> &tokio::runtime::Runtime {
        self.0.as_ref().unwrap_or_else(|| unreachable!("it is taken when the station is dropped"))
    }

    /// Opens the connection; `None` when the command is over before that is done.
    pub(super) fn open(
        &self,
        endpoints: &Endpoints,
        fleet: &Arc<Mutex<Fleet>>,
        print_states: bool,
        is_over: &impl Fn() -> bool,
    ) -> Result<Option<StationSession>, NetError> {
        let (endpoints, fleet) = (endpoints.clone(), Arc::clone(fleet));
        let (done, opened) = std::sync::mpsc::sync_channel(1);
        self.runtime().spawn(async move {
            let _ = done.send(StationSession::open(&endpoints, &fleet, print_states).await);
        });
        while !is_over() {
            if let Ok(outcome) = opened.recv_timeout(LOOK) {
                return outcome.map(Some);
            }
        }
        Ok(None)
    }

    pub(super) fn serve(
        &self,
        page: std::net::TcpListener,
        fleet: &Arc<Mutex<Fleet>>,
        line: &StationSession,
        (gives_commands, names): (bool, &[String]),
    ) -> Result<SocketAddr> {
        let serving = web::serve(page, Arc::clone(fleet), line.clone(), gives_commands, names);
        Ok(self.runtime().block_on(serving)?)
    }

    /// Takes the station off the network, if that goes quickly.
    pub(super) fn close(&self, line: &StationSession) {
        let line = line.clone();
        let closing = self.runtime().spawn(async move { line.close().await });
        let _ = self.runtime().block_on(async { tokio::time::timeout(END_PATIENCE, closing).await });
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_timeout(END_PATIENCE);
        }
    }
}
