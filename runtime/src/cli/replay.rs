//! `plumbline replay`: the estimator over a recorded or simulated flight.

use super::overrides::with_overrides;
use super::scenario::{ScenarioArgs, parse_scene};
use super::{Usage, check_outputs, load_config, parse_range, say, stop_on_signal};
use crate::autopilot::{Bridge, Stamps};
use crate::evaluate::load_trajectory;
use crate::flight::{Flight, Truth, is_log, open_dataset, open_log, open_simulation};
use crate::log::{self, WhenFull};
use crate::net::{Endpoints, Publisher};
use crate::pipeline::tap::{Several, Tap};
use crate::pipeline::{Control, Outcome, RunOptions, Sink, Streams};
use crate::record::{CausalPose, Recorder};
use crate::report::Report;
use crate::report::accuracy::Accuracy;
use anyhow::{Context, Result};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_config::{Config, ValidConfig};
use plumbline_drivers::tum::write_tum;
use plumbline_estimator::{Estimate, Odometry};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Room for poses is made beforehand for up to so many frames: two hours.
const MAX_RESERVED_FRAMES: usize = 144_000;

/// Arguments of `plumbline replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// A EuRoC data set, a flight log (.mcap), or a simulated flight: sim:room, sim:hall, sim:low-texture.
    pub dataset: String,
    /// Configuration file or preset. Without one: the preset `euroc` with the data set's calibration, the
    /// configuration of the log, or the preset `sim`.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the estimator's configuration, such as estimator.points.sigma_px=0.3; may be
    /// repeated. What is simulated stays the same.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Multiple of real time; as fast as it goes without.
    #[arg(long)]
    pub speed: Option<f64>,
    /// 1 does everything in turn; 2 decodes ahead of need; 3 solves a frame while the next is tracked; 4 and
    /// more share the work on a frame. The answer is the same.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
    /// Write the causal trajectory (TUM format): each pose as it was known when its frame came.
    #[arg(long, value_name = "OUT.tum")]
    pub trajectory: Option<PathBuf>,
    /// Write the odometry at IMU rate (TUM format).
    #[arg(long, value_name = "OUT.tum")]
    pub odometry: Option<PathBuf>,
    /// Write the 6x6 covariance of every pose (CSV).
    #[arg(long, value_name = "OUT.csv")]
    pub covariance: Option<PathBuf>,
    /// Record the flight, to be looked at in Foxglove and executed again by `verify`; how much of it, the
    /// configuration's [recorder] says.
    #[arg(long, value_name = "LOG.mcap")]
    pub record: Option<PathBuf>,
    /// Write the report (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
    /// Ground truth of a data set that brings none: TUM (plain or .gz) or a EuRoC table.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Only these frames of a data set or log.
    #[arg(long, value_name = "A..B")]
    pub frames: Option<String>,
    /// Keep the rendered frames of a simulated flight in this folder, and take them from there if they are.
    #[arg(long, value_name = "FOLDER")]
    pub cache: Option<PathBuf>,
    /// The left camera alone.
    #[arg(long)]
    pub mono: bool,
    /// Points and IMU alone, without lines.
    #[arg(long)]
    pub no_lines: bool,
    /// Publish over Zenoh while flying, as the configuration's [network], --listen and --connect say.
    #[arg(long)]
    pub publish: bool,
    /// With --publish: listen here, such as tcp/127.0.0.1:7447.
    #[arg(long, value_name = "ENDPOINT", requires = "publish")]
    pub listen: Vec<String>,
    /// With --publish: connect to this router or ground station; udp/ beside another takes odometry alone.
    #[arg(long, value_name = "ENDPOINT", requires = "publish")]
    pub connect: Vec<String>,
    /// With --speed: send odometry to an autopilot by MAVLink, such as udp://127.0.0.1:14540 or
    /// serial:///dev/ttyS0:921600; how, the configuration's [autopilot] says.
    #[arg(long, value_name = "udp://HOST:PORT")]
    pub autopilot: Option<String>,
    /// Print the report as JSON instead of the summary.
    #[arg(long)]
    pub json: bool,
    /// What is simulated.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
}

