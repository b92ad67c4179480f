//! The configurations that ship with Plumbline. The files say what a preset starts from and in what it differs; the rest is in
//! the declarations of the keys.

use crate::Config;
use crate::error::ConfigError;
use crate::keys::file;

/// Names of the presets that [`Config::preset`](crate::Config::preset) knows: two that are printed in full, with a comment at
/// every key, and one for each rig of `docs/rigs`, with the keys in which it differs from the defaults.
pub const PRESETS: &[&str] =
    &["euroc", "sim", "mipi-stereo", "oak-d", "realsense-d435i", "realsense-d455", "zed-mini"];

/// Name of what a configuration starts from that names no preset.
pub(crate) const DEFAULTS: &str = "defaults";

/// Cure where another preset is to be named.
pub(crate) fn choice() -> String {
    format!("choose one of {}", PRESETS.join(", "))
}

/// The annotated text of a preset: a good start for a configuration of one's own. Keys for experiments are left out, see
/// [`every_key`].
///
/// # Errors
/// When there is no preset of that name.
pub fn preset_text(name: &str) -> Result<String, ConfigError> {
    if ["euroc", "sim"].contains(&name) {
        every_key(name, false)
    } else {
        preset_file(name).map(str::to_owned)
    }
}

/// Every key with a comment: the values of a preset, or, of the name `defaults`, the defaults, where a file has to add what is
/// required. Keys for experiments, which no user has a reason to turn, are there on request.
///
/// # Errors
/// When there is no preset of that name.
pub fn every_key(name: &str, with_experiments: bool) -> Result<String, ConfigError> {
    if name == DEFAULTS {
        return Ok(file::defaults(with_experiments));
    }
    preset_file(name).map(|_| in_full(name, with_experiments))
}

/// The file of a preset.
pub(crate) fn preset_file(name: &str) -> Result<&'static str, ConfigError> {
    match name {
        "euroc" => Ok(include_str!("../presets/euroc.toml")),
        "sim" => Ok(include_str!("../presets/sim.toml")),
        "mipi-stereo" => Ok(include_str!("../presets/mipi-stereo.toml")),
        "oak-d" => Ok(include_str!("../presets/oak-d.toml")),
        "realsense-d435i" => Ok(include_str!("../presets/realsense-d435i.toml")),
        "realsense-d455" => Ok(include_str!("../presets/realsense-d455.toml")),
        "zed-mini" => Ok(include_str!("../presets/zed-mini.toml")),
        _ => Err(ConfigError::unusable(format!("preset `{name}`"), format!("does not exist; {}", choice()))),
    }
}

/// The values of a preset with the comments of all keys, below the first one of its file.
fn in_full(name: &str, with_experiments: bool) -> String {
    let (text, config) =
        preset_file(name).and_then(|text| Ok((text, Config::preset(name)?))).expect("presets are tested");
    let header = text.lines().take_while(|line| line.starts_with('#')).collect::<Vec<_>>();
    file::full(&config, &header.join("\n"), with_experiments)
}
