//! `plumbline fly`: live, from the sensors that a configuration names.

use super::exit_status::last_resort;
use super::fly_status::FlyStatus;
use super::learn::write_learnt;
use super::link_process::LinkProcess;
use super::progress::{Glance, Progress};
use super::signals::stop_in_flight;
use super::{Usage, check_maps, check_mounting, check_outputs, load_config, say_within};
use anyhow::{Context, Result};
use clap::Args;
use plumbline_config::ValidConfig;
use plumbline_config::options::VehicleConfig;
use plumbline_drivers::tum::write_tum;
use plumbline_drivers::{StampedPose, StopFlag};
use plumbline_estimator::places::Mapper;
use plumbline_flight::flight::plausibility::Finding;
use plumbline_flight::flight::plausibility::watch::Watch;
use plumbline_flight::flight::sensor_watch::{SensorNotices, SensorWatch};
use plumbline_flight::flight::{
    Flight, FlightError, Flown, Outputs, ResetCount, fly, is_log, open_sensors, plausibility, with_overrides,
};
use plumbline_flight::local::{LocalSocket, SensorBoard};
use plumbline_flight::log::{LogError, WhenFull};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_flight::places::{MapContents, read_known_map, write_map};
use plumbline_lab::report::Report;
use plumbline_link::process::{LinkOptions, has_network};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Arguments of `plumbline fly`.
// Help texts name tables of the configuration in brackets.
#[allow(rustdoc::broken_intra_doc_links)]
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
    /// Change a key of the configuration, such as driver.imu.delay_s=0.0025; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Record the flight to this file, or to a new file in this folder, named by the time (UTC). [recorder] of the
    /// configuration sets the contents.
    #[arg(long, value_name = "LOG.mcap|FOLDER")]
    pub record: Option<PathBuf>,
    /// Write the report (JSON) at the end.
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
    /// Write the configuration with the calibration that this flight has refined at the end, for --config of the next.
    #[arg(long, value_name = "OUT.toml")]
    pub learn: Option<PathBuf>,
    /// Write the causal trajectory (TUM format) at the end: at most the first 36,000 frames.
    #[arg(long, value_name = "OUT.tum")]
    pub trajectory: Option<PathBuf>,
    /// Continue this map. After a place in it has been recognized, poses are output in its frame too.
    #[arg(long, value_name = "IN.map")]
    pub map: Option<PathBuf>,
    /// Write the map of the flight, including the map of --map, at the end and on each `plumbline map save`.
    #[arg(long, value_name = "OUT.map")]
    pub save_map: Option<PathBuf>,
    /// Publish over Zenoh: listen on this endpoint in addition to network.listen, such as tcp/0.0.0.0:7447; may be
    /// repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Publish over Zenoh: connect to this router or ground station in addition to network.connect; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
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
    /// Print the report as JSON instead of the summary.
    #[arg(long)]
    pub json: bool,
}

/// Logs that a folder may hold of one second.
const MAX_LOGS_A_SECOND: usize = 10_000;
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
    check_outputs([&args.report, &args.trajectory, &args.save_map, &args.learn].into_iter().flatten())?;
    let log = args.record.as_deref().map(|path| log_path(path, SystemTime::now())).transpose()?;
    let config = config(args)?;
    check_maps(&config, args.map.is_some(), args.save_map.is_some())?;
    let stop = stop_in_flight()?;
    let (mut flight, sensors) = open_sensors(&config, &StopFlag::of(Arc::clone(&stop)))
        .with_context(|| format!("{}", args.config.display()))?;
    if let Some(path) = &args.map {
        flight.map = Some(read_known_map(path, Mapper::limits(config.setup()))?);
    }
    let mut resets = state_folder(args).map(|folder| ResetCount::resume(&folder));
    flight.first_reset_counter = resets.as_ref().map_or(0, ResetCount::first);
    let control = Arc::new(Control::stopped_by(Arc::clone(&stop)).with_last_resort(last_resort));
    let (mut outputs, board) = start_outputs(args, &flight, log.as_deref(), &control)?;
    let mut watch = Watch::start(&config, true, findings(&config), board.clone())?;
    let sensor_watch = SensorWatch::start(&sensors, board)?;
    let mut progress = start_progress(sensor_watch.notices())?;
    let end = args.duration.map(|s| End::after(Duration::from_secs_f64(s), &stop)).transpose()?;
    let options = RunOptions { speed: Some(1.0), threads: usize::from(args.threads) };
    let mut subscribers = outputs.subscribers();
    subscribers.push(&mut progress);
    subscribers.push(&mut watch);
    if let Some(resets) = &mut resets {
        subscribers.push(resets);
    }
    // Also of a flight that a fault has ended the autopilot is told, and the log is written.
    let (flown, outputs) = (fly(flight, &options, &control, subscribers), outputs.finish());
    let flown = flown?;
    progress.finish();
    drop(sensor_watch);
    let is_over = end.is_some_and(End::has_come);
    let report = Report::new(&flown).with(outputs).of_sensors(&sensors).warning_of(warnings(watch, &flown));
    write_outputs(args, &flown, &report)?;
    let frames = report.frames;
    anyhow::ensure!(
        !is_over || report.completion > 0.0,
        "no pose was found in {frames} frames: {}; see `sensors` of the report",
        report.why_no_pose()
    );
    if let Some(recording) = report.recording.as_ref().filter(|recording| recording.has_failed) {
        anyhow::bail!("the recording failed: {recording}");
    }
    Ok(())
}

