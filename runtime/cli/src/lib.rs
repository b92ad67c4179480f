//! The command line: arguments in, exit status out.
//!
//! 0 success, 1 the run failed, 2 wrong usage or configuration, 3 a fault of the program in flight ([`exit_status`]); a failure is one line on stderr that
//! names the file, the key or the device, and what to do.

#[cfg(feature = "lab")]
pub mod ablation;
pub mod access;
#[cfg(feature = "lab")]
mod bench;
#[cfg(feature = "lab")]
mod calibrate;
#[cfg(feature = "lab")]
pub mod campaign;
#[cfg(feature = "lab")]
pub mod choice;
mod config;
#[cfg(feature = "ground")]
mod demo;
pub mod devices;
mod doctor;
pub mod evaluate;
mod exit_status;
pub mod fly;
mod fly_status;
#[cfg(feature = "ground")]
mod ground;
mod keys;
mod left_out;
#[cfg(feature = "lab")]
pub mod lines;
mod link;
mod link_process;
pub mod log;
mod log_lines;
mod man;
mod map;
#[cfg(test)]
mod message_options;
#[cfg(feature = "lab")]
mod paired;
#[cfg(feature = "lab")]
pub mod plot;
mod progress;
#[cfg(feature = "ground")]
mod remote;
pub mod replay;
#[cfg(feature = "lab")]
pub mod report;
#[cfg(feature = "ground")]
mod reset;
mod router;
pub mod scenario;
mod setup;
#[cfg(feature = "lab")]
pub mod shuttle;
mod signals;
pub mod simulate;
mod simulated;
mod supervisor;
#[cfg(feature = "lab")]
pub mod sweep;
pub mod topics;
pub mod verify;

pub use signals::stop_on_signal;

