//! `--learn`: the refined calibration of a flight as a configuration.

use anyhow::{Context, Result};
use plumbline_flight::flight::Flown;
use plumbline_flight::learnt::Learnt;
use std::path::Path;

/// Writes what `flown` has learnt of the calibration to `path`.
///
/// # Errors
/// When it has learnt nothing, or the file cannot be written.
pub fn write_learnt(path: &Path, flown: &Flown) -> Result<()> {
    let learnt = Learnt::of(flown).with_context(|| format!("--learn {}: not written", path.display()))?;
    let text = format!("{}\n{}", learnt.comment, learnt.config.to_toml()?);
    std::fs::write(path, text).with_context(|| path.display().to_string())
}
