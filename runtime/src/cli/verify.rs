//! `plumbline verify`: is what a flight log holds what comes out of its inputs?

use super::say;
use crate::flight::open_dataset;
use crate::log::LogReader;
use crate::log::verify::{Verification, verify};
use anyhow::{Result, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_drivers::StereoSource;
use std::path::PathBuf;

/// Steps of the progress bar.
const STEPS: u64 = 1000;

/// Arguments of `plumbline verify`.
#[derive(Debug, Args)]
pub struct VerifyArgs {
    /// The flight log; its further parts (LOG.1.mcap and so on) are found beside it.
    #[arg(value_name = "LOG.mcap")]
    pub log: PathBuf,
    /// Take the images from this EuRoC data set: for a log that was recorded without them.
    #[arg(long, value_name = "DATASET")]
    pub images: Option<PathBuf>,
    /// Succeed also when the log breaks off or lacks outputs, if what can be compared is identical.
    #[arg(long)]
    pub allow_incomplete: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the log cannot be executed, is not bit-identical, or is not complete.
pub fn run(args: &VerifyArgs) -> Result<()> {
    let images = args.images.as_ref().map(|dataset| open_images(args, dataset)).transpose()?;
    let bar = ProgressBar::new(STEPS);
    let template = "{bar:32} {percent} %  executing  {elapsed} (eta {eta})";
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    let verified = verify(&args.log, images, &mut |done| bar.set_position((done * STEPS as f64) as u64));
    bar.finish_and_clear();
    let verified = verified?;
    say(if args.json { serde_json::to_string_pretty(&verified)? } else { summary(&verified) });
    let log = args.log.display();
    if let Some(difference) = &verified.difference {
        bail!("{log}: not bit-identical: {difference}");
    }
    if verified.inputs_changed {
        bail!("{log}: not bit-identical: an input was changed after it was recorded");
    }
    if !verified.identical {
        bail!("{log}: not bit-identical: {} outputs are not in the log", verified.not_recorded);
    }
    if !verified.complete && !args.allow_incomplete {
        bail!("{log}: not complete, though identical as far as it goes; --allow-incomplete accepts that");
    }
    Ok(())
}

/// The frames of the data set, in the sizes of the log's cameras.
fn open_images(args: &VerifyArgs, dataset: &std::path::Path) -> Result<Box<dyn StereoSource>> {
    let config = LogReader::open(&args.log)?.about().config.clone();
    Ok(open_dataset(dataset, Some(config), None, false)?.stereo)
}

fn summary(v: &Verification) -> String {
    let verdict = match (v.identical, v.complete) {
        (true, true) => "bit-identical",
        (true, false) => "bit-identical as far as it goes",
        (false, _) => "NOT bit-identical",
    };
    let mut lines = vec![
        format!("{:<18}{verdict}", "verdict"),
        format!(
            "{:<18}{} estimates and {} odometry outputs identical, from {} inertial samples",
            "executed", v.estimates_identical, v.odometry_identical, v.readings
        ),
    ];
    let mut note = |name: &str, words: String| lines.push(format!("{name:<18}{words}"));
    if v.frames_refused > 0 {
        note("refused in flight", format!("{} frames", v.frames_refused));
    }
    if v.truncated {
        note("truncated", "the log breaks off: the recorder was killed or could not write".into());
    }
    if v.ended_for_room {
        note("ended early", "the recording reached its size limit before the flight ended".into());
    }
    if v.not_recorded > 0 {
        note("not in the log", format!("{} outputs came out that it does not hold", v.not_recorded));
    }
    if v.not_executed > 0 {
        note("not compared", format!("{} recorded outputs, whose inputs it does not hold", v.not_executed));
    }
    if v.inputs_changed {
        note("inputs", "CHANGED after they were recorded".into());
    }
    if !v.same_build {
        note("warning", "recorded by another build: bits are promised for one and the same binary".into());
    }
    if v.difference.is_none() {
        note("estimate digest", v.estimate_digest[..16].into());
    }
    lines.join("\n")
}
