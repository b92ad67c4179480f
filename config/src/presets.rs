//! The configurations that ship with Plumbline.

use crate::error::ConfigError;

/// Names of the presets that [`Config::preset`](crate::Config::preset) knows.
pub const PRESETS: &[&str] = &["euroc", "sim"];

/// The annotated text of a preset: a good start for a configuration of one's own.
///
/// # Errors
/// When there is no preset of that name.
pub fn preset_text(name: &str) -> Result<&'static str, ConfigError> {
    match name {
        "euroc" => Ok(include_str!("../presets/euroc.toml")),
        "sim" => Ok(include_str!("../presets/sim.toml")),
        _ => Err(ConfigError::UnknownPreset { name: name.to_owned(), known: PRESETS }),
    }
}
