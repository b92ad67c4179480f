//! In place of the crate json5 and the generator of parsers that it brings: a session's settings come as JSON, which serde_json
//! reads. See `../README.md`.

#![forbid(unsafe_code)]

use serde::Deserialize;
use serde_json::de::StrRead;
use std::fmt;

/// Reason why a text is no JSON.
#[derive(Debug)]
pub struct Error(serde_json::Error);

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for Error {}

/// Source of deserializers.
pub struct Deserializer;

impl Deserializer {
    /// Deserializer of a text.
    ///
    /// # Errors
    /// None: what is wrong with the text is found when it is read.
    #[allow(clippy::should_implement_trait)]
    pub fn from_str(text: &str) -> Result<serde_json::Deserializer<StrRead<'_>>, Error> {
        Ok(serde_json::Deserializer::from_str(text))
    }
}

/// Reads a value.
///
/// # Errors
/// When the text is no JSON, or of another type.
pub fn from_str<'a, T: Deserialize<'a>>(text: &'a str) -> Result<T, Error> {
    serde_json::from_str(text).map_err(Error)
}
