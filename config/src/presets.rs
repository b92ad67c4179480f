//! The configurations that ship with Plumbline.

use crate::error::ConfigError;

/// Names of the presets that [`Config::preset`](crate::Config::preset) knows: two in full, with a comment at every key, and
/// one for each rig of `docs/rigs`, with the keys in which it differs from the defaults.
pub const PRESETS: &[&str] =
    &["euroc", "sim", "mipi-stereo", "oak-d", "realsense-d435i", "realsense-d455", "zed-mini"];

/// The annotated text of a preset: a good start for a configuration of one's own.
///
/// # Errors
/// When there is no preset of that name.
pub fn preset_text(name: &str) -> Result<&'static str, ConfigError> {
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