use clap::{CommandFactory, Parser, Subcommand};
use plumbline_config::{Config, ConfigError, ValidConfig};
use plumbline_link::net::{audit, threads};
use std::fmt::Display;
use std::io::{IsTerminal as _, Write as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Deterministic real-time visual-inertial odometry for drones.
#[derive(Debug, Parser)]
#[command(name = "plumbline", version, after_help = examples())]
struct Cli {
    /// More log messages (-v, -vv); the environment variable RUST_LOG overrides it.
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    verbose: u8,
    #[command(subcommand)]
    command: Command,
}

fn examples() -> String {
    let ground = if cfg!(feature = "ground") {
        "  plumbline demo                                    a simulated flight, live
  plumbline ground --connect tcp/127.0.0.1:7447     watch the vehicles on a network
"
    } else {
        ""
    };
    let lab = if cfg!(feature = "lab") {
        "  plumbline plot out.tum --truth V1_01_easy --out flight.svg   draw it
  plumbline lines image.png --out lines.png         draw the line segments of one image
"
    } else {
        ""
    };
    format!(
        "Examples:
{ground}  plumbline replay V1_01_easy --trajectory out.tum  a EuRoC data set, as fast as possible
  plumbline replay sim:hall --duration 20           a simulated flight, not written to disk
  plumbline devices                                 list the connected cameras and IMUs
  plumbline setup realsense --out drone.toml        configure a connected camera
  plumbline fly --config drone.toml                 a live flight with these sensors
  plumbline replay V1_01_easy --record log.mcap     record the flight
  plumbline verify log.mcap                         execute it again, and compare all outputs bit for bit
  plumbline evaluate out.tum V1_01_easy             ATE and RPE, computed as evo_ape and evo_rpe do
{lab}
Exit status: 0 success; 1 the run failed; 2 wrong usage or configuration, or an input that is missing or unusable; 3 an \
internal fault ended a task of a live flight: restart the program, as the systemd unit does."
    )
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fly a simulated vehicle at 1x, and publish it on the loopback interface.
    #[cfg(feature = "ground")]
    Demo(demo::DemoArgs),
    /// Fly live with the configured cameras and IMU.
    Fly(fly::FlyArgs),
    /// Run the estimator over a recorded or simulated flight.
    Replay(Box<replay::ReplayArgs>),
    /// Execute a recorded flight again, and compare every output bit for bit.
    Verify(verify::VerifyArgs),
    /// List the contents of a flight log.
    Log(log::LogArgs),
    /// Write a simulated flight as a EuRoC data set.
    Simulate(simulate::SimulateArgs),
    /// Compare a trajectory with its ground truth.
    Evaluate(evaluate::EvaluateArgs),
    /// Pack what is known of a flight into one archive, to send with a question: without keys, addresses, names and images.
    #[cfg(feature = "lab")]
    Report(report::ReportArgs),
    /// Measure the drift of a recording without ground truth: fly it there and back.
    #[cfg(feature = "lab")]
    Shuttle(Box<shuttle::ShuttleArgs>),
    /// Draw a flight: path over the truth, errors, covariance, velocity and biases over time.
    #[cfg(feature = "lab")]
    Plot(plot::PlotArgs),
    /// Extract the line segments of one image, and draw them.
    #[cfg(feature = "lab")]
    Lines(lines::LinesArgs),
    /// Build and join maps, locate images in them, and list their contents.
    Map(map::MapArgs),
    /// Monitor vehicles over the network: a web page, and a view in the terminal.
    #[cfg(feature = "ground")]
    Ground(ground::GroundArgs),
    /// Relay messages between vehicles and ground stations that cannot reach each other.
    Router(router::RouterArgs),
    /// Publish a flight over the network, read from its local socket. `fly` and `replay --publish` start this process
    /// themselves.
    Link(link::LinkArgs),
    /// Reset the estimator of a vehicle over the network.
    #[cfg(feature = "ground")]
    Reset(reset::ResetArgs),
    /// Make certificates for vehicles and ground stations.
    Keys(keys::KeysArgs),
    /// Fly the built-in set of simulated flights, with and without faults, and tabulate the errors. See also `sweep`
    /// (compares settings) and `ablation` (benefit of lines).
    #[cfg(feature = "lab")]
    Campaign(campaign::CampaignArgs),
    /// Compare the accuracy with points only and with raw, filtered and merged line segments, over data sets or the
    /// flights of `campaign`.
    #[cfg(feature = "lab")]
    Ablation(ablation::AblationArgs),
    /// Fly every combination of settings on several data sets, on all cores, and tabulate the errors.
    #[cfg(feature = "lab")]
    Sweep(sweep::SweepArgs),
    /// Measure the cost of a standard load on this machine, and compare it with an earlier measurement.
    #[cfg(feature = "lab")]
    Bench(bench::BenchArgs),
    /// List cameras (formats, rates, controls), serial ports and inertial sensors, with their names for the
    /// configuration.
    Devices(devices::DevicesArgs),
    /// Set up a connected rig: find it, read its calibration, write a configuration, set emitter and exposure, and run the
    /// doctor.
    Setup(Box<setup::SetupArgs>),
    /// Calibrate the sensors: cameras from images of a board, noise of the IMU, pose of the cameras on the IMU.
    #[cfg(feature = "lab")]
    Calibrate(calibrate::CalibrateArgs),
    /// Check whether this host and a configuration are fit for a flight.
    Doctor(doctor::DoctorArgs),
    /// Check a configuration file, print a preset, or import a calibration.
    Config(config::ConfigArgs),
    /// Print the completion script of a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Write the manual pages of all commands into a folder, for `man`.
    Man(man::ManArgs),
}

impl Command {
    /// True if messages reach this process over Zenoh as long as it runs.
    fn has_network(&self) -> bool {
        #[cfg(feature = "ground")]
        if matches!(self, Self::Demo(_) | Self::Ground(_)) {
            return true;
        }
        matches!(self, Self::Router(_) | Self::Link(_))
    }

    /// Name of a command that runs under a supervisor, which starts it again after a fault.
    fn supervised(&self) -> Option<&'static str> {
        match self {
            #[cfg(feature = "ground")]
            Self::Ground(_) => Some("the ground station"),
            Self::Router(_) => Some("the router"),
            _ => None,
        }
    }
}

/// Runs the command line of this process.
#[must_use]
pub fn main() -> ExitCode {
    if let Some(refusal) = left_out::command(std::env::args().skip(1)) {
        eprintln!("plumbline: {refusal}");
        return ExitCode::from(exit_status::exit_status(&refusal.into()));
    }
    let cli = Cli::parse();
    let supervised = cli.command.supervised().filter(|_| !supervisor::is_worker());
    if cli.command.has_network() && supervised.is_none() {
        lay_out_threads();
    }
    init_logs(cli.verbose, matches!(cli.command, Command::Fly(_)));
    let ended = match supervised {
        Some(name) => supervisor::run(name),
        None => run(cli.command).map(|()| ExitCode::SUCCESS),
    };
    log_lines::flush();
    match ended {
        Ok(status) => status,
        Err(error) => {
            // A terminal that is gone takes no words, and that is no reason to panic; nor is one that stands still.
            let words = format!("plumbline: {}\n", one_line(&error));
            within(PATIENCE, move || drop(std::io::stderr().write_all(words.as_bytes())));
            ExitCode::from(exit_status::exit_status(&error))
        }
    }
}

