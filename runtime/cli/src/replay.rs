//! `plumbline replay`: the estimator over a recorded or simulated flight.

mod instants;
mod live;
mod written;

use super::exit_status::last_resort;
use super::progress::Progress;
use super::run_args::{RunArgs, check_recording};
use super::scenario::ScenarioArgs;
use super::simulated::{are_given, simulated};
use super::topics::TopicArgs;
use super::{Usage, check_outputs, load_config, parse_range, say, stop_on_signal};
use anyhow::Result;
use clap::Args;
use live::start_outputs;
use plumbline_config::Config;
use plumbline_drivers::euroc::FileDefects;
use plumbline_flight::flight::plausibility::Finding;
use plumbline_flight::flight::plausibility::watch::Watch;
use plumbline_flight::flight::{
    Cut, Flight, Flown, KeptInstants, KeptStates, OdometryTrajectory, Truth, fly, open_recording,
    read_stamps, with_overrides,
};
use plumbline_flight::log::source::LogEnd;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::evaluate::load_trajectory;
use plumbline_lab::report::accuracy::ForeignTruth;
use plumbline_lab::report::{Report, late_findings};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use written::write_outputs;

/// Largest number of odometry samples for which memory is allocated beforehand: two hours at 200 Hz.
const MAX_RESERVED_READINGS: usize = 1_440_000;

/// Arguments of `plumbline replay`.
// Help texts name tables of the configuration in brackets.
#[allow(rustdoc::broken_intra_doc_links)]
#[derive(Debug, Args)]
#[command(mut_arg("listen", |a| a.requires("publish")), mut_arg("connect", |a| a.requires("publish")))]
pub struct ReplayArgs {
    /// EuRoC data set, flight log, ROS bag (.mcap, .db3, .bag, or its directory), or simulated flight: sim:room, sim:hall,
    /// sim:low-texture, sim:far. Its options are given below, or after a ?: sim:room?path=demo&duration=10.
    pub dataset: String,
    /// Configuration file or preset. Default: preset `euroc` with the calibration of the data set, configuration of the
    /// log, or preset `sim`.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Playback speed relative to real time. Default: as fast as possible.
    #[arg(long, allow_hyphen_values = true)]
    pub speed: Option<f64>,
    /// Number of threads, which never changes the result. 2: decode images ahead; 3: solve the window beside the next frame; 4
    /// and more: share the work on a frame.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
    /// Write the trajectory as known at the end (TUM format), by all later images and loops: no vehicle knew it in flight.
    #[arg(long = "final", value_name = "OUT.tum")]
    pub final_trajectory: Option<PathBuf>,
    /// Write the causal trajectory in the map (TUM format), loops closed.
    #[arg(long, value_name = "OUT.tum")]
    pub map_trajectory: Option<PathBuf>,
    /// Odometry only: do not recognize places, close loops or build a map.
    #[arg(long, conflicts_with_all = ["final_trajectory", "map_trajectory", "map", "save_map"])]
    pub no_loop: bool,
    /// Write the odometry at IMU rate (TUM format).
    #[arg(long, value_name = "OUT.tum")]
    pub odometry: Option<PathBuf>,
    /// Write all values of the estimates, one row per frame (CSV).
    #[arg(long, value_name = "OUT.csv")]
    pub states: Option<PathBuf>,
    /// Write the state at each of these instants (CSV: nanoseconds, or seconds with a decimal point, by the IMU's clock, in the
    /// first column), such as those of a camera's trigger, with its covariance. See --at-out.
    #[arg(long, value_name = "STAMPS.csv")]
    pub at: Option<PathBuf>,
    /// With --at: the file to write. Default: STAMPS_states.csv beside it.
    #[arg(long, value_name = "OUT.csv", requires = "at")]
    pub at_out: Option<PathBuf>,
    /// Write the true poses at the times of the estimates (TUM).
    #[arg(long, value_name = "OUT.tum")]
    pub true_trajectory: Option<PathBuf>,
    /// Ground truth in place of that of the data set: TUM (also .gz) or EuRoC.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Use only frames A to B of a data set or log.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<String>,
    /// Stop at this time, seconds into the data set, log or path.
    #[arg(long, value_name = "S", conflicts_with = "duration")]
    pub stop: Option<f64>,
    /// Cache rendered frames here.
    #[arg(long, value_name = "FOLDER")]
    pub cache: Option<PathBuf>,
    /// Use the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Use points and IMU only, no lines.
    #[arg(long)]
    pub no_lines: bool,
    /// Publish over Zenoh, at --listen, --connect and those of [network].
    #[arg(long)]
    pub publish: bool,
    /// With --speed 1: send odometry over MAVLink, to udp://127.0.0.1:14540 or serial:///dev/ttyS0:921600, by [autopilot] of the
    /// configuration.
    #[arg(long, value_name = "udp://HOST:PORT")]
    pub autopilot: Option<String>,
    /// Options of the run.
    #[command(flatten)]
    pub run: RunArgs,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Simulated flight.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
}

