//! `plumbline shuttle`: the drift of a recording without ground truth.

use super::progress::Progress;
use super::scenario::FaultArgs;
use super::sweep::{cache_folder, progress_bar};
use super::topics::TopicArgs;
use super::{Usage, check_outputs, load_config, say, stop_on_signal, sweep};
use anyhow::{Context, Result, ensure};
use clap::Args;
use plumbline_drivers::tape::{Direction, Tape, backward_config};
use plumbline_drivers::tum::write_tum;
use plumbline_drivers::{ImuSource, StampedPose, StereoSource};
use plumbline_flight::flight::plausibility::Finding;
use plumbline_flight::flight::{Cut, Flight, Flown, Truth, fly, open_recording, with_overrides};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::evaluate::load_trajectory;
use plumbline_lab::report::Report;
use plumbline_lab::report::accuracy::ForeignTruth;
use plumbline_lab::shuttle::Shuttle;
use plumbline_lab::sweep::{Common, Subject};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const EXAMPLES: &str = "The recording is flown twice: as it is, and backward in time (images in reverse order, angular rates negated, specific forces \
kept). Both ways pass the same places, so their difference measures the drift. Divided by the square root of two it is the drift of one way: \
per metre, the mean over parts of 10 to 50 % of the path. \"At the end\" is the error after the way back, with its standard deviation by the covariance.

Errors that both ways share cancel: a wrong focal length, baseline or scale does not show. `plumbline doctor` and `plumbline calibrate` look \
for those. Loops are not closed. A rolling shutter cannot be played backward.

Examples:
  plumbline shuttle flight.mcap                          a flight log with images
  plumbline shuttle V1_01_easy                           with its truth beside, because the data set has one
  plumbline shuttle bag/ --config drone.toml --json
  plumbline shuttle flight.mcap --fault image-black@10+1   the same with a blackout of a second, in both directions

The images are copied to a temporary file without a name: 14 MB a second of 752x480 at 20 Hz, in --scratch.";

/// Arguments of `plumbline shuttle`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ShuttleArgs {
    /// EuRoC data set, flight log with images, ROS bag (.mcap, .db3, .bag, or its directory), or simulated flight
    /// (sim:room?path=demo&duration=30).
    pub recording: String,
    /// Configuration file or preset. Default: as for `plumbline replay`.
    #[arg(long, value_name = "FILE|PRESET")]
    pub config: Option<PathBuf>,
    /// Change a key of the configuration, such as estimator.lines.enabled=false; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Start, seconds from the beginning of the recording.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub start: f64,
    /// Seconds of the recording that are flown. Default: to the end.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Use the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Ground truth, to be compared with what the shuttle tells: TUM (plain or .gz) or a EuRoC table. Default: that of the data set.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Folder of the temporary copy of the images. Default: $XDG_CACHE_HOME/plumbline (~/.cache/plumbline).
    #[arg(long, value_name = "FOLDER")]
    pub scratch: Option<PathBuf>,
    /// Write the trajectory of the way there (TUM).
    #[arg(long, value_name = "OUT.tum")]
    pub there: Option<PathBuf>,
    /// Write the trajectory of the way back (TUM), stamped as the way there.
    #[arg(long, value_name = "OUT.tum")]
    pub back: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Faults that are injected into the recording.
    #[command(flatten)]
    pub faults: FaultArgs,
    /// Seed of the faults.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// Results that are printed as JSON.
#[derive(Serialize)]
struct Told<'a> {
    name: &'a str,
    /// Digests of the estimates there and back.
    digests: [&'a str; 2],
    #[serde(flatten)]
    shuttle: &'a Shuttle,
}

/// Runs the command.
///
/// # Errors
/// When the recording cannot be opened or flown, or has too few poses in either direction.
pub fn run(args: &ShuttleArgs) -> Result<()> {
    check_outputs(args.there.iter().chain(&args.back))?;
    let flight = open(args)?;
    let stop = stop_on_signal()?;
    let back_config = {
        let mut refusal = Ok(());
        let changed = flight.config.with("the flight back", |config| refusal = backward_config(config));
        refusal.map_err(Usage)?;
        changed?
    };
    let Flight { config, mut imu, mut stereo, truth, name, .. } = flight;
    let folder = args.scratch.clone().unwrap_or_else(cache_folder);
    let tape = copied(&mut *imu, &mut stereo, &config, &folder)?;
    let way = |config, direction| {
        let (imu, stereo) = (Box::new(tape.imu(direction)), Box::new(tape.stereo(direction)));
        flown(
            Flight { findings: Vec::<Finding>::new(), ..Flight::new(config, imu, stereo, name.clone()) },
            &stop,
        )
    };
    let there = way(config, Direction::Forward)?;
    let back = way(back_config, Direction::Backward)?;
    write_ways(args, &there, &back, &tape)?;
    let mirrored = |stamp| tape.mirrored(stamp);
    let shuttle = Shuttle::of(&there.poses, &back.poses, mirrored, &truth).with_context(|| {
        let found = [&there, &back].map(|way| way.poses.len());
        let [reason, _] = [&there, &back].map(|way| Report::new(way).why_no_pose());
        format!(
            "{name}: {} poses there and {} back are too few in common to compare: {reason}; see `plumbline doctor {}`",
            found[0], found[1], args.recording
        )
    })?;
    if args.json {
        let digests = [&there, &back].map(|way| way.outcome.estimate_digest.as_str());
        say(serde_json::to_string_pretty(&Told { name: &name, digests, shuttle: &shuttle })?);
    } else {
        say(summary(&name, &shuttle));
    }
    if let Some(file) = &args.truth {
        ForeignTruth::check(&name, &there.poses, &truth, file)?;
    }
    Ok(())
}