/// Begins the program anew with the layout of Zenoh's threads in its environment, from which alone Zenoh takes it; where that
/// cannot be done, it goes on with another layout.
fn lay_out_threads() {
    if std::env::var_os(threads::VARIABLE).is_none()
        && let Ok(program) = std::env::current_exe()
    {
        let mut again = std::process::Command::new(program);
        let _ = again.args(std::env::args_os().skip(1)).env(threads::VARIABLE, threads::LAYOUT).exec();
    }
}

/// Longest time that the last output of a command waits for the terminal.
const PATIENCE: Duration = Duration::from_secs(1);

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        #[cfg(feature = "ground")]
        Command::Demo(args) => demo::run(&args),
        Command::Fly(args) => fly::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Log(args) => log::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        #[cfg(feature = "lab")]
        Command::Report(args) => report::run(&args),
        #[cfg(feature = "lab")]
        Command::Shuttle(args) => shuttle::run(&args),
        #[cfg(feature = "lab")]
        Command::Plot(args) => plot::run(&args),
        #[cfg(feature = "lab")]
        Command::Lines(args) => lines::run(&args),
        Command::Map(args) => map::run(&args),
        #[cfg(feature = "ground")]
        Command::Ground(args) => ground::run(&args),
        Command::Router(args) => router::run(&args),
        Command::Link(args) => link::run(&args),
        #[cfg(feature = "ground")]
        Command::Reset(args) => reset::run(&args),
        Command::Keys(args) => keys::run(&args),
        #[cfg(feature = "lab")]
        Command::Campaign(args) => campaign::run(&args),
        #[cfg(feature = "lab")]
        Command::Ablation(args) => ablation::run(&args),
        #[cfg(feature = "lab")]
        Command::Sweep(args) => sweep::run(&args),
        #[cfg(feature = "lab")]
        Command::Bench(args) => bench::run(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Setup(args) => setup::run(&args),
        #[cfg(feature = "lab")]
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Config(args) => config::run(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "plumbline", &mut script);
            say(String::from_utf8_lossy(&script).trim_end());
            Ok(())
        }
        Command::Man(args) => man::run(Cli::command(), &args),
    }
}

/// Writes a line to stdout. A reader that has gone, as `head` does, ends the process: nobody listens, which is no failure.
pub fn say(line: impl Display) {
    say_unless_closed(false, line);
}

/// Writes a line to stdout. A closed pipe ends the process, as in [`say`], unless it `goes_on`: there are files to write.
pub fn say_unless_closed(goes_on: bool, line: impl Display) {
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if goes_on && error.kind() == std::io::ErrorKind::BrokenPipe => {}
        Err(error) => std::process::exit(i32::from(error.kind() != std::io::ErrorKind::BrokenPipe)),
        Ok(()) => {}
    }
}

/// Writes a line to stdout, waiting at most `patience` for a stalled terminal or a reader that does not read.
pub fn say_within(patience: Duration, line: String) {
    within(patience, move || say(line));
}

/// Waits for `speak`, but not for longer than `patience`: the process ends, whoever reads it.
fn within(patience: Duration, speak: impl FnOnce() + Send + 'static) {
    let (tell, told) = std::sync::mpsc::channel();
    let speak = move || {
        speak();
        let _ = tell.send(());
    };
    if std::thread::Builder::new().name("last-words".into()).spawn(speak).is_ok() {
        let _ = told.recv_timeout(patience);
    }
}

/// A failure of usage: exit status 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// The error and its causes on one line.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // A cause that its context already quotes says nothing new.
        if !line.contains(&cause) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&cause);
        }
    }
    line.split('\n').map(str::trim).filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}

/// Logs warnings; of a live flight (`is_live`) also what it says of itself.
fn init_logs(verbose: u8, is_live: bool) {
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::util::SubscriberInitExt as _;
    use tracing_subscriber::{EnvFilter, Layer as _};

    // Attempts to connect are many; the audit logs the cause of those that fail, and handshakes that were refused. That peers
    // do not gossip is meant. Data of a peer that has just gone are nothing to act on.
    let default = [
        "warn,zenoh::net::runtime::orchestrator=error,zenoh_link_tls::unicast=error,zenoh::net::routing::hat::peer=error,zenoh::api::session=off,zenoh_transport::unicast::establishment=off",
        "info,zenoh=warn,zenoh::net::runtime::orchestrator=error,zenoh_link_tls::unicast=error,zenoh::net::routing::hat::peer=error,zenoh::api::session=off,zenoh_transport::unicast::establishment=off",
        "debug",
    ][usize::from(verbose.min(2))];
    let live = if is_live && verbose == 0 { ",plumbline=info,plumbline_flight=info" } else { "" };
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(format!("{default}{live}")));
    // Colours are for people: https://no-color.org.
    let is_coloured =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let lines = tracing_subscriber::fmt::layer()
        .log_internal_errors(false)
        .with_writer(log_lines::LogLines)
        .with_ansi(is_coloured)
        .with_target(verbose > 0)
        .without_time();
    let access = tracing_subscriber::filter::Targets::new().with_targets(audit::TARGETS);
    tracing_subscriber::registry()
        .with(lines.with_filter(filter))
        .with(audit::Audit.with_filter(access))
        .init();
    log_lines::start();
    log_lines::take_panics();
}

