//! `plumbline calibrate masks`: what the cameras see of their own vehicle.

use super::super::topics::TopicArgs;
use super::super::{Usage, check_outputs, load_config, say};
use anyhow::{Context, Result};
use clap::Args;
use indicatif::ProgressBar;
use plumbline_flight::flight::{Flight, open_recording};
use plumbline_lab::calibrate::mask::{SIDES, find, write};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  plumbline calibrate masks flight.mcap --config my.toml --out .
  plumbline simulate with-legs --condition vehicle-parts
  plumbline calibrate masks with-legs --config sim --out .

Record a flight of half a minute, or carry the vehicle through a textured room. Legs, struts and cables are found; turning rotors \
are not, because their edges are elsewhere in every image: paint their discs black in the pictures.";

/// Arguments of `plumbline calibrate masks`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct MasksArgs {
    /// A recording in motion: a EuRoC data set, a flight log with images or a ROS bag (.mcap, .db3, .bag).
    pub source: PathBuf,
    /// Folder for left-mask.png and right-mask.png, usually that of the configuration.
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Configuration with the sizes of the images: a file or preset. Default: that of the recording.
    #[arg(long, value_name = "FILE|PRESET")]
    pub config: Option<PathBuf>,
    /// Width of the margin around what is found, px.
    #[arg(long, value_name = "PX", default_value_t = 8)]
    pub margin_px: u16,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Replace existing files.
    #[arg(long)]
    pub overwrite: bool,
}

/// Runs the command.
pub(super) fn run(args: &MasksArgs) -> Result<()> {
    let files = SIDES.map(|side| args.out.join(format!("{side}-mask.png")));
    check_outputs(files.iter())?;
    if let Some(file) = files.iter().find(|file| file.exists() && !args.overwrite) {
        return Err(
            Usage(format!("{}: exists; name another folder, or give --overwrite", file.display())).into()
        );
    }
    let named = load_config(args.config.as_deref())?;
    let Flight { mut stereo, config, .. } =
        open_recording(&args.source, named, &args.topics.names()?, None, false)?;
    let bar = stereo.expected_frames().map_or_else(ProgressBar::no_length, ProgressBar::new);
    let found =
        find(&mut *stereo, &config.camera, args.margin_px.into(), &mut |frames| bar.set_position(frames));
    bar.finish_and_clear();
    let found = found.with_context(|| args.source.display().to_string())?;
    let views = found.views;
    let hides: Vec<_> =
        found.masks.iter().zip(&files).zip(SIDES).filter(|((mask, _), _)| mask.seen_share() < 1.0).collect();
    if hides.is_empty() {
        say(format_args!(
            "nothing of the vehicle is in view of any camera, by {views} views: no mask is needed, and none is written"
        ));
        return Ok(());
    }
    for ((mask, file), side) in &hides {
        write(file, mask).with_context(|| file.display().to_string())?;
        let hidden_percent = 100.0 * (1.0 - mask.seen_share());
        say(format_args!(
            "{}: {hidden_percent:.1} % of the {side} image, from {views} views",
            file.display()
        ));
    }
    say("In the configuration:");
    hides.iter().for_each(|((_, file), side)| {
        say(format_args!("  [[camera]]  # {side}\n  mask = {:?}", name_of(file)));
    });
    Ok(())
}

/// The name by which a configuration in the same folder knows the file.
fn name_of(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