/// Runs the command.
///
/// # Errors
/// When the flight cannot be opened, run or written.
pub fn run(args: &ReplayArgs) -> Result<()> {
    let log = args.run.log()?;
    let (stamps, at_out) = (checked(args, log.as_ref())?, instants::file(args));
    let flight = prepared(open(args)?, args)?;
    let control = Arc::new(Control::stopped_by(stop_on_signal()?).with_last_resort(last_resort));
    let mut instants = stamps.map(|stamps| KeptInstants::of(stamps, &control));
    let (mut outputs, board) = start_outputs(args, &flight, log.as_deref(), &control)?;
    let mut odometry = args
        .odometry
        .as_ref()
        .map(|_| OdometryTrajectory::with_room_for(flight.expected_readings().min(MAX_RESERVED_READINGS)));
    let mut states = args.states.as_ref().map(|_| KeptStates::for_flight(&flight));
    let mut progress = Progress::bar(flight.stereo.expected_frames())?;
    let mut watch = Watch::start(&flight.config, args.speed.is_some(), flight.findings.clone(), board)?;
    let (log_end, file_defects) = (flight.log_end.clone(), flight.file_defects.clone());
    let threads = usize::from(args.threads);
    let options = RunOptions { speed: args.speed, threads };
    let mut subscribers = outputs.subscribers();
    subscribers.push(&mut progress);
    if let Some(odometry) = &mut odometry {
        subscribers.push(odometry);
    }
    if let Some(states) = &mut states {
        subscribers.push(states);
    }
    subscribers.extend(instants.as_mut().map(|instants| instants as _));
    subscribers.push(&mut watch);
    // The outputs end at once, or an autopilot would be told that the estimator is silent; also of a flight with a fault.
    let (flown, outputs) = (fly(flight, &options, &control, subscribers), outputs.finish());
    progress.finish();
    let flown = flown?;
    let warnings = warnings(watch.finish(), &flown, log_end.as_ref(), &file_defects);
    let report = Report::new(&flown).with(outputs).warning_of(warnings);
    let odometry = odometry.map(OdometryTrajectory::into_rows);
    let words = args.run.write(&flown, &report)?;
    write_outputs(args, &flown, odometry.as_deref(), states.map(KeptStates::into_rows).as_deref())?;
    say(words);
    if let (Some(instants), Some(path)) = (instants, &at_out) {
        let mut rows = instants.into_rows();
        rows.sort_by_key(|answer| answer.number);
        instants::write(path, &rows, &flown.poses)?;
    }
    judge(args, &report, &flown)
}

/// Checks the options before anything is opened; returns the instants that are asked for.
fn checked(args: &ReplayArgs, log: Option<&PathBuf>) -> Result<Option<Vec<plumbline_config::Timestamp>>> {
    if args.speed.is_some_and(|s| !(s.is_finite() && s > 0.0)) {
        return Err(Usage("--speed: give a positive number".into()).into());
    }
    let at_out = instants::file(args);
    let of_states = [&args.odometry, &args.states, &args.true_trajectory];
    let others = [&args.final_trajectory, &args.map_trajectory, &at_out];
    check_outputs(args.run.files().chain(of_states.into_iter().chain(others).flatten()).chain(log))?;
    if at_out.is_some() && at_out == args.at {
        return Err(Usage("--at-out: is the list itself; name another file".into()).into());
    }
    let stamps = args.at.as_deref().map(read_stamps).transpose().map_err(|e| Usage(format!("--at: {e}")))?;
    check_mentions(args)?;
    Ok(stamps)
}

