//! Loading: TOML text to a validated [`Config`], and back.
//!
//! A text passes three gates: the TOML grammar ([`ConfigError::Syntax`] with line and column), the shape
//! (unknown, missing and mistyped keys, [`crate::shape`]), the values ([`crate::validate`]). Each gate
//! reports everything it refuses at once.

use crate::error::{ConfigError, Violation};
use crate::shape::Document;
use crate::{Config, text};
use std::path::Path;

/// Names of the presets that [`Config::preset`] knows.
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

impl Config {
    /// Reads and validates a TOML file.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, or is refused; the message names file, key and cure.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        Self::from_toml_str(&text::read_bounded(path)?, &path.display().to_string())
    }

    /// Parses and validates TOML text; `origin` names its source in messages.
    ///
    /// # Errors
    /// When the text is not TOML or is refused.
    pub fn from_toml_str(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let document = Document::parse(text, origin)?;
        ConfigError::if_any(origin, document.violations())?;
        let config: Self = toml::from_str(text).map_err(|error| {
            // The shape check knows every key; what it lets through and serde refuses is told in serde's words.
            let line = error.span().map(|span| text::line_and_column(text, span.start).0);
            let violation = Violation::new("(file)", error.message().trim(), "compare with a preset");
            ConfigError::one(origin, violation.at_line(line))
        })?;
        let mut violations = config.violations();
        for violation in &mut violations {
            violation.line = document.line_of(&violation.key);
        }
        violations.sort_by_key(|violation| violation.line);
        ConfigError::if_any(origin, violations)?;
        Ok(config)
    }

    /// A configuration that ships with Plumbline, see [`PRESETS`].
    ///
    /// # Errors
    /// When there is no preset of that name.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        Self::from_toml_str(preset_text(name)?, &format!("preset {name}"))
    }

    /// The configuration in full as TOML, defaults included: parsed again it is equal to `self`.
    ///
    /// # Errors
    /// When a number does not fit TOML, which no validated configuration contains.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(self).map_err(|error| ConfigError::Unwritable { reason: error.to_string() })
    }

    /// `self` when it passes validation; `origin` names its source in messages.
    ///
    /// # Errors
    /// When a value is refused.
    pub fn validated(self, origin: &str) -> Result<Self, ConfigError> {
        ConfigError::if_any(origin, self.violations())?;
        Ok(self)
    }
}