fn config(args: &FlyArgs) -> Result<ValidConfig> {
    let config = load_config(Some(&args.config))?;
    let config = config.ok_or_else(|| Usage("--config: name a configuration".into()))?;
    Ok(with_overrides(&config, &args.overrides)?)
}

/// Where the flight is recorded: the file that was named, or a new one in the folder that was. A name that ends in `/` is one of
/// a folder, which is made.
fn log_path(named: &Path, now: SystemTime) -> Result<PathBuf, Usage> {
    let is_folder = named.as_os_str().as_encoded_bytes().ends_with(b"/");
    if is_folder && !named.exists() {
        std::fs::create_dir_all(named).map_err(|error| {
            Usage(format!("--record {}: the folder cannot be made ({error}); name another", named.display()))
        })?;
    }
    if named.is_dir() {
        let now = time::OffsetDateTime::from(now);
        let (date, time) = (now.date(), now.time());
        let (month, day) = (u8::from(date.month()), date.day());
        let (hour, minute, second) = time.as_hms();
        let year = date.year();
        let name = format!("{year:04}-{month:02}-{day:02}T{hour:02}-{minute:02}-{second:02}Z");
        // A computer without a clock of its own may begin with the same second each time, and must fly all the same.
        let numbered = (2..).map(|k| named.join(format!("{name}-{k}.mcap")));
        let names = std::iter::once(named.join(format!("{name}.mcap"))).chain(numbered);
        return names.take(MAX_LOGS_A_SECOND).find(|path| !path.exists()).ok_or_else(|| {
            Usage(format!("--record {}: too many logs named {name}; name another folder", named.display()))
        });
    }
    if !is_log(named) {
        let named = named.display();
        return Err(Usage(format!(
            "--record {named}: name a file with the ending .mcap, an existing folder, or a new one with `/` at its end"
        )));
    }
    Ok(named.to_owned())
}

/// Findings about the configuration before the first sample.
fn findings(config: &ValidConfig) -> Vec<Finding> {
    let is_unknown = config.vehicle.rot_v_b().is_none();
    let mounting = || {
        Finding::new(
            VehicleConfig::UNKNOWN,
            "mounting unknown",
            "a configuration that was imported without it",
            format!("nothing that depends on the vehicle's attitude is published; {}", VehicleConfig::CURE),
        )
    };
    is_unknown.then(mounting).into_iter().collect()
}

