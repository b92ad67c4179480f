//! Loading: TOML text to a [`ValidConfig`], and back.
//!
//! A text passes three gates: the TOML grammar ([`ConfigError::Syntax`] with line and column), the shape
//! (unknown, missing and mistyped keys, [`crate::shape`]), the values ([`crate::validate`]). Each gate
//! reports everything it refuses at once.

use crate::error::{ConfigError, Violation};
use crate::mask_file;
use crate::options::Config;
use crate::presets::{PRESETS, preset_text};
use crate::shape::Document;
use crate::text;
use crate::valid::ValidConfig;
use std::path::Path;

impl Config {
    /// Reads and validates a TOML file.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, or is refused; the message names file, key and cure.
    pub fn load(path: impl AsRef<Path>) -> Result<ValidConfig, ConfigError> {
        let path = path.as_ref();
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::from_toml_in(&text::read_bounded(path)?, &path.display().to_string(), folder)
    }

    /// The preset of that name, else the file at that path: what an option for a configuration takes.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn load_or_preset(name: impl AsRef<Path>) -> Result<ValidConfig, ConfigError> {
        let name = name.as_ref();
        match name.to_str() {
            Some(preset) if PRESETS.contains(&preset) => Self::preset(preset),
            _ => Self::load(name),
        }
    }

    /// Parses and validates TOML text; `origin` names its source in messages. No file is opened: a mask must be one that was
    /// loaded and written again.
    ///
    /// # Errors
    /// When the text is not TOML or is refused.
    pub fn from_toml_str(text: &str, origin: &str) -> Result<ValidConfig, ConfigError> {
        Self::parse(text, origin, |_| Ok(()))
    }

    /// As [`Self::from_toml_str`], with the pictures that the text names: relative paths start at `folder`.
    ///
    /// # Errors
    /// When the text is not TOML, or it or a picture is refused.
    pub fn from_toml_in(text: &str, origin: &str, folder: &Path) -> Result<ValidConfig, ConfigError> {
        Self::parse(text, origin, |config| mask_file::read_all(config, folder, origin))
    }

    fn parse(
        text: &str,
        origin: &str,
        complete: impl FnOnce(&mut Self) -> Result<(), ConfigError>,
    ) -> Result<ValidConfig, ConfigError> {
        let document = Document::parse(text, origin)?;
        ConfigError::if_any(origin, document.violations())?;
        let mut config: Self = toml::from_str(text).map_err(|error| {
            // The shape check knows every key; what it lets through and serde refuses is told in serde's words.
            let line = error.span().map(|span| text::line_and_column(text, span.start).0);
            let violation = Violation::new("(file)", error.message().trim(), "compare with a preset");
            ConfigError::one(origin, violation.at_line(line))
        })?;
        let valid = complete(&mut config).and_then(|()| config.validated(origin));
        valid.map_err(|error| error.with_lines(|key| document.line_of(key)))
    }

    /// A configuration that ships with Plumbline, see [`PRESETS`].
    ///
    /// # Errors
    /// When there is no preset of that name.
    pub fn preset(name: &str) -> Result<ValidConfig, ConfigError> {
        Self::from_toml_str(preset_text(name)?, &format!("preset {name}"))
    }

    /// The configuration in full as TOML, defaults included: parsed again it is equal to `self`.
    ///
    /// # Errors
    /// When a number does not fit TOML, which no validated configuration contains.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(self).map_err(|error| ConfigError::Unwritable { reason: error.to_string() })
    }
}
