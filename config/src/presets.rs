//! The configurations that ship with Plumbline. The files say what a preset starts from and in what it differs; the rest is in
//! the declarations of the keys.

use crate::Config;
use crate::error::ConfigError;
use crate::keys::file::{self, Remarks};
use crate::shape::Document;
use std::sync::LazyLock;

/// Names of the presets that [`Config::preset`](crate::Config::preset) knows: two that are printed in full, with a comment at
/// every key, and one for each rig of `docs/rigs`, with the keys in which it differs from the defaults.
pub const PRESETS: &[&str] =
    &["euroc", "sim", "mipi-stereo", "oak-d", "realsense-d435i", "realsense-d455", "zed-mini"];

/// Name of what a configuration starts from that names no preset.
pub(crate) const DEFAULTS: &str = "defaults";

/// The annotated text of a preset: a good start for a configuration of one's own. Keys for experiments are left out, see
/// [`every_key`].
///
/// # Errors
/// When there is no preset of that name.
pub fn preset_text(name: &str) -> Result<&'static str, ConfigError> {
    static IN_FULL: [LazyLock<String>; 2] =
        [LazyLock::new(|| in_full("euroc", false)), LazyLock::new(|| in_full("sim", false))];
    match name {
        "euroc" => Ok(&IN_FULL[0]),
        "sim" => Ok(&IN_FULL[1]),
        _ => preset_file(name),
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
        _ => Err(ConfigError::UnknownPreset { name: name.to_owned(), known: PRESETS }),
    }
}

/// The values of a preset with all comments: those of the keys, of its file and of what that starts from.
fn in_full(name: &str, with_experiments: bool) -> String {
    let config = Config::preset(name).expect("presets are tested");
    let mut remarks = Remarks::default();
    files(name).iter().rev().for_each(|text| remarks.add(text));
    file::full(&config, &remarks, with_experiments)
}

/// The file of a preset, that which it starts from, and so on.
fn files(name: &str) -> Vec<&'static str> {
    let Ok(text) = preset_file(name) else { return Vec::new() };
    let document = Document::parse(text, name);
    let base = document.as_ref().ok().and_then(Document::base).map_or(DEFAULTS, |(base, _)| base);
    [vec![text], files(base)].concat()
}
