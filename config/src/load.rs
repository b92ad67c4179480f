//! Loading: TOML text to a [`ValidConfig`], and back.
//!
//! A text may name a preset that it starts from (`base`): it has then the keys in which it differs.
//!
//! A text passes three gates: the TOML grammar (refused with line and column), the shape
//! (unknown, missing and mistyped keys, [`crate::shape`]), the values ([`crate::validate`]). Each gate
//! reports everything it refuses at once.

use crate::error::{ConfigError, Violation};
use crate::keys::file;
use crate::mask_file;
use crate::options::Config;
use crate::presets::{DEFAULTS, PRESETS, choice, preset_file};
use crate::shape::{BASE_KEY, Document, alike};
use crate::text;
use crate::valid::ValidConfig;
use std::path::Path;
use toml::Table;

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
            // A word that is no path is meant as a preset.
            Some(word) if !word.contains(['/', '.']) && !name.exists() => Err(no_preset(word)),
            _ => Self::load(name),
        }
    }

    /// Parses and validates TOML text; `origin` names its source in messages. No file is opened: a mask must be one that was
    /// loaded and written again.
    ///
    /// # Errors
    /// When the text is not TOML or is refused.
    pub fn from_toml_str(text: &str, origin: &str) -> Result<ValidConfig, ConfigError> {
        Self::parse(text, origin, None)
    }

    /// As [`Self::from_toml_str`], with the pictures that the text names: relative paths start at `folder`.
    ///
    /// # Errors
    /// When the text is not TOML, or it or a picture is refused.
    pub fn from_toml_in(text: &str, origin: &str, folder: &Path) -> Result<ValidConfig, ConfigError> {
        Self::parse(text, origin, Some(folder))
    }

    fn parse(text: &str, origin: &str, folder: Option<&Path>) -> Result<ValidConfig, ConfigError> {
        let document = Document::parse(text, origin)?;
        let mut config = document.read(base_of(&document, origin)?, origin)?;
        let masks = folder.map_or(Ok(()), |folder| mask_file::read_all(&mut config, folder, origin));
        let valid = masks.and_then(|()| config.validated(origin));
        valid.map_err(|error| error.with_lines(|key| document.line_of(key)))
    }

    /// A configuration that ships with Plumbline, see [`PRESETS`].
    ///
    /// # Errors
    /// When there is no preset of that name.
    pub fn preset(name: &str) -> Result<ValidConfig, ConfigError> {
        Self::from_toml_str(preset_file(name)?, &format!("preset {name}"))
    }

    /// The configuration in full as TOML, defaults included: parsed again it is equal to `self`.
    ///
    /// # Errors
    /// When a number does not fit TOML, which no validated configuration contains.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string(self).map_err(unwritable)
    }

    /// As [`Self::to_toml`], with the comment of every key. Keys for experiments are there `with_experiments`, and where one of them
    /// differs from its default. `header` is the first comment.
    pub fn to_commented_toml(&self, header: &str, with_experiments: bool) -> String {
        let comment = format!("# {header}");
        let short = file::full(self, &comment, false);
        let is_whole = || Self::from_toml_str(&short, header).is_ok_and(|config| *config == *self);
        if !with_experiments && is_whole() { short } else { file::full(self, &comment, true) }
    }
}

/// Error of a name that is neither a file nor a preset.
fn no_preset(name: &str) -> ConfigError {
    if name == DEFAULTS {
        let reason = "no configuration by themselves, as cameras and IMU have no defaults; write `[[camera]]` and `[imu]` into a file \
                      (`plumbline config defaults` prints every key), or";
        return ConfigError::unusable(name, format!("{reason} {}", choice()));
    }
    let begins = PRESETS.iter().copied().filter(|known| !name.is_empty() && known.starts_with(name));
    let mut meant: Vec<&str> = begins.collect();
    if meant.is_empty() {
        meant.extend(alike(name, PRESETS.iter().copied()));
    }
    let cure = if meant.is_empty() { choice() } else { format!("did you mean {}?", meant.join(" or ")) };
    ConfigError::unusable(name, format!("no such file, and no preset of this name; {cure}"))
}

/// Table that a text starts from: a preset in full, or nothing where it is the defaults.
fn base_of(document: &Document<'_>, origin: &str) -> Result<Table, ConfigError> {
    let Some(name) = document.base().filter(|name| *name != DEFAULTS) else { return Ok(Table::new()) };
    if !PRESETS.contains(&&*name) {
        let cure = format!("choose one of {DEFAULTS}, {}", PRESETS.join(", "));
        let violation = Violation::new(BASE_KEY, format!("there is no preset {name:?}"), cure);
        return Err(ConfigError::one(origin, violation.at_line(document.line_of(BASE_KEY))));
    }
    Table::try_from(Config::preset(&name)?.into_inner()).map_err(unwritable)
}

fn unwritable(error: toml::ser::Error) -> ConfigError {
    ConfigError::unusable("configuration", format!("cannot be written as TOML ({error}); validate it first"))
}
