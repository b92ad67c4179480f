//! `plumbline log`: what is in a flight log.

use super::say;
use anyhow::Result;
use clap::Args;
use plumbline_flight::log::LogReader;
use plumbline_flight::log::build_id::BuildId;
use plumbline_flight::log::channel::Channel;
use plumbline_flight::log::inventory::{self, Inventory};
use plumbline_flight::log::reader::Ending;
use std::path::PathBuf;

/// Arguments of `plumbline log`.
#[derive(Debug, Args)]
pub struct LogArgs {
    /// Flight log. Its further parts (LOG.1.mcap and so on) are found automatically.
    #[arg(value_name = "LOG.mcap")]
    pub log: PathBuf,
    /// Print only the configuration of the flight, as TOML.
    #[arg(long)]
    pub config: bool,
}

/// Runs the command.
///
/// # Errors
/// When the log cannot be read or is damaged.
pub fn run(args: &LogArgs) -> Result<()> {
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
    for (channel, content) in Channel::ALL.into_iter().zip(inventory.contents) {
        say(format_args!("{:<22}{:>12}{:>16}", channel.topic(), content.messages, content.bytes));
    }
}
