//! `plumbline calibrate camera`: images of a board in, a configuration and a table out.

use crate::checks::choice;
use crate::progress::bar;
use crate::simulated::check_recorded;
use crate::topics::TopicArgs;
use crate::{Usage, check_new, load_config, say, write_config};
use anyhow::{Context as _, Result};
use clap::Args;
use plumbline_config::camera::Distortion;
use plumbline_flight::flight::{RecordingKind, recording_kind};
use plumbline_lab::calibrate::camera::images::{Images, Moment, read};
use plumbline_lab::calibrate::camera::recording::{read_bag, read_log};
use plumbline_lab::calibrate::camera::{
    Calibration, Detector, LENSES, Pair, Target, calibrate, output, table,
};
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  plumbline calibrate camera recording --target aprilgrid:6x6:0.088:0.3 --out my.toml
  plumbline calibrate camera recording --target charuco:11x8:0.03:0.022:5X5_100 --out my.toml --rate 30
  plumbline calibrate camera recording --target chessboard:9x6:0.025 --mono --out my.toml

Boards (lengths in metres, measured on the print):
  aprilgrid:COLSxROWS:TAG:SPACING                Kalibr's grid: tags, side of a tag, gap divided by side
  charuco:COLSxROWS:SQUARE:MARKER[:DICT]         squares; DICT as OpenCV names it, default 6X6_250
  chessboard:COLSxROWS:SIZE                      inner corners, one less than squares; all must be in view

docs/calibration.md explains what to print, how to move the board, and how to judge the result.";

/// Default limit of images: more take longer and add little.
const MOST_IMAGES: u32 = 60;
const DEFAULT_BASE: &str = "euroc";

/// Arguments of `plumbline calibrate camera`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct CameraArgs {
    /// A folder with cam0/ and, for two cameras, cam1/ (PNG; images of the same moment have the same name), a EuRoC
    /// data set, a flight log (.mcap) with images, or a ROS bag.
    #[arg(value_name = "SOURCE")]
    source: PathBuf,
    /// Topics of a bag.
    #[command(flatten)]
    topics: TopicArgs,
    /// The board, such as aprilgrid:6x6:0.088:0.3; see below.
    #[arg(long, value_name = "BOARD")]
    target: Target,
    /// Configuration to write.
    #[arg(long, value_name = "OUT.toml")]
    out: PathBuf,
    /// The model of the lenses.
    #[arg(long, value_parser = choice(LENSES), default_value = "radtan")]
    lens: Distortion,
    /// Use the left camera only.
    #[arg(long)]
    mono: bool,
    /// Frame rate of the cameras in flight, Hz. Default: the rate in --base.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Configuration file or preset for all other values, such as the pose of the left camera on the IMU.
    #[arg(long, value_name = "FILE|PRESET", default_value = DEFAULT_BASE)]
    base: PathBuf,
    /// Largest number of images or pairs, evenly spaced in the recording.
    #[arg(long, default_value_t = MOST_IMAGES, value_parser = clap::value_parser!(u32).range(5..=1000))]
    max_images: u32,
    /// Replace an existing file.
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
///
/// # Errors
/// When there is no calibration, or it cannot be written.
pub fn run(args: &CameraArgs) -> Result<()> {
    check_recorded(&args.source)?;
    let detector = detector()?;
    check(args)?;
    let base = load_config(Some(&args.base))?.context("a base was named")?;
    let (pairs, source) = (read_pairs(args)?, args.source.display().to_string());
    let calibration = calibrated(args, &pairs, &detector).with_context(|| source.clone())?;
    say(table::views(&calibration));
    let origin = args.out.display().to_string();
    let config = output::configuration(&base, &calibration, args.rate, &origin)?;
    let text = output::text(&config, &calibration, &source, &args.base.display().to_string())?;
    write_config(&args.out, &text)?;
    table::figures(&calibration).into_iter().for_each(say);
    say(format_args!("{origin}: written, valid"));
    Ok(())
}

/// OpenCV's eyes.
#[cfg(feature = "calibration")]
fn detector() -> Result<Detector> {
    use plumbline_boards::{chessboard, markers, refine};
    Ok(Detector { markers, chessboard, refine })
}

/// This build has none.
#[cfg(not(feature = "calibration"))]
fn detector() -> Result<Detector> {
    let message = "calibrate camera: this build has no OpenCV, which finds the boards; build one with `make calibration` \
                   (cargo build --release -p plumbline --features calibration)";
    Err(Usage(message.into()).into())
}

/// Refuses what could not be written or would be overwritten, before the work.
fn check(args: &CameraArgs) -> Result<()> {
    check_new(&args.out, args.overwrite)?;
    if args.rate.is_some_and(|rate| !(rate.is_finite() && rate > 0.0)) {
        return Err(Usage("--rate: give frames a second, such as 20".into()).into());
    }
    Ok(())
}

/// The images of a folder, of a flight log or of a bag.
fn read_pairs(args: &CameraArgs) -> Result<Vec<Pair>> {
    let most = args.max_images as usize;
    let kind = recording_kind(&args.source);
    let (pairs, total) = if kind != RecordingKind::Dataset {
        let recorded = match kind {
            RecordingKind::Log => read_log(&args.source, most, args.mono)?,
            _ => read_bag(&args.source, &args.topics.names()?, most, args.mono)?,
        };
        (recorded.pairs, recorded.total)
    } else {
        let images = Images::list(&args.source, most, args.mono)?;
        if images.cameras == 2 && images.unpaired > 0 {
            say(format_args!("{} images are of one camera alone", images.unpaired));
        }
        let image = |file: &Option<PathBuf>| file.as_deref().map(read).transpose();
        let pair = |moment: &Moment| {
            let [left, right] = moment.files.each_ref().map(image);
            Ok(Pair { name: moment.name.clone(), images: [left?, right?] })
        };
        (images.moments.iter().map(pair).collect::<Result<_>>()?, images.total)
    };
    if total > pairs.len() {
        say(format_args!("{} of {total} moments, evenly spread (--max-images)", pairs.len()));
    }
    Ok(pairs)
}

/// Calibrates under a bar of progress.
fn calibrated(args: &CameraArgs, pairs: &[Pair], detector: &Detector) -> Result<Calibration> {
    let images: usize = pairs.iter().map(|pair| pair.images.iter().flatten().count()).sum();
    let bar = bar(Some(images as u64), "{pos}/{len} images");
    let calibration = calibrate(pairs, &args.target, args.lens, detector, &mut || bar.inc(1));
    bar.finish_and_clear();
    Ok(calibration?)
}
