//! The map that a flight went on with: an input of its execution, which a log names by its hash.

use super::LogError;
use super::part_header::PartHeader;
use plumbline_estimator::places::PlaceMap;
use std::path::Path;

/// A map from a file.
pub struct KnownMap {
    /// Keyframes, in a map of the limits of the flight's configuration.
    pub map: PlaceMap,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// The map that the flight of the log at `path` went on with, if `given` is that one.
pub(super) fn known_map(
    path: &Path,
    about: &PartHeader,
    given: Option<KnownMap>,
) -> Result<Option<PlaceMap>, LogError> {
    let words = match (&about.known_map, given) {
        (None, None) => return Ok(None),
        (Some(hash), Some(given)) if *hash == given.sha256 => return Ok(Some(given.map)),
        (None, Some(_)) => "is of a flight that began without a map; leave --map out",
        (Some(_), None) => "is of a flight that went on with a map; give the same file with --map",
        (Some(_), Some(_)) => "is of a flight that went on with another map than that of --map",
    };
    Err(LogError::unusable(path, words))
}