/// The recording with its faults, opened.
fn open(args: &ShuttleArgs) -> Result<Flight> {
    ensure!(
        args.start.is_finite() && args.start >= 0.0 && args.duration.is_none_or(|s| s.is_finite() && s > 0.0),
        Usage(
            "--start, --duration: give seconds from the beginning of the recording, and a length above 0"
                .into()
        )
    );
    let config = load_config(args.config.as_deref())?;
    let mut flight = match sweep::subject(&args.recording, None)? {
        Subject::Recorded { path } => {
            let end_s = args.duration.map_or(f64::INFINITY, |duration| args.start + duration);
            let cut = Cut { frames: None, seconds: args.start..end_s };
            open_recording(&path, config, &args.topics.names()?, cut, args.mono)?
        }
        simulated => {
            ensure!(
                args.start == 0.0 && args.duration.is_none(),
                Usage("--start, --duration: are for recordings; write them after the ? of the simulated flight, as in sim:room?start=5&duration=20".into())
            );
            let common = Common { config, mono: args.mono, ..Common::default() };
            simulated.open(&common, None, None)?
        }
    };
    flight.config = with_overrides(&flight.config, &args.overrides)?;
    // Places are of no use: a loop would close the gap that is measured.
    flight.config = flight.config.with("without places", |config| config.estimator.places.enabled = false)?;
    if let Some(file) = &args.truth {
        flight.truth = Truth::of_poses(&load_trajectory(file)?);
    }
    for finding in &flight.findings {
        tracing::warn!("{finding}");
    }
    if let Some(frames) = flight.stereo.expected_frames() {
        args.faults.check_begin_before(frames as f64 / flight.config.camera[0].rate_hz)?;
    }
    args.faults.inject(flight, args.seed, false)
}

/// Copies the streams to disk.
fn copied(
    imu: &mut dyn ImuSource,
    stereo: &mut dyn StereoSource,
    config: &plumbline_config::ValidConfig,
    folder: &Path,
) -> Result<Tape> {
    let mut sizes_px = [(0, 0); 2];
    for (size, camera) in sizes_px.iter_mut().zip(&config.camera) {
        *size = (camera.model().width_px, camera.model().height_px);
    }
    let bar = progress_bar("frames copied", stereo.expected_frames().unwrap_or(0) as usize, 0);
    let tape = Tape::record(imu, stereo, sizes_px, folder, || bar.inc(1)).with_context(|| {
        format!("cannot copy the images to {}; name a folder with more room with --scratch", folder.display())
    });
    bar.finish_and_clear();
    tape
}

/// Flies one way.
fn flown(flight: Flight, stop: &Arc<AtomicBool>) -> Result<Flown> {
    let mut progress = Progress::bar(flight.stereo.expected_frames())?;
    let options = RunOptions { speed: None, threads: 2 };
    let flown = fly(flight, &options, &Control::stopped_by(Arc::clone(stop)), vec![&mut progress]);
    progress.finish();
    ensure!(!stop.load(Ordering::Relaxed), "stopped: a part of the way tells no drift");
    Ok(flown?)
}

/// Writes the trajectories that were asked for.
fn write_ways(args: &ShuttleArgs, there: &Flown, back: &Flown, tape: &Tape) -> Result<()> {
    if let Some(path) = &args.there {
        let poses = there.poses.iter().map(|p| StampedPose { stamp: p.stamp, pose: p.pose_o_b });
        write_tum(path, &poses.collect::<Vec<_>>())?;
    }
    if let Some(path) = &args.back {
        let poses = back.poses.iter().rev();
        let poses = poses.map(|p| StampedPose { stamp: tape.mirrored(p.stamp), pose: p.pose_o_b });
        write_tum(path, &poses.collect::<Vec<_>>())?;
    }
    Ok(())
}

/// The figures for people.
fn summary(name: &str, shuttle: &Shuttle) -> String {
    let line = |title: &str, text: String| format!("{title:<18}{text}");
    let mut lines = vec![line(
        "shuttle",
        format!(
            "{name}: {:.1} m each way, {} common poses, {} + {} resets",
            shuttle.distance_m, shuttle.poses, shuttle.resets[0], shuttle.resets[1]
        ),
    )];
    lines.push(match &shuttle.drift {
        Some(drift) => line(
            "drift",
            format!(
                "{:.3} % of the path ({:.2} mm per metre), {:.4} degrees per metre",
                drift.translation_percent,
                10.0 * drift.translation_percent,
                drift.rotation_deg_per_m
            ),
        ),
        None => line("drift", "unknown per metre: the path is shorter than a metre".into()),
    });
    let closure = &shuttle.closure;
    lines.push(line(
        "at the end",
        format!(
            "{:.4} m ({:.3} % of the path there and back), {:.1} standard deviations of {:.4} m; heading {:.2} degrees, sigma {:.2}",
            closure.position_m,
            closure.percent,
            closure.position_sigmas,
            closure.position_sigma_m,
            closure.yaw_deg,
            closure.yaw_sigma_deg
        ),
    ));
    if let (Some([there, back]), Some(ratio)) = (&shuttle.truth, shuttle.told_over_true) {
        let text = format!(
            "drift {:.3} % there, {:.3} % back: the shuttle tells {ratio:.2} times that",
            there.translation_percent, back.translation_percent
        );
        lines.push(line("truth", text));
    }
    lines.push(line("not seen", "errors that both ways share: scale, lenses, baseline".into()));
    lines.join("\n")
}
