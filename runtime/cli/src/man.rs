//! `plumbline man`: manual pages, made from the command line itself.

use anyhow::Context as _;
use clap::{Args, Command};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, roman};
use std::fs;
use std::path::{Path, PathBuf};

/// The section of `man` that programs are in.
const SECTION: &str = "1";

#[derive(Debug, Args)]
pub struct ManArgs {
    /// Folder for plumbline.1, plumbline-replay.1 and so on. It is created if missing.
    folder: PathBuf,
}

/// Writes the pages of `command` and of all below it.
///
/// # Errors
/// When the folder cannot be written.
pub fn run(command: Command, args: &ManArgs) -> anyhow::Result<()> {
    let told = || args.folder.display().to_string();
    fs::create_dir_all(&args.folder).with_context(told)?;
    let mut command = command.disable_help_subcommand(true);
    // Names of commands become those of their pages.
    command.build();
    write_pages(&command, &args.folder).with_context(told)
}

fn write_pages(command: &Command, folder: &Path) -> std::io::Result<()> {
    for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
        write_pages(below, folder)?;
    }
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    fs::write(folder.join(format!("{name}.{SECTION}")), page(command)?)
}

/// A page, as troff.
fn page(command: &Command) -> std::io::Result<Vec<u8>> {
    let source = concat!("plumbline ", env!("CARGO_PKG_VERSION"));
    let titled = command.clone().subcommand_value_name("command").subcommand_help_heading("COMMANDS");
    let man = Man::new(titled).section(SECTION).source(source).manual("Plumbline");
    let mut page = Vec::new();
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    if command.get_arguments().any(|argument| !argument.is_hide_set()) {
        man.render_options_section(&mut page)?;
    }
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    if let Some(after) = command.get_after_long_help().or_else(|| command.get_after_help()) {
        notes(&after.to_string()).to_writer(&mut page)?;
    }
    Ok(page)
}

/// Notes below the help. Lines that are indented are commands, and stay as they are; others are filled.
fn notes(after_help: &str) -> Roff {
    const EXAMPLES: &str = "Examples:";
    let mut roff = Roff::new();
    roff.control("SH", [if after_help.starts_with(EXAMPLES) { "EXAMPLES" } else { "NOTES" }]);
    let mut is_command = false;
    for line in after_help.lines().filter(|line| *line != EXAMPLES) {
        if line.starts_with(' ') != is_command {
            is_command = !is_command;
            roff.control(if is_command { "EX" } else { "EE" }, []);
        }
        if line.trim().is_empty() {
            roff.control("PP", []);
        } else {
            roff.text([roman(line)]);
        }
    }
    if is_command {
        roff.control("EE", []);
    }
    roff
}