/// Runs the command.
///
/// # Errors
/// When the flight cannot be opened, run or written.
pub fn run(args: &ReplayArgs) -> Result<()> {
    if args.speed.is_some_and(|s| !(s.is_finite() && s > 0.0)) {
        return Err(Usage("--speed: give a positive number".into()).into());
    }
    let outputs = [&args.trajectory, &args.odometry, &args.covariance, &args.report, &args.record];
    check_outputs(outputs.into_iter().flatten())?;
    let mut flight = open(args)?;
    flight.config = with_overrides(&flight.config, &args.overrides)?;
    if args.no_lines {
        flight.config = flight.config.with("--no-lines", |config| config.estimator.lines.enabled = false)?;
    }
    if let Some(file) = &args.truth {
        flight.truth = Truth::Recorded(load_trajectory(file)?);
    }
    if let Some(connect) = &args.autopilot {
        let change = |config: &mut Config| config.autopilot.connect.clone_from(connect);
        flight.config = flight.config.with("--autopilot", change)?;
    }
    let is_live = args.speed.is_some();
    let mut bridge = start_bridge(&flight.config, args)?;
    let recording = args.record.as_ref().map(|path| start_recording(path, &flight, is_live)).transpose()?;
    let control = Arc::new(Control::stopped_by(stop_on_signal()?));
    let mut publisher = args.publish.then(|| start_publisher(args, &flight, &control)).transpose()?;
    let mut progress = Progress::new(flight.stereo.expected_frames());
    let mut recorder = Recorder { keep_odometry: args.odometry.is_some(), ..Recorder::default() };
    let expected = flight.stereo.expected_frames().unwrap_or_default();
    recorder.reserve(usize::try_from(expected).unwrap_or_default().min(MAX_RESERVED_FRAMES));
    recorder.listeners.push(&mut progress);
    let mut taps: Vec<Box<dyn Tap>> = Vec::new();
    if let Some(publisher) = &mut publisher {
        taps.push(publisher.tap());
        recorder.listeners.push(publisher);
    }
    if let Some(bridge) = &mut bridge {
        recorder.listeners.push(bridge);
    }
    taps.extend(recording.iter().map(|recording| Box::new(recording.handle()) as Box<dyn Tap>));
    let options = RunOptions { speed: args.speed, threads: usize::from(args.threads) };
    let tap = Box::new(Several(taps));
    let (mut report, poses, odometry) = fly_tapped(flight, recorder, &options, &control, tap)?;
    report.autopilot = bridge.and_then(Bridge::stop);
    progress.0.finish_and_clear();
    report.recording = recording.map(log::Recorder::finish);
    if let Some(publisher) = publisher {
        publisher.stop();
    }
    if let Some(path) = &args.trajectory {
        let poses: Vec<_> = poses
            .iter()
            .map(|p| plumbline_drivers::StampedPose { stamp: p.stamp, pose: p.pose_o_b })
            .collect();
        write_tum(path, &poses)?;
    }
    if let Some(path) = &args.odometry {
        write_tum(path, &odometry)?;
    }
    if let Some(path) = &args.covariance {
        write_covariances(path, &poses)?;
    }
    let json = serde_json::to_string_pretty(&report)?;
    if let Some(path) = &args.report {
        std::fs::write(path, &json).with_context(|| format!("{}", path.display()))?;
    }
    say(if args.json { json } else { report.summary() });
    anyhow::ensure!(
        report.completion > 0.0,
        "{}: no pose was found in {} frames",
        args.dataset,
        report.frames
    );
    Ok(())
}

fn open(args: &ReplayArgs) -> Result<Flight> {
    let config = load_config(args.config.as_deref())?;
    if let Some(scene) = args.dataset.strip_prefix("sim:") {
        let scenario = args.scenario.scenario(parse_scene(scene)?)?;
        let error_deg = args.scenario.extrinsics_error_deg;
        return open_simulation(config, &scenario, args.mono, error_deg, args.cache.as_deref());
    }
    let frames = match &args.frames {
        None => None,
        Some(text) => {
            let (from, to) = parse_range::<usize>(text).map_err(|e| Usage(format!("--frames: {e}")))?;
            Some(from.unwrap_or(0)..to.unwrap_or(usize::MAX))
        }
    };
    let path = Path::new(&args.dataset);
    if is_log(path) {
        return open_log(path, config, frames, args.mono);
    }
    open_dataset(path, config, frames, args.mono)
}

