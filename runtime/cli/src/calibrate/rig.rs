//! `plumbline calibrate rig`: place and attitude of the cameras on the IMU, and their time offset.

use super::super::simulated::check_recorded;
use super::super::topics::TopicArgs;
use super::super::{Usage, load_config, say};
use super::output;
use anyhow::Result;
use clap::Args;
use indicatif::ProgressBar;
use plumbline_flight::flight::open_recording;
use plumbline_lab::calibrate::rig::{FoundRig, RigOptions, calibrate};
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  plumbline calibrate rig by-hand.mcap --config my.toml --out my-rig.toml
  plumbline simulate by-hand --path hand-held --duration 60
  plumbline calibrate rig by-hand --config sim --out rig.toml

Calibrate the cameras first (`calibrate camera`): this command does not change the pose between them. Record a minute or two: one \
second at rest, then turn and move the rig about all its axes, by 20 degrees and 20 cm to both sides once every second or two. \
Keep texture in view all the time, and avoid motion blur.";

/// Arguments of `plumbline calibrate rig`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct RigArgs {
    /// A recording moved by hand: a EuRoC data set, a flight log or a ROS bag (.mcap, .db3, .bag).
    pub source: PathBuf,
    /// Configuration to write.
    #[arg(long, value_name = "OUT.toml")]
    pub out: PathBuf,
    /// Initial configuration: a file or preset. Default: the preset `euroc` with the calibration of the data set, or
    /// the configuration of the log.
    #[arg(long, value_name = "FILE|PRESET")]
    pub config: Option<PathBuf>,
    /// Standard deviation of the initial attitude of the cameras, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 2.0)]
    pub rotation_sigma_deg: f64,
    /// Standard deviation of the initial position of the cameras, mm.
    #[arg(long, value_name = "MM", default_value_t = 30.0)]
    pub translation_sigma_mm: f64,
    /// Standard deviation of the initial time offset, ms.
    #[arg(long, value_name = "MS", default_value_t = 10.0)]
    pub time_offset_sigma_ms: f64,
    /// Also measure the readout of a rolling shutter (camera.readout_s), which takes 11 passes more. A stamp must then be the middle of
    /// the exposure of the middle row.
    #[arg(long)]
    pub readout: bool,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Replace an existing file.
    #[arg(long)]
    pub overwrite: bool,
}

impl RigArgs {
    fn options(&self) -> Result<RigOptions, Usage> {
        let positive = |name: &str, value: f64, most: f64| match value > 0.0 && value <= most {
            true => Ok(value),
            false => Err(Usage(format!("--{name} {value}: give a number above 0, up to {most}"))),
        };
        Ok(RigOptions {
            rotation_sigma_rad: positive("rotation-sigma-deg", self.rotation_sigma_deg, 10.0)?.to_radians(),
            translation_sigma_m: 1e-3 * positive("translation-sigma-mm", self.translation_sigma_mm, 500.0)?,
            time_offset_sigma_s: 1e-3 * positive("time-offset-sigma-ms", self.time_offset_sigma_ms, 50.0)?,
            finds_readout: self.readout,
            ..RigOptions::default()
        })
    }
}

/// Runs the command.
pub(super) fn run(args: &RigArgs) -> Result<()> {
    output::check(&args.out, args.overwrite)?;
    check_recorded(&args.source)?;
    let options = args.options()?;
    let named = load_config(args.config.as_deref())?;
    let topics = args.topics.names()?;
    let first = open_recording(&args.source, named, &topics, None, false)?;
    let (config, frames) = (first.config.clone(), first.stereo.expected_frames());
    drop(first);
    let bar = frames.map_or_else(ProgressBar::no_length, ProgressBar::new);
    let mut open =
        |config: &_| open_recording(&args.source, Some(Clone::clone(config)), &topics, None, false);
    let mut progress = |pass: usize, frames: u64| {
        bar.set_message(format!("pass {pass}"));
        bar.set_position(frames);
    };
    let found = calibrate(&config, &options, &mut open, &mut progress);
    bar.finish_and_clear();
    let found =
        found.map_err(|error| anyhow::Error::from(error).context(args.source.display().to_string()))?;
    found.table().iter().for_each(say);
    output::write(&args.out, &comment(args, &found), &found.config)
}

fn comment(args: &RigArgs, found: &FoundRig) -> String {
    format!(
        "# Made by `plumbline calibrate rig` of {}, {:.1} s.\n# Measured: {}camera.pose_b_c of the rig as a whole, and [rig].\n{}",
        args.source.display(),
        found.span_s,
        if found.readout.is_some() { "camera.readout_s, " } else { "" },
        found.covariance_comment()
    )
}
