//! `plumbline fly`: live, from the sensors that a configuration names.

use super::exit_status::last_resort;
use super::link_process::start_socket;
use super::run_args::{RunArgs, check_recording};
use super::signals::stop_in_flight;
use super::{Usage, check_maps, check_mounting, check_outputs, fly_status, load_config, say_within};
use anyhow::{Context, Result};
use clap::Args;
use plumbline_config::ValidConfig;
use plumbline_config::options::VehicleConfig;
use plumbline_drivers::StopFlag;
use plumbline_flight::flight::plausibility::Finding;
use plumbline_flight::flight::plausibility::watch::Watch;
use plumbline_flight::flight::sensor_watch::SensorWatch;
use plumbline_flight::flight::{
    Flight, FlightError, Flown, Outputs, first_reset_counter, fly, open_sensors, plausibility, with_overrides,
};
use plumbline_flight::local::SensorBoard;
use plumbline_flight::log::{LogError, WhenFull};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::report::Report;
use plumbline_link::process::has_network;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Arguments of `plumbline fly`.
#[derive(Debug, Args)]
#[command(after_help = "\
driver.imu configures the IMU, driver.v4l2 or driver.frames the cameras; `plumbline devices` lists the connected sensors. \
Sensors may be missing at the start and may be unplugged in flight: they are used as soon as they are available. \
Ctrl-C (SIGINT) or SIGTERM ends the flight; the report is then written.

Examples:
  plumbline devices                                    list the connected sensors, by stable names
  plumbline config euroc > drone.toml                  a preset with every key explained: edit calibration and drivers
  plumbline doctor --config drone.toml                 check this computer
  plumbline fly --config drone.toml --record /var/log  write a log of each flight into a folder")]
pub struct FlyArgs {
    /// Configuration file: calibration, sensors, outputs.
    #[arg(long)]
    pub config: PathBuf,
    /// Options of the run.
    #[command(flatten)]
    pub run: RunArgs,
    /// Folder for state kept across restarts, such as the reset counter. Default: `$STATE_DIRECTORY`, which systemd
    /// sets.
    #[arg(long, value_name = "FOLDER")]
    pub state: Option<PathBuf>,
    /// Stop after S seconds. Default: run until SIGINT or SIGTERM.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Number of threads that track a frame. The window always has a thread of its own.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
}

/// Longest time that the summary of a flight waits for the terminal.
const PATIENCE: Duration = Duration::from_secs(1);

/// Runs the command.
///
/// # Errors
/// When the configuration or a device cannot be used, or the run fails.
pub fn run(args: &FlyArgs) -> Result<()> {
    if args.duration.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
        return Err(Usage("--duration: give a positive number of seconds".into()).into());
    }
    check_outputs(args.run.files())?;
    let log = args.run.log()?;
    let config = config(args)?;
    check_maps(&config, args.run.map.is_some(), args.run.save_map.is_some())?;
    let stop = stop_in_flight()?;
    let (mut flight, sensors) = open_sensors(&config, &StopFlag::of(Arc::clone(&stop)))
        .with_context(|| format!("{}", args.config.display()))?;
    args.run.take_map(&mut flight)?;
    flight.first_reset_counter = state_folder(args).map_or(0, |folder| first_reset_counter(&folder));
    let control = Arc::new(Control::stopped_by(Arc::clone(&stop)).with_last_resort(last_resort));
    let (mut outputs, board) = start_outputs(args, &flight, log.as_deref(), &control)?;
    if config.vehicle.rot_v_b().is_none() {
        let (unknown, cure) = (VehicleConfig::UNKNOWN, VehicleConfig::CURE);
        tracing::warn!("{unknown}: nothing that depends on the vehicle's attitude is published; {cure}");
    }
    let mut watch = Watch::start(&config, true, Vec::new(), board.clone())?;
    let sensor_watch = SensorWatch::start(&sensors, board)?;
    let mut progress = fly_status::start(sensor_watch.notices())?;
    let end = args.duration.map(|s| End::after(Duration::from_secs_f64(s), &stop)).transpose()?;
    let options = RunOptions { speed: Some(1.0), threads: usize::from(args.threads) };
    let mut subscribers = outputs.subscribers();
    subscribers.push(&mut progress);
    subscribers.push(&mut watch);
    // Also of a flight that a fault has ended the autopilot is told, and the log is written.
    let (flown, outputs) = (fly(flight, &options, &control, subscribers), outputs.finish());
    let flown = flown?;
    progress.finish();
    drop(sensor_watch);
    let is_over = end.is_some_and(End::has_come);
    let report = Report::new(&flown).with(outputs).of_sensors(&sensors).warning_of(warnings(watch, &flown));
    say_within(PATIENCE, args.run.write(&flown, &report)?);
    let frames = report.frames;
    anyhow::ensure!(
        !is_over || report.completion > 0.0,
        "no pose was found in {frames} frames: {}; see `sensors` of the report",
        report.why_no_pose()
    );
    check_recording(&report)
}