/// Puts the flight on the network.
fn start_publisher(args: &ReplayArgs, flight: &Flight, control: &Arc<Control>) -> Result<Publisher> {
    let endpoints = Endpoints::of(&flight.config.network).and(&args.listen, &args.connect);
    Ok(Publisher::start(&flight.config, &endpoints, Arc::clone(control))?)
}

/// Starts the recorder: a live flight never waits for it, one in virtual time loses nothing.
fn start_recording(path: &Path, flight: &Flight, is_live: bool) -> Result<log::Recorder> {
    if !is_log(path) {
        let message = format!("{}: name the log with the ending .mcap", path.display());
        return Err(Usage(message).into());
    }
    let when_full = if is_live { WhenFull::Drop } else { WhenFull::Wait };
    Ok(log::Recorder::start(path, &flight.config, when_full)?)
}

/// Starts the bridge to the autopilot, where one is named: it flies in real time, or not at all.
fn start_bridge(config: &ValidConfig, args: &ReplayArgs) -> Result<Option<Bridge>> {
    let autopilot = &config.autopilot;
    if autopilot.connect.is_empty() {
        return Ok(None);
    }
    if args.speed.is_some() {
        return Ok(Some(Bridge::start(
            autopilot,
            &config.vehicle,
            Stamps::Replayed,
            config.runtime.realtime,
        )?));
    }
    if args.autopilot.is_some() {
        return Err(Usage("--autopilot: give --speed 1 too, an autopilot flies in real time".into()).into());
    }
    tracing::warn!("autopilot.connect is set, but without --speed 1 nothing is sent there");
    Ok(None)
}

/// Runs a flight to its end and reports it.
///
/// # Errors
/// When a driver cannot go on.
pub fn fly(
    flight: Flight,
    recorder: Recorder<'_>,
    options: &RunOptions,
    control: &Control,
) -> Result<(Report, Vec<CausalPose>, Vec<plumbline_drivers::StampedPose>)> {
    fly_tapped(flight, recorder, options, control, Box::new(()))
}

/// The same with a listener to every input, order and output.
///
/// # Errors
/// When a driver cannot go on.
pub fn fly_tapped(
    flight: Flight,
    mut recorder: Recorder<'_>,
    options: &RunOptions,
    control: &Control,
    tap: Box<dyn Tap>,
) -> Result<(Report, Vec<CausalPose>, Vec<plumbline_drivers::StampedPose>)> {
    let Flight { config, imu, stereo, truth, name } = flight;
    let streams = Streams { imu, stereo };
    let outcome: Outcome = crate::pipeline::run(&config, streams, options, control, tap, &mut recorder)?;
    let accuracy = Accuracy::of(&recorder.poses, &truth);
    let report = Report::new(&name, &outcome, accuracy, &config, options.threads);
    Ok((report, recorder.poses, recorder.odometry))
}

fn write_covariances(path: &Path, poses: &[CausalPose]) -> Result<()> {
    let mut text =
        String::from("#timestamp [ns], 6x6 covariance of position [m] and attitude [rad] by rows\n");
    for pose in poses {
        let _ = write!(text, "{}", pose.stamp.as_nanos());
        for value in pose.covariance.transpose().iter() {
            let _ = write!(text, ",{value:.9e}");
        }
        text.push('\n');
    }
    std::fs::write(path, text).with_context(|| format!("{}", path.display()))
}

/// A progress bar on terminals.
struct Progress(ProgressBar);

impl Progress {
    fn new(expected: Option<u64>) -> Self {
        let bar = expected.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
        let template = "{bar:32} {pos}/{len} frames  {msg}  {elapsed} (eta {eta})";
        bar.set_style(
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        Self(bar)
    }
}

impl Sink for Progress {
    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64) {
        self.0.inc(1);
        if self.0.position().is_multiple_of(10) {
            let p = estimate.pose_o_b.translation.vector;
            self.0.set_message(format!("({:.2} {:.2} {:.2}) m, {frame_ms:.1} ms", p.x, p.y, p.z));
        }
    }

    fn odometry(&mut self, _odometry: &Odometry) {}
}
