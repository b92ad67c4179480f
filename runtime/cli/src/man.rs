//! `plumbline man`: manual pages, made from the command line itself.

use anyhow::Context as _;
use clap::{Args, Command};
use std::path::PathBuf;

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
    let written = std::fs::create_dir_all(&args.folder).and_then(|()| {
        clap_mangen::generate_to(command.mut_subcommand("help", |help| help.hide(true)), &args.folder)
    });
    written.with_context(|| args.folder.display().to_string())
}
