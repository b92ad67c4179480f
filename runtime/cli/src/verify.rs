//! `plumbline verify`: is what a flight log holds what comes out of its inputs?

use super::progress::bar;
use super::simulated::check_recorded;
use super::topics::TopicArgs;
use super::{Usage, say};
use anyhow::{Result, bail};
use clap::Args;
use plumbline_drivers::StereoSource;
use plumbline_estimator::places::Mapper;
use plumbline_flight::flight::open_recording;
use plumbline_flight::log::parts::existing_parts;
use plumbline_flight::log::verify::{Verification, verify};
use plumbline_flight::log::{KnownMap, LogReader};
use plumbline_flight::places::read_known_map;
use std::path::{Path, PathBuf};

/// Steps of the progress bar.
const STEPS: u64 = 1000;

const EXAMPLES: &str = "Examples:
  plumbline verify log.mcap                verify one log, and print all details
  plumbline verify flights/*.mcap          verify one after the other; exit status 1 if any differs";

/// Arguments of `plumbline verify`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct VerifyArgs {
    /// Flight logs. Further parts of a log (LOG.1.mcap and so on) are found automatically; arguments that name them
    /// are skipped.
    #[arg(value_name = "LOG.mcap", required = true)]
    pub logs: Vec<PathBuf>,
    /// EuRoC data set or ROS bag with the images, for a log that was recorded without them.
    #[arg(long, value_name = "DATASET|BAG")]
    pub images: Option<PathBuf>,
    /// Topics of that bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Map that the flight continued (`replay --map`).
    #[arg(long, value_name = "FILE.map")]
    pub map: Option<PathBuf>,
    /// Accept a log that is truncated or lacks outputs, if everything that can be compared is identical.
    #[arg(long)]
    pub allow_incomplete: bool,
    /// Print JSON: an object for each log.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// When a log cannot be executed, is not bit-identical, or is not complete.
pub fn run(args: &VerifyArgs) -> Result<()> {
    if let Some(folder) = args.logs.iter().find(|log| log.is_dir()) {
        return Err(Usage(of_folder(folder)).into());
    }
    for log in &args.logs {
        check_recorded(log)?;
        if !log.exists() {
            let message = format!("{}: does not exist; nothing was verified; check the path", log.display());
            return Err(Usage(message).into());
        }
    }
    let parts = args.logs.iter().flat_map(|log| existing_parts(log)).filter(|(part, _)| *part > 0);
    let parts: Vec<PathBuf> = parts.map(|(_, path)| path).collect();
    let logs: Vec<&PathBuf> = args.logs.iter().filter(|log| !parts.contains(log)).collect();
    if let [log] = logs[..] {
        return run_one(args, log);
    }
    if args.images.is_some() || args.map.is_some() {
        let message = "--images and --map belong to one log; verify such logs one by one";
        return Err(Usage(message.into()).into());
    }
    let mut failures = Vec::new();
    for log in &logs {
        if !args.json {
            say(format_args!("{}", log.display()));
        }
        failures.extend(run_one(args, log).err());
    }
    let count = failures.len();
    match failures.into_iter().next() {
        Some(first) => Err(first.context(format!("{count} of {} logs do not pass; the first", logs.len()))),
        None => Ok(()),
    }
}

/// Cure where a folder is given for a log.
fn of_folder(folder: &Path) -> String {
    let is_log = |entry: std::fs::DirEntry| entry.path().extension().is_some_and(|end| end == "mcap");
    let has_logs = std::fs::read_dir(folder).is_ok_and(|entries| entries.flatten().any(is_log));
    let folder = folder.display();
    match has_logs {
        true => format!("{folder}: is a folder; name the flight logs in it: {folder}/*.mcap"),
        false => format!(
            "{folder}: is a folder without flight logs (*.mcap); record one with `plumbline fly --record LOG.mcap` or `plumbline replay \
             SUBJECT --record LOG.mcap`, and name it"
        ),
    }
}

fn run_one(args: &VerifyArgs, log: &Path) -> Result<()> {
    let images = args.images.as_ref().map(|dataset| open_images(&args.topics, log, dataset)).transpose()?;
    let known = args.map.as_ref().map(|map| open_map(log, map)).transpose()?;
    let verified = under_a_bar(|progress| verify(log, images, known, progress))?;
    say(if args.json { serde_json::to_string_pretty(&verified)? } else { summary(&verified) });
    match objection(&verified, args.allow_incomplete) {
        Some(objection) => bail!("{}: {objection}", log.display()),
        None => Ok(()),
    }
}

/// Executes a log under a bar of progress.
pub(super) fn under_a_bar<T>(execute: impl FnOnce(&mut dyn FnMut(f64)) -> T) -> T {
    let bar = bar(Some(STEPS), "{percent} %  executing");
    let outcome = execute(&mut |done| bar.set_position((done * STEPS as f64) as u64));
    bar.finish_and_clear();
    outcome
}

/// Objection to a log, if any.
pub(super) fn objection(verified: &Verification, allow_incomplete: bool) -> Option<String> {
    if let Some(difference) = &verified.difference {
        return Some(format!("not bit-identical: {difference}"));
    }
    if verified.inputs_changed {
        return Some("not bit-identical: an input was changed after it was recorded".into());
    }
    if !verified.identical {
        return Some(format!("not bit-identical: {} outputs are not in the log", verified.not_recorded));
    }
    if !verified.complete && !allow_incomplete {
        let why = verified.damage.as_ref().map_or_else(String::new, |damage| format!(" ({damage})"));
        let s = verified.executed_s;
        let words = "not complete, though identical as far as it goes";
        return Some(format!("{words}, for {s:.2} s{why}; --allow-incomplete accepts that"));
    }
    None
}

/// The frames of the data set or bag, in the sizes of the log's cameras.
pub(super) fn open_images(topics: &TopicArgs, log: &Path, dataset: &Path) -> Result<Box<dyn StereoSource>> {
    check_recorded(dataset)?;
    let config = LogReader::open(log)?.about().config.clone();
    Ok(open_recording(dataset, Some(config), &topics.names()?, None, false)?.stereo)
}

/// The map, in the limits of the log's configuration.
pub(super) fn open_map(log: &Path, map: &Path) -> Result<KnownMap> {
    let config = LogReader::open(log)?.about().config.clone();
    Ok(read_known_map(map, Mapper::limits(config.setup()))?)
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
            "{:<18}{:.2} s: {} estimates, {} odometry outputs and {} poses in the map identical, from {} inertial samples",
            "executed",
            v.executed_s,
            v.estimates_identical,
            v.odometry_identical,
            v.map_poses_identical,
            v.readings
        ),
    ];
    let mut note = |name: &str, words: String| lines.push(format!("{name:<18}{words}"));
    if v.instants_identical > 0 {
        note("instants", format!("{} states identical", v.instants_identical));
    }
    if v.frames_refused > 0 {
        note("refused in flight", format!("{} frames", v.frames_refused));
    }
    if v.map_ends_at_fault {
        note("map", "executed up to the first fault of the program alone".into());
    }
    if v.truncated {
        note("truncated", "the log breaks off: the recorder was killed or could not write".into());
    }
    if let Some(damage) = &v.damage {
        note("whole until there", damage.clone());
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
        note("warning", "recorded by another build: bits are promised for the same sources alone".into());
    }
    if v.difference.is_none() {
        note("estimate digest", v.estimate_digest[..16].into());
    }
    lines.join("\n")
}