/// Starts the outputs that the configuration names; also returns where the state of the sensors is posted for the local socket.
fn start_outputs(
    args: &FlyArgs,
    flight: &Flight,
    log: Option<&Path>,
    control: &Arc<Control>,
) -> Result<(Outputs, Option<SensorBoard>)> {
    let config = &flight.config;
    if config.ros.enabled {
        check_mounting(config)?;
    }
    let (mut outputs, mut board) = (Outputs::default(), None);
    if !config.autopilot.connect.is_empty() {
        outputs.pilot(flight, control)?;
    }
    if let Some(path) = log {
        record(&mut outputs, path, flight)?;
    }
    if let Some(path) = &args.save_map {
        outputs.save_map(path, control)?;
    }
    let link = LinkOptions {
        listen: args.listen.clone(),
        connect: args.connect.clone(),
        publish: false,
        is_patient: true,
    };
    let has_network = has_network(&config.network, &link) || config.ros.enabled;
    if has_network || !config.local.path.is_empty() {
        let socket = LocalSocket::start(config, flight.stamps, Arc::clone(control))?;
        let door = socket.link_door();
        board = Some(socket.sensor_board());
        outputs.add(socket);
        if has_network {
            outputs.add(LinkProcess::start(door, config, link)?);
        }
    }
    let is_heard = has_network || !config.local.path.is_empty();
    if !is_heard && config.autopilot.connect.is_empty() && log.is_none() {
        tracing::warn!(
            "the flight has no outputs: name an autopilot (autopilot.connect), a network (network.listen or --listen), or \
             --record"
        );
    }
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

/// Where is kept what is to outlast the program, if anywhere.
fn state_folder(args: &FlyArgs) -> Option<PathBuf> {
    let of_systemd = || std::env::var("STATE_DIRECTORY").ok().filter(|names| !names.is_empty());
    // Of several, the first.
    let first = |names: String| names.split(':').next().map(PathBuf::from);
    args.state.clone().or_else(|| of_systemd().and_then(first))
}

/// Shows the status: each second on a terminal, elsewhere in the log.
fn start_progress(notices: SensorNotices) -> std::io::Result<Progress> {
    let is_terminal = std::io::stdout().is_terminal();
    let mut status = FlyStatus::new(is_terminal, notices, Instant::now());
    let show = move |glance: Option<&Glance>| match glance {
        Some(glance) => status.take(glance, Instant::now()),
        None => status.tick(Instant::now()),
    };
    Progress::start(show, move || print!("{}", if is_terminal { "\n" } else { "" }))
}

/// All that is wrong with what was flown.
fn warnings(watch: Watch, flown: &Flown) -> Vec<Finding> {
    let mut warnings = watch.finish();
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

fn write_outputs(args: &FlyArgs, flown: &Flown, report: &Report) -> Result<()> {
    if let Some(path) = &args.trajectory {
        let poses: Vec<_> =
            flown.poses.iter().map(|p| StampedPose { stamp: p.stamp, pose: p.pose_o_b }).collect();
        write_tum(path, &poses)?;
    }
    if let (Some(path), Some(places)) = (&args.save_map, &flown.outcome.places) {
        write_map(path, &MapContents::of(places.mapper.map()))?;
    }
    if let Some(path) = &args.learn {
        write_learnt(path, flown)?;
    }
    let json = serde_json::to_string_pretty(report)?;
    if let Some(path) = &args.report {
        std::fs::write(path, &json).with_context(|| format!("{}", path.display()))?;
    }
    say_within(PATIENCE, if args.json { json } else { report.summary() });
    Ok(())
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
    fn a_log_is_named_or_gets_the_name_of_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::UNIX_EPOCH + Duration::from_secs(1_763_813_106);
        let log = log_path(folder.path(), now).unwrap();
        assert_eq!(log, folder.path().join("2025-11-22T12-05-06Z.mcap"));
        for next in ["2025-11-22T12-05-06Z-2.mcap", "2025-11-22T12-05-06Z-3.mcap"] {
            std::fs::write(log_path(folder.path(), now).unwrap(), "").unwrap();
            assert_eq!(log_path(folder.path(), now).unwrap(), folder.path().join(next));
        }
        assert_eq!(log_path(Path::new("a.mcap"), now).unwrap(), Path::new("a.mcap"));
        let new = folder.path().join("logs/of today/");
        assert_eq!(log_path(&new, now).unwrap(), new.join("2025-11-22T12-05-06Z.mcap"));
        assert!(new.is_dir());
        let in_the_way = folder.path().join("2025-11-22T12-05-06Z.mcap/");
        assert!(log_path(&in_the_way, now).unwrap_err().0.contains("cannot be made"));
        assert!(log_path(Path::new("/nowhere/a"), now).unwrap_err().0.contains("existing folder"));
    }

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
