//! Checks of arguments before anything is opened or flown.

use anyhow::Context as _;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use plumbline_config::{Config, ConfigError, ValidConfig};
use rustix::fs::OFlags;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

/// A failure of usage: exit status 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// A configuration file or preset, if one is named.
///
/// # Errors
/// When it cannot be used.
pub fn load_config(file: Option<&Path>) -> Result<Option<ValidConfig>, ConfigError> {
    file.map(Config::load_or_preset).transpose()
}

/// Refuses a map that nothing could be put into: with one camera there is no depth, and so no place to be recognized.
///
/// # Errors
/// When a map is read or written with one camera, or with places switched off.
pub fn check_maps(config: &ValidConfig, reads: bool, writes: bool) -> Result<(), Usage> {
    let option = match (reads, writes) {
        (true, _) => "--map",
        (false, true) => "--save-map",
        (false, false) => return Ok(()),
    };
    if config.camera.len() < 2 {
        return Err(Usage(format!(
            "{option}: a map needs two cameras, and there is one; leave it out, or add the second [[camera]]"
        )));
    }
    if !config.estimator.places.enabled {
        return Err(Usage(format!(
            "{option}: estimator.places.enabled is false, so no map is made; leave it out, or set that to true"
        )));
    }
    Ok(())
}

/// Refuses ROS 2, which needs the vehicle's attitude, while the mounting of the IMU is unknown.
///
/// # Errors
/// When it is.
pub fn check_mounting(config: &ValidConfig) -> Result<(), Usage> {
    config.ros_rot_v_b().map(drop).map_err(|unknown| Usage(unknown.to_string()))
}

/// Refuses output files that could not be written, before the run rather than after it: what cannot be opened, and two
/// outputs in one file.
///
/// # Errors
/// When one cannot be opened for writing, or is named twice.
pub fn check_outputs<'a>(files: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Usage> {
    let mut seen: Vec<&PathBuf> = Vec::new();
    for file in files {
        let refuse = |why: &str| Err(Usage(format!("{}: {why}", file.display())));
        if seen.contains(&file) {
            return refuse("is the path of two outputs; name two files");
        }
        seen.push(file);
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
        if folder.is_some_and(|folder| !folder.is_dir()) {
            return refuse("its directory does not exist; create it first");
        }
        if file.is_dir() || file.as_os_str().as_encoded_bytes().ends_with(b"/") {
            return refuse("is a directory; name a file to write");
        }
        if let Err(error) = try_writing(file) {
            return refuse(&format!("cannot be written ({error}); name another file"));
        }
    }
    Ok(())
}

/// As [`check_outputs`] of one file, which is not replaced unless that is asked for.
///
/// # Errors
/// When it cannot be opened for writing, or is there already.
pub fn check_new(file: &PathBuf, overwrite: bool) -> Result<(), Usage> {
    check_outputs([file])?;
    match file.exists() && !overwrite {
        true => Err(Usage(format!("{}: exists; name another file, or give --overwrite", file.display()))),
        false => Ok(()),
    }
}

/// Writes a configuration, if it will be read as one.
///
/// # Errors
/// When a value is refused, or the file cannot be written.
pub fn write_config(file: &Path, text: &str) -> anyhow::Result<ValidConfig> {
    let name = file.display().to_string();
    let config = Config::from_toml_str(text, &name)?;
    std::fs::write(file, text).context(name)?;
    Ok(config)
}

/// Opens a file for writing and leaves it as it was; a named pipe that nobody reads is refused, where it would be waited for.
fn try_writing(file: &Path) -> std::io::Result<()> {
    if file.exists() {
        let flags = OFlags::NONBLOCK.bits().cast_signed();
        return std::fs::OpenOptions::new().append(true).custom_flags(flags).open(file).map(drop);
    }
    std::fs::OpenOptions::new().write(true).create_new(true).open(file)?;
    std::fs::remove_file(file)
}

/// Reads one of these names, each with what it is for and its value.
pub fn choice<T: Clone + Send + Sync + 'static, const N: usize>(
    known: [(&'static str, &'static str, T); N],
) -> impl TypedValueParser<Value = T> {
    let names = known.each_ref().map(|(name, about, _)| PossibleValue::new(*name).help(*about));
    PossibleValuesParser::new(names).try_map(move |given| {
        let found = known.iter().find(|(name, ..)| *name == given);
        found.map(|(.., value)| value.clone()).ok_or("no such name")
    })
}

/// `A..B`, both optional, as a pair.
///
/// # Errors
/// When it is not a range.
pub fn parse_range<T: std::str::FromStr + PartialOrd + Copy>(
    text: &str,
) -> Result<(Option<T>, Option<T>), String> {
    let bad = || format!("'{text}' is not a range: write A..B, such as 5..10");
    let (from, to) = text.split_once("..").ok_or_else(bad)?;
    let part = |s: &str| if s.is_empty() { Ok(None) } else { s.parse().map(Some).map_err(|_| bad()) };
    let (from, to) = (part(from)?, part(to)?);
    match (from, to) {
        (Some(a), Some(b)) if a >= b => Err(format!("'{text}' is an empty range")),
        range => Ok(range),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_named_pipe_that_nobody_reads_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("report.json");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let refusal = check_outputs([&pipe]).unwrap_err().to_string();
        assert!(refusal.contains("report.json: cannot be written"), "{refusal}");
    }

    #[test]
    fn ranges_are_half_open_and_checked() {
        assert_eq!(parse_range::<f64>("5..7.5"), Ok((Some(5.0), Some(7.5))));
        assert_eq!(parse_range::<usize>("3.."), Ok((Some(3), None)));
        assert!(parse_range::<usize>("7..3").is_err() && parse_range::<usize>("x").is_err());
    }
}
