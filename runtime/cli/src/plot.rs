//! `plumbline plot`: a flight as one picture.

use super::evaluate::Align;
use super::progress::Progress;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, load_config, say, stop_on_signal, sweep};
use anyhow::{Context, Result};
use clap::Args;
use plumbline_estimator::Estimate;
use plumbline_flight::flight::states::{is_states, read_states};
use plumbline_flight::flight::{KeptStates, RecordingKind, Truth, fly, is_log, recording_kind};
use plumbline_flight::log::channel::Channel;
use plumbline_flight::log::cursor::Cursor;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::evaluate::{EvaluateError, load_trajectory};
use plumbline_lab::plot::{self, PlotSubject, SIDES_PX, SIZE_PX, TruthAlignment};
use plumbline_lab::sweep::Common;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  plumbline plot V1_01_easy --out flight.svg                      fly the data set, and draw the flight
  plumbline plot out.tum --truth V1_01_easy --out flight.svg      draw a trajectory over the truth
  plumbline plot states.csv --truth V1_01_easy --out flight.png   also covariance, velocity and biases
  plumbline plot log.mcap --out flight.png                        draw a flight log

`plumbline replay DATASET --states states.csv` writes a table of states. `plumbline replay DATASET --plot flight.svg` runs the \
estimator, with any of its options, and draws the flight.";

/// Arguments of `plumbline plot`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct PlotArgs {
    /// Flight to draw: a trajectory (TUM, plain or .gz), a table of states (.csv) or a flight log (.mcap). A EuRoC
    /// data set, a ROS bag (with --config) or a simulated flight (sim:room?duration=10) is flown first.
    #[arg(value_name = "FLIGHT")]
    pub estimate: String,
    /// Configuration file or preset of what is flown first. Default: as for `plumbline replay`.
    #[arg(long, value_name = "FILE|PRESET")]
    pub config: Option<PathBuf>,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Ground truth: TUM (plain or .gz), a EuRoC ground truth table, or a EuRoC data set.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Picture to write: .svg or .png.
    #[arg(long, value_name = "OUT.svg|OUT.png")]
    pub out: PathBuf,
    /// Alignment of the ground truth to the estimate. Default: at the first pose by position and yaw if there is a
    /// covariance, otherwise over the whole flight by position and attitude (se3).
    #[arg(long, value_enum)]
    pub align: Option<Align>,
    /// Title of the figure. Default: the name of the file.
    #[arg(long)]
    pub title: Option<String>,
    /// Width and height, px.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    pub size: Option<(u32, u32)>,
}

/// `1200x900` as a pair.
fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse().ok().filter(|side| SIDES_PX.contains(side));
    let size = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    size.ok_or_else(|| format!("write it as {}x{}, each side {SIDES_PX:?} pixels", SIZE_PX.0, SIZE_PX.1))
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or written, or the truth is of another time.
pub fn run(args: &PlotArgs) -> Result<()> {
    plot::check_name(&args.out).map_err(|e| Usage(format!("--out: {e}")))?;
    check_outputs([&args.out])?;
    let (subject, truth) = subject(args)?;
    let subject = subject.with_context(|| format!("{}: holds no pose", args.estimate))?;
    let truth = match &args.truth {
        Some(file) => load_trajectory(file)?,
        None => truth,
    };
    let subject = if truth.is_empty() {
        subject
    } else {
        let alignment = alignment(args.align, &subject);
        subject.with_truth(&truth, alignment)?
    };
    plot::write(&subject, &args.out, args.size.unwrap_or(SIZE_PX))?;
    say(format_args!("{}: written", args.out.display()));
    Ok(())
}

/// The alignment that was asked for, or the one that suits what is known.
fn alignment(asked: Option<Align>, subject: &PlotSubject) -> TruthAlignment {
    match asked {
        Some(align) => TruthAlignment::Fitted(align.into()),
        None if subject.has_states() => TruthAlignment::FirstPose,
        None => TruthAlignment::Fitted(Align::Se3.into()),
    }
}

/// Subject of the plot, with its truth where that comes with it.
fn subject(args: &PlotArgs) -> Result<(Option<PlotSubject>, Vec<plumbline_drivers::StampedPose>)> {
    let path = Path::new(&args.estimate);
    let name = args.title.as_deref().unwrap_or(&args.estimate);
    let kind = if path.is_file() { recording_kind(path) } else { RecordingKind::Dataset };
    if args.estimate.starts_with("sim:") || path.is_dir() || kind == RecordingKind::Bag {
        let (rows, truth) = flown(args)?;
        let truth = truth.poses(rows.iter().map(|row| row.stamp));
        return Ok((PlotSubject::of_states(name, &rows), truth));
    }
    let subject = if is_log(path) {
        PlotSubject::of_states(name, &logged_states(path)?)
    } else if is_states(path) {
        PlotSubject::of_states(name, &read_states(path)?)
    } else {
        PlotSubject::of_trajectory(name, &load_trajectory(path)?)
    };
    Ok((subject, Vec::new()))
}

/// Flies a data set, a bag or a simulated flight as it is.
fn flown(args: &PlotArgs) -> Result<(Vec<Estimate>, Truth)> {
    let config = load_config(args.config.as_deref())?;
    let common = Common { config, topics: args.topics.names()?, ..Common::default() };
    let flight = sweep::subject(&args.estimate, None)?.open(&common, None, None)?;
    let control = Control::stopped_by(stop_on_signal()?);
    let mut states = KeptStates::for_flight(&flight);
    let mut progress = Progress::bar(flight.stereo.expected_frames())?;
    let options = RunOptions { speed: None, threads: 2 };
    let flown = fly(flight, &options, &control, vec![&mut states, &mut progress])?;
    progress.finish();
    Ok((states.into_rows(), flown.truth))
}

/// A flight that was just flown, over its truth where that is known; `None` without a pose.
pub(super) fn flown_subject(
    name: &str,
    rows: &[Estimate],
    truth: &Truth,
) -> Result<Option<PlotSubject>, EvaluateError> {
    let Some(subject) = PlotSubject::of_states(name, rows) else { return Ok(None) };
    let truth = truth.poses(rows.iter().map(|row| row.stamp));
    if truth.is_empty() {
        return Ok(Some(subject));
    }
    subject.with_truth(&truth, TruthAlignment::FirstPose).map(Some)
}

/// The estimates that a flight log holds, as they were recorded.
pub(super) fn logged_states(path: &Path) -> Result<Vec<Estimate>> {
    let mut log = Cursor::open(path, &[Channel::Estimate])?;
    let mut rows = Vec::new();
    while let Some(estimate) = log.next::<Estimate>(Channel::Estimate)? {
        rows.push(estimate);
    }
    Ok(rows)
}
