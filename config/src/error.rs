//! Errors of a configuration or calibration file, with file, key and cure.

use std::fmt;
use std::path::PathBuf;

/// One key that was refused: where, why, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// Path of the key, such as `camera[1].pose_b_c`.
    pub key: String,
    /// Line of the file, from 1, where it is known.
    pub line: Option<usize>,
    /// Defect of the value.
    pub reason: String,
    /// Cure.
    pub cure: String,
}

impl Violation {
    /// A violation of unknown line.
    pub fn new(key: impl Into<String>, reason: impl Into<String>, cure: impl Into<String>) -> Self {
        Self { key: key.into(), line: None, reason: reason.into(), cure: cure.into() }
    }

    /// Returns the violation with its line in the file.
    #[must_use]
    pub fn at_line(self, line: Option<usize>) -> Self {
        Self { line, ..self }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}`", self.key)?;
        if let Some(line) = self.line {
            write!(f, " (line {line})")?;
        }
        write!(f, ": {}; {}", self.reason, self.cure)
    }
}

/// Error of a configuration that was refused. Its message names the file, the key and the cure.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file could not be read.
    #[error("{}: cannot be read ({source}); check the path and its permissions", file.display())]
    Read {
        /// The file asked for.
        file: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The file is far longer than any configuration.
    #[error("{}: longer than {limit_bytes} bytes, so not a configuration; check the path", file.display())]
    TooLong {
        /// The file asked for.
        file: PathBuf,
        /// Most bytes that are read.
        limit_bytes: u64,
    },
    /// The text is not TOML or YAML.
    #[error("{origin}: line {line}, column {column}: {message}; {cure}")]
    Syntax {
        /// File or other origin of the text.
        origin: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// Expectation of the parser.
        message: String,
        /// Cure.
        cure: String,
    },
    /// A configuration was expected, and the text is YAML.
    #[error(
        "{origin}: is YAML, and a configuration is TOML; make one of calibration files with `plumbline config import` (Kalibr: \
         --camchain and --imu; a data set: --euroc; other programs: --rig), and give that"
    )]
    Yaml {
        /// File or other origin of the text.
        origin: String,
    },
    /// Keys or values were refused: all of them, in the order of the file where that is known.
    #[error("{origin}: {}", list(violations))]
    Invalid {
        /// File or other origin of the text.
        origin: String,
        /// Every refused key; never empty.
        violations: Vec<Violation>,
    },
    /// There is no preset of this name.
    #[error("preset `{name}` does not exist; choose one of {}", known.join(", "))]
    UnknownPreset {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: &'static [&'static str],
    },
    /// Neither a file nor a preset of this name exists.
    #[error(
        "{name}: no such file, and no preset of this name; {}",
        if alike.is_empty() { format!("choose one of {}", known.join(", ")) } else { format!("did you mean {}?", alike.join(" or ")) }
    )]
    NeitherFileNorPreset {
        /// The name asked for.
        name: String,
        /// Presets with a similar name.
        alike: Vec<&'static str>,
        /// The names there are.
        known: &'static [&'static str],
    },
    /// The defaults were named as a configuration, and there are none for the sensors.
    #[error(
        "defaults: no configuration by themselves, as cameras and IMU have no defaults; write `[[camera]]` and `[imu]` into a file \
         (`plumbline config defaults` prints every key), or choose one of {}",
        known.join(", ")
    )]
    OnlyDefaults {
        /// Names of the presets.
        known: &'static [&'static str],
    },
    /// A directory holds no calibration in a layout that is understood.
    #[error("{}: no calibration found; expected {expected}", directory.display())]
    NoCalibration {
        /// The directory asked for.
        directory: PathBuf,
        /// The layouts that are understood.
        expected: &'static str,
    },
    /// The configuration cannot be written as TOML: it has not passed validation.
    #[error("the configuration cannot be written as TOML ({reason}); validate it first")]
    Unwritable {
        /// Error of the serializer.
        reason: String,
    },
}

impl ConfigError {
    /// The refused keys; empty for errors of another kind.
    #[must_use]
    pub fn violations(&self) -> &[Violation] {
        match self {
            Self::Invalid { violations, .. } => violations,
            _ => &[],
        }
    }

    /// Returns the error with the line of every refused key, in the order of the file.
    #[cfg(feature = "toml")]
    pub(crate) fn with_lines(mut self, line_of: impl Fn(&str) -> Option<usize>) -> Self {
        if let Self::Invalid { violations, .. } = &mut self {
            for violation in violations.iter_mut() {
                violation.line = line_of(&violation.key);
            }
            violations.sort_by_key(|violation| violation.line);
        }
        self
    }

    /// `Ok` when nothing was refused.
    pub(crate) fn if_any(origin: &str, violations: Vec<Violation>) -> Result<(), Self> {
        if violations.is_empty() {
            Ok(())
        } else {
            Err(Self::Invalid { origin: origin.to_owned(), violations })
        }
    }

    #[cfg(any(feature = "toml", feature = "yaml"))]
    pub(crate) fn one(origin: &str, violation: Violation) -> Self {
        Self::Invalid { origin: origin.to_owned(), violations: vec![violation] }
    }
}

/// Most refused keys that a message lists.
const MAX_LISTED: usize = 40;

fn list(violations: &[Violation]) -> String {
    if let [one] = violations {
        return one.to_string();
    }
    let mut text = format!("{} keys refused", violations.len());
    for violation in violations.iter().take(MAX_LISTED) {
        text += &format!("\n  {violation}");
    }
    if violations.len() > MAX_LISTED {
        text += &format!("\n  and {} more", violations.len() - MAX_LISTED);
    }
    text
}