/// Fails where a flight has no pose, its recording failed, or the truth that was named is of another flight.
fn judge(args: &ReplayArgs, report: &Report, flown: &Flown) -> Result<()> {
    let dataset = &args.dataset;
    let frames = report.frames;
    anyhow::ensure!(
        report.completion > 0.0,
        "{dataset}: no pose was found in {frames} frames: {}",
        report.why_no_pose()
    );
    check_recording(report)?;
    if let Some(file) = args.truth.as_ref().filter(|_| report.accuracy.is_none()) {
        ForeignTruth::check(&flown.name, &flown.poses, &flown.truth, file)?;
    }
    Ok(())
}

/// All that is wrong with what was flown; what shows only at the end is logged now.
fn warnings(
    mut warnings: Vec<Finding>,
    flown: &Flown,
    log_end: Option<&LogEnd>,
    files: &FileDefects,
) -> Vec<Finding> {
    for finding in late_findings(flown, log_end, files, &warnings) {
        tracing::warn!("{finding}");
        warnings.push(finding);
    }
    warnings
}

/// Refuses or mentions options that would be ignored.
fn check_mentions(args: &ReplayArgs) -> Result<(), Usage> {
    if args.dataset.starts_with("sim:") {
        if args.frames.is_some() {
            return Err(Usage(
                "--frames: is for data sets and logs; give --start and --duration instead".into(),
            ));
        }
        if args.truth.is_some() {
            return Err(Usage("--truth: a simulated flight knows its truth; leave it out".into()));
        }
        return Ok(());
    }
    args.scenario.check_recorded()?;
    if args.cache.is_some() {
        return Err(Usage(
            "--cache: is for simulated flights, whose frames are rendered; leave it out".into(),
        ));
    }
    Ok(())
}

/// The flight with what the arguments change of it.
fn prepared(mut flight: Flight, args: &ReplayArgs) -> Result<Flight> {
    flight.config = with_overrides(&flight.config, &args.run.overrides)?;
    if args.no_lines {
        flight.config = flight.config.with("--no-lines", |config| config.estimator.lines.enabled = false)?;
    }
    if let Some(file) = &args.truth {
        flight.truth = Truth::of_poses(&load_trajectory(file)?);
    }
    if args.no_loop {
        flight.config = flight.config.with("--no-loop", |config| config.estimator.places.enabled = false)?;
    }
    args.run.take_map(&mut flight)?;
    if let Some(connect) = &args.autopilot {
        let change = |config: &mut Config| config.autopilot.connect.clone_from(connect);
        flight.config = flight.config.with("--autopilot", change)?;
    }
    Ok(flight)
}

fn open(args: &ReplayArgs) -> Result<Flight> {
    let config = load_config(args.config.as_deref())?;
    if let Some(mut named) = simulated(&args.dataset)? {
        let are_both = named.has_options && (are_given(&args.scenario) || args.stop.is_some());
        anyhow::ensure!(
            !are_both,
            Usage(format!(
                "{}: has options after the ?; write all of them there, or all after the name",
                args.dataset
            ))
        );
        if !named.has_options {
            named.options = args.scenario.clone();
        }
        if let Some(stop) = args.stop {
            let seconds = named.options.seconds(Some(stop))?;
            named.options.duration = Some(seconds.end - seconds.start);
        }
        named.mono |= args.mono;
        return named.open(config, args.cache.as_deref());
    }
    let frames = match &args.frames {
        None => None,
        Some(text) => {
            let (from, to) = parse_range::<usize>(text).map_err(|e| Usage(format!("--frames: {e}")))?;
            Some(from.unwrap_or(0)..to.unwrap_or(usize::MAX))
        }
    };
    let cut = Cut { frames, seconds: args.scenario.seconds(args.stop)? };
    let path = Path::new(&args.dataset);
    let flight = open_recording(path, config, &args.topics.names()?, cut, args.mono)?;
    if let Some(frames) = flight.stereo.expected_frames() {
        args.scenario.faults.check_begin_before(frames as f64 / flight.config.camera[0].rate_hz)?;
    }
    args.scenario.faults.inject(flight, args.scenario.seed, false)
}
