//! `plumbline bench`: what the standard load costs on this machine.

use super::{Usage, check_outputs, say};
use anyhow::{Context, Result};
use clap::Args;
use plumbline_lab::bench::{self, Bench};
use std::path::PathBuf;

/// Arguments of `plumbline bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Length of the flight in each scene, seconds.
    #[arg(long, default_value_t = 20.0)]
    pub duration: f64,
    /// Cache the rendered frames in this folder.
    #[arg(long, value_name = "FOLDER")]
    pub cache: Option<PathBuf>,
    /// Write the figures, for a later --baseline.
    #[arg(long, value_name = "OUT.json")]
    pub save: Option<PathBuf>,
    /// Compare with figures written by --save.
    #[arg(long, value_name = "FILE")]
    pub baseline: Option<PathBuf>,
    /// Print the figures as JSON instead of the table.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be simulated, or a file cannot be read or written.
pub fn run(args: &BenchArgs) -> Result<()> {
    if !(args.duration >= 3.0 && args.duration <= 600.0) {
        return Err(Usage("--duration: give 3 to 600 seconds".into()).into());
    }
    check_outputs(&args.save)?;
    let baseline = args.baseline.as_deref().map(read).transpose()?;
    // Rendered frames take 14 MB a second: without a folder of their own they go when the bench ends.
    let scratch = std::env::temp_dir().join(format!("plumbline-bench-{}", std::process::id()));
    let cache = args.cache.as_ref().unwrap_or(&scratch);
    let outcome = bench::run(args.duration, cache, |load| eprintln!("{load} ..."));
    if args.cache.is_none() {
        let _ = std::fs::remove_dir_all(&scratch);
    }
    let bench = outcome?;
    let json = serde_json::to_string_pretty(&bench)?;
    if let Some(path) = &args.save {
        std::fs::write(path, &json).with_context(|| format!("{}", path.display()))?;
    }
    say(if args.json { json } else { bench.table(baseline.as_ref()) });
    Ok(())
}

fn read(path: &std::path::Path) -> Result<Bench> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| Usage(format!("--baseline: {}: {error}", path.display())))?;
    serde_json::from_str(&text).map_err(|error| {
        Usage(format!("--baseline: {}: {error}; give a file written by --save", path.display())).into()
    })
}