/// A configuration file or preset, if one is named.
///
/// # Errors
/// When it cannot be used.
pub fn load_config(file: Option<&Path>) -> Result<Option<ValidConfig>, ConfigError> {
    file.map(Config::load_or_preset).transpose()
}

/// Refuses a map that nothing could be put into: with one camera there is no depth, and so no place to be recognized.
///
/// # Errors
/// When a map is read or written with one camera, or with places switched off.
pub fn check_maps(config: &ValidConfig, reads: bool, writes: bool) -> Result<(), Usage> {
    let option = match (reads, writes) {
        (true, _) => "--map",
        (false, true) => "--save-map",
        (false, false) => return Ok(()),
    };
    if config.camera.len() < 2 {
        return Err(Usage(format!(
            "{option}: a map needs two cameras, and there is one; leave it out, or add the second [[camera]]"
        )));
    }
    if !config.estimator.places.enabled {
        return Err(Usage(format!(
            "{option}: estimator.places.enabled is false, so no map is made; leave it out, or set that to true"
        )));
    }
    Ok(())
}

/// Refuses an output that needs the vehicle's attitude while the mounting of the IMU is unknown.
///
/// # Errors
/// When it is.
pub fn check_mounting(config: &ValidConfig) -> Result<(), Usage> {
    use plumbline_config::options::VehicleConfig;

    match config.vehicle.rot_v_b() {
        Some(_) => Ok(()),
        None => Err(Usage(format!(
            "{}, and ROS 2 (ros.enabled) would receive a wrong attitude: {}",
            VehicleConfig::UNKNOWN,
            VehicleConfig::CURE
        ))),
    }
}

/// Refuses output files that could not be written, before the run rather than after it: what cannot be opened, and two
/// outputs in one file.
///
/// # Errors
/// When one cannot be opened for writing, or is named twice.
pub fn check_outputs<'a>(files: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Usage> {
    let mut seen: Vec<&PathBuf> = Vec::new();
    for file in files {
        let refuse = |why: &str| Err(Usage(format!("{}: {why}", file.display())));
        if seen.contains(&file) {
            return refuse("is the path of two outputs; name two files");
        }
        seen.push(file);
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
        if folder.is_some_and(|folder| !folder.is_dir()) {
            return refuse("its directory does not exist; create it first");
        }
        if file.is_dir() || file.as_os_str().as_encoded_bytes().ends_with(b"/") {
            return refuse("is a directory; name a file to write");
        }
        if let Err(error) = try_writing(file) {
            return refuse(&format!("cannot be written ({error}); name another file"));
        }
    }
    Ok(())
}

/// Opens a file for writing and leaves it as it was.
fn try_writing(file: &Path) -> std::io::Result<()> {
    if file.exists() {
        return std::fs::OpenOptions::new().append(true).open(file).map(drop);
    }
    std::fs::OpenOptions::new().write(true).create_new(true).open(file)?;
    std::fs::remove_file(file)
}

/// `A..B`, both optional, as a pair.
///
/// # Errors
/// When it is not a range.
pub fn parse_range<T: std::str::FromStr + PartialOrd + Copy>(
    text: &str,
) -> Result<(Option<T>, Option<T>), String> {
    let bad = || format!("'{text}' is not a range: write A..B, such as 5..10");
    let (from, to) = text.split_once("..").ok_or_else(bad)?;
    let part = |s: &str| if s.is_empty() { Ok(None) } else { s.parse().map(Some).map_err(|_| bad()) };
    let (from, to) = (part(from)?, part(to)?);
    match (from, to) {
        (Some(a), Some(b)) if a >= b => Err(format!("'{text}' is an empty range")),
        range => Ok(range),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn ranges_are_half_open_and_checked() {
        assert_eq!(parse_range::<f64>("5..7.5"), Ok((Some(5.0), Some(7.5))));
        assert_eq!(parse_range::<usize>("3.."), Ok((Some(3), None)));
        assert!(parse_range::<usize>("7..3").is_err() && parse_range::<usize>("x").is_err());
    }
}