fn config(args: &FlyArgs) -> Result<ValidConfig> {
    let config = load_config(Some(&args.config))?;
    let config = config.ok_or_else(|| Usage("--config: name a configuration".into()))?;
    Ok(with_overrides(&config, &args.run.overrides)?)
}

/// Starts the outputs that the configuration names; also returns where the state of the sensors is posted for the local socket.
fn start_outputs(
    args: &FlyArgs,
    flight: &Flight,
    log: Option<&Path>,
    control: &Arc<Control>,
) -> Result<(Outputs, Option<SensorBoard>)> {
    let config = &flight.config;
    check_mounting(config)?;
    let mut outputs = Outputs::default();
    if !config.autopilot.connect.is_empty() {
        outputs.pilot(flight, control)?;
    }
    if let Some(path) = log {
        record(&mut outputs, path, flight)?;
    }
    if let Some(path) = &args.run.save_map {
        outputs.save_map(path, control)?;
    }
    let link = args.run.link(true);
    let link = (has_network(&config.network, &link) || config.ros.enabled).then_some(link);
    let is_heard = link.is_some() || !config.local.path.is_empty();
    if !is_heard && config.autopilot.connect.is_empty() && log.is_none() {
        tracing::warn!(
            "the flight has no outputs: name an autopilot (autopilot.connect), a network (network.listen or --listen), or \
             --record"
        );
    }
    let board = start_socket(&mut outputs, flight, control, link)?;
    Ok((outputs, board))
}

/// Records the flight; a disk that takes no log keeps nobody from flying.
fn record(outputs: &mut Outputs, path: &Path, flight: &Flight) -> Result<(), FlightError> {
    match outputs.record(path, flight, WhenFull::Drop) {
        Err(FlightError::Log(error @ LogError::Io { .. })) => {
            tracing::error!("{error}: the flight is not recorded");
            Ok(())
        }
        outcome => outcome,
    }
}

/// Folder of what is to outlast the program, if there is one.
fn state_folder(args: &FlyArgs) -> Option<PathBuf> {
    let of_systemd = || std::env::var("STATE_DIRECTORY").ok().filter(|names| !names.is_empty());
    // Of several, the first.
    let first = |names: String| names.split(':').next().map(PathBuf::from);
    args.state.clone().or_else(|| of_systemd().and_then(first))
}

/// All that is wrong with what was flown.
fn warnings(watch: Watch, flown: &Flown) -> Vec<Finding> {
    let mut warnings = watch.finish();
    if warnings.iter().any(|finding| finding.explains_all) {
        return warnings;
    }
    let (faults, frames) = (&flown.outcome.faults, flown.outcome.figures.frames);
    let of_faults = plausibility::of_faults(faults.imu, faults.cameras, None);
    for finding in
        of_faults.into_iter().chain(plausibility::of_stamps(faults.imu, faults.cameras, frames, true))
    {
        tracing::warn!("{finding}");
        warnings.push(finding);
    }
    warnings
}

/// Ends a flight after a time.
struct End {
    cancel: Sender<()>,
    thread: JoinHandle<bool>,
}

impl End {
    fn after(time: Duration, stop: &Arc<AtomicBool>) -> std::io::Result<Self> {
        let (cancel, cancelled) = channel();
        let stop = Arc::clone(stop);
        let thread = std::thread::Builder::new().name("end".into()).spawn(move || {
            let has_come = cancelled.recv_timeout(time) == Err(RecvTimeoutError::Timeout);
            if has_come {
                stop.store(true, Ordering::Relaxed);
            }
            has_come
        })?;
        Ok(Self { cancel, thread })
    }

    /// True if the time was over before anything else ended the flight.
    fn has_come(self) -> bool {
        drop(self.cancel);
        self.thread.join().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_ends_after_its_time_or_before() {
        let stop = Arc::new(AtomicBool::new(false));
        assert!(!End::after(Duration::from_secs(60), &stop).unwrap().has_come());
        assert!(!stop.load(Ordering::Relaxed));
        let end = End::after(Duration::from_millis(1), &stop).unwrap();
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(end.has_come());
    }
}
