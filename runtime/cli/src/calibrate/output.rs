//! The configuration that a calibration writes.

use super::super::{Usage, check_outputs, say};
use anyhow::{Context, Result};
use plumbline_config::{Config, ValidConfig};
use plumbline_record::digest::config_hash;
use std::path::{Path, PathBuf};

/// Refuses, before the work, outputs that could not be written, and a file that is there unless it may be replaced.
pub(super) fn check(out: &PathBuf, overwrite: bool) -> Result<(), Usage> {
    check_outputs([out])?;
    if out.exists() && !overwrite {
        return Err(Usage(format!("{}: exists; name another file, or give --overwrite", out.display())));
    }
    Ok(())
}

/// Writes `config` below `comment`, as it will be read.
pub(super) fn write(out: &Path, comment: &str, config: &ValidConfig) -> Result<()> {
    let text = format!("{comment}\n{}", config.to_toml()?);
    let back = Config::from_toml_str(&text, &out.display().to_string())?;
    std::fs::write(out, &text).with_context(|| out.display().to_string())?;
    say(format_args!("{}: written, valid, hash {}", out.display(), config_hash(&back)));
    Ok(())
}
