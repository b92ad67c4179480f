//! Errors of a configuration or calibration file, with file, key and cure.

use std::fmt;

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
    /// Keys or values were refused: all of them, in the order of the file where that is known.
    #[error("{origin}: {}", list(violations))]
    Invalid {
        /// File or other origin of the text.
        origin: String,
        /// Every refused key; never empty.
        violations: Vec<Violation>,
    },
    /// It cannot be read, or is something else.
    #[error("{origin}: {reason}")]
    Unusable {
        /// File or other origin of the text.
        origin: String,
        /// Defect, where it is, and the cure.
        reason: String,
    },
}

impl ConfigError {
    /// The refused keys; empty for errors of another kind.
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

    #[cfg(any(feature = "toml", feature = "yaml"))]
    pub(crate) fn unusable(origin: impl fmt::Display, reason: impl Into<String>) -> Self {
        Self::Unusable { origin: origin.to_string(), reason: reason.into() }
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
