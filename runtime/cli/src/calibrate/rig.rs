//! `plumbline calibrate rig`: position and attitude of the cameras on the IMU, and their time offset.

use super::super::simulated::check_recorded;
use super::super::topics::TopicArgs;
use super::super::{check_new, load_config, say, write_config};
use anyhow::{Context, Result};
use clap::Args;
use indicatif::ProgressBar;
use plumbline_checkup::camera_imu::ByHand;
use plumbline_config::options::image_sizes;
use plumbline_drivers::{Prefetch, StereoFrame, StereoSource as _};
use plumbline_flight::flight::{Flight, open_recording};
use plumbline_record::digest::config_hash;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  plumbline calibrate rig by-hand.mcap --config my.toml --out my-rig.toml
  plumbline simulate by-hand --path hand-held --duration 60
  plumbline calibrate rig by-hand --config sim --out rig.toml

Calibrate the cameras first (`calibrate camera`): this command does not change the pose between them. The initial configuration may be \
off by some degrees, centimetres and tens of milliseconds. Record a minute, 20 seconds at least: turn and move the rig about all its \
axes, by 20 degrees and 20 cm to both sides once every second or two. Keep texture in view all the time, and avoid motion blur. \
What is written is the configuration with camera.pose_b_c, rig.time_offset_s, and how well they are known in [rig]; `plumbline doctor` \
checks it. Exit status 1: the motion does not determine it; the message says what it lacks.";

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
    /// Also measure the readout of a rolling shutter (camera.readout_s). A stamp must then be the middle of the exposure of the
    /// middle row.
    #[arg(long)]
    pub readout: bool,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Replace an existing file.
    #[arg(long)]
    pub overwrite: bool,
}

/// Runs the command.
pub(super) fn run(args: &RigArgs) -> Result<()> {
    check_new(&args.out, args.overwrite)?;
    check_recorded(&args.source)?;
    let named = load_config(args.config.as_deref())?;
    let topics = args.topics.names()?;
    let told = || args.source.display().to_string();
    let mut recording = read(open_recording(&args.source, named, &topics, None, false)?)?;
    if args.readout {
        let (readout_s, sigma_s) = recording.find_readout().with_context(told)?;
        let found = match 1e3 * readout_s {
            0.0 => "none: a global shutter".to_owned(),
            ms => format!("{ms:.2} ms"),
        };
        say(format_args!("readout        {found}, one sigma {:.2} ms", 1e3 * sigma_s));
    }
    let found = recording.calibrate().with_context(told)?;
    found.table().iter().for_each(say);
    let text = format!(
        "# Made by `plumbline calibrate rig` of {}, {:.1} s.\n# Measured: {}camera.pose_b_c of the rig as a whole, and [rig].\n\n{}",
        args.source.display(),
        found.span_s,
        if args.readout { "camera.readout_s, " } else { "" },
        found.config.to_toml()?
    );
    let written = write_config(&args.out, &text)?;
    say(format_args!("{}: written, valid, hash {}", args.out.display(), config_hash(&written)));
    Ok(())
}

fn read(flight: Flight) -> Result<ByHand> {
    let Flight { mut imu, stereo, config, .. } = flight;
    let mut recording = ByHand::new(&config);
    let bar = stereo.expected_frames().map_or_else(ProgressBar::no_length, ProgressBar::new);
    let sizes_px = image_sizes(&config.camera);
    let mut stereo = Prefetch::new(stereo, sizes_px, config.driver.image_queue)?;
    let mut frame = StereoFrame::new(sizes_px);
    while stereo.next_frame(&mut frame)? {
        recording.add_frame(frame.sequence, frame.stamp, &[frame.image(0), frame.image(1)]);
        bar.inc(1);
    }
    while let Some(reading) = imu.next_reading()? {
        recording.add_sample(&reading.sample);
    }
    bar.finish_and_clear();
    Ok(recording)
}
