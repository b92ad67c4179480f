//! Reading small text files with a bound, and finding lines in a text.

use crate::ConfigError;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of a configuration or calibration file; real ones have a few thousand.
pub(crate) const MAX_FILE_BYTES: u64 = 1 << 20;

/// The text of a file of at most [`MAX_FILE_BYTES`].
pub(crate) fn read_bounded(path: &Path) -> Result<String, ConfigError> {
    let failed = |source: std::io::Error| {
        let reason = format!("cannot be read ({source}); check the path and its permissions");
        ConfigError::unusable(path.display(), reason)
    };
    let file = File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    // The bound holds for pipes and growing files too: what the metadata say is not trusted.
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        let reason = format!("longer than {MAX_FILE_BYTES} bytes, so not a configuration; check the path");
        return Err(ConfigError::unusable(path.display(), reason));
    }
    String::from_utf8(bytes).map_err(|error| {
        let (line, column) = line_and_column(error.as_bytes(), error.utf8_error().valid_up_to());
        let reason = format!("line {line}, column {column}: not UTF-8 text; save the file as UTF-8");
        ConfigError::unusable(path.display(), reason)
    })
}

/// Line and column (in characters), both from 1, of a byte offset; an offset outside is taken to the end.
pub(crate) fn line_and_column(text: &[u8], offset: usize) -> (usize, usize) {
    let before = &text[..offset.min(text.len())];
    let line = before.iter().filter(|b| **b == b'\n').count() + 1;
    let start = before.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
    (line, String::from_utf8_lossy(&before[start..]).chars().count() + 1)
}

/// Beginnings of a text's lines, to find those of many offsets.
#[cfg(feature = "toml")]
pub(crate) struct Lines(Vec<usize>);

#[cfg(feature = "toml")]
impl Lines {
    pub fn of(text: &str) -> Self {
        Self(std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1)).collect())
    }

    /// The line, from 1, of a byte offset.
    pub fn at(&self, offset: usize) -> usize {
        self.0.partition_point(|start| *start <= offset)
    }
}
