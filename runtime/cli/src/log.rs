//! `plumbline log`: what is in a flight log, as a list or as a file for Foxglove.

use super::simulated::check_recorded;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, say, verify};
use anyhow::{Result, bail};
use clap::Args;
use plumbline_flight::log::LogReader;
use plumbline_flight::log::build_id::BuildId;
use plumbline_flight::log::channel::Channel;
use plumbline_flight::log::export;
use plumbline_flight::log::inventory::{self, Inventory};
use plumbline_flight::log::reader::Ending;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  plumbline log log.mcap                             what it holds
  plumbline log log.mcap --foxglove scene.mcap       the same flight with landmarks, lines, keyframes and path, for Foxglove
  plumbline log lean.mcap --foxglove scene.mcap --images V1_01_easy    of a log without images";

/// Arguments of `plumbline log`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct LogArgs {
    /// Flight log. Its further parts (LOG.1.mcap and so on) are found automatically.
    #[arg(value_name = "LOG.mcap")]
    pub log: PathBuf,
    /// Print only the configuration of the flight, as TOML.
    #[arg(long, conflicts_with = "foxglove")]
    pub config: bool,
    /// Execute the log, and write what Foxglove draws to this file (MCAP): images, poses, transforms, events, and the scene
    /// of landmarks, lines and keyframes.
    #[arg(long, value_name = "OUT.mcap")]
    pub foxglove: Option<PathBuf>,
    /// With --foxglove: replace an existing file.
    #[arg(long, requires = "foxglove")]
    pub overwrite: bool,
    /// With --foxglove: EuRoC data set or ROS bag with the images, for a log that was recorded without them.
    #[arg(long, value_name = "DATASET|BAG", requires = "foxglove")]
    pub images: Option<PathBuf>,
    /// Topics of that bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// With --foxglove: map that the flight continued (`replay --map`).
    #[arg(long, value_name = "FILE.map", requires = "foxglove")]
    pub map: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When the log cannot be read or is damaged.
pub fn run(args: &LogArgs) -> Result<()> {
    check_recorded(&args.log)?;
    if let Some(out) = &args.foxglove {
        return export(args, out);
    }
    let mut reader = LogReader::open(&args.log)?;
    if args.config {
        say(reader.about().config.to_toml()?.trim_end());
        return Ok(());
    }
    let about = reader.about().clone();
    let row = |name: &str, words: String| say(format_args!("{name:<16}{words}"));
    row("flight", about.flight.clone());
    let megabytes = reader.total_bytes() as f64 * 1e-6;
    row("files", format!("{}, {megabytes:.1} MB, from part {}", reader.parts(), about.part));
    row("configuration", format!("{}, images {:?}", about.config_hash, about.images));
    let build = &about.build;
    let is_ours = if build.is_same_executable(BuildId::current()) { "this one" } else { "another" };
    row("build", format!("{is_ours}: {}, commit {}, {}", build.version, build.commit, build.target));
    row("", format!("{}, executable {:.16}", build.rustc, build.executable));
    row("processor", build.processor.clone());
    print(&inventory::take(&mut reader)?);
    Ok(())
}

/// Writes the file for Foxglove.
fn export(args: &LogArgs, out: &Path) -> Result<()> {
    check_outputs(&args.foxglove)?;
    if out.extension().is_none_or(|ending| ending != "mcap") {
        return Err(Usage(format!("{}: name the file with the ending .mcap", out.display())).into());
    }
    if out.exists() {
        let is_itself = || Some(out.canonicalize().ok()? == args.log.canonicalize().ok()?);
        let refuse = |why: &str| Err(Usage(format!("{}: {why}", out.display())).into());
        if !args.overwrite {
            return refuse("exists; name another file, or give --overwrite");
        }
        if is_itself().unwrap_or(true) {
            return refuse("is the log itself, which is never overwritten; name another file");
        }
        std::fs::remove_file(out)?;
    }
    let images =
        args.images.as_ref().map(|data| verify::open_images(&args.topics, &args.log, data)).transpose()?;
    let known = args.map.as_ref().map(|map| verify::open_map(&args.log, map)).transpose()?;
    let exported = verify::under_a_bar(|progress| export::export(&args.log, out, images, known, progress))?;
    say(format_args!(
        "{}: written, {} messages, {} keyframes in the scene; Foxglove opens it (layout: docs/foxglove.md)",
        out.display(),
        exported.messages,
        exported.keyframes
    ));
    // Where the execution went another way, its landmarks are not those of the flight.
    match verify::objection(&exported.verification, true) {
        Some(objection) => bail!("{}: the scene is not that of the flight: {objection}", args.log.display()),
        None => Ok(()),
    }
}

fn print(inventory: &Inventory) {
    let row = |name: &str, words: String| say(format_args!("{name:<16}{words}"));
    row("duration", format!("{:.3} s of data", inventory.duration_s));
    let ending = match inventory.ending {
        Ending::Flight => "with the flight",
        Ending::Room => "with the room it was given (recorder.max_total_mb); the flight went on",
        Ending::Truncated | Ending::Unknown => "truncated: the recorder was killed or could not write",
    };
    row("ends", ending.into());
    row("dropped", inventory.dropped.to_string());
    row(
        "inputs",
        if inventory.inputs_changed { "CHANGED after they were recorded" } else { "as recorded" }.into(),
    );
    say(format_args!("{:<22}{:>12}{:>16}", "channel", "messages", "bytes"));
    for (channel, content) in Channel::LOGGED.into_iter().zip(inventory.contents) {
        say(format_args!("{:<22}{:>12}{:>16}", channel.channel(), content.messages, content.bytes));
    }
}
