//! Names of ROS bags and of their topics, which a build without the feature `bags` knows too.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// File that describes a bag of several files.
pub(crate) const METADATA: &str = "metadata.yaml";
/// Endings of the files of bags; each may be followed by that of Zstandard.
const ENDINGS: [&str; 3] = ["mcap", "db3", "bag"];
const PACKED: &str = ".zstd";
/// Ending of a ROS 1 bag that is still being recorded.
const ACTIVE: &str = ".bag.active";

/// Names of the topics to fly; where one is not given it is looked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BagTopics {
    /// Images of the left camera.
    pub left: Option<String>,
    /// Images of the right camera.
    pub right: Option<String>,
    /// Inertial samples; where gyroscope and accelerometer are apart, either of them.
    pub imu: Option<String>,
    /// The accelerometer, where several topics could be it.
    pub accel: Option<String>,
}

/// True if there may be a bag at `path`: a file with the ending of one, or a directory with a description or
/// such files.
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return path.join(METADATA).is_file() || !listed(path).is_empty();
    }
    has_ending(path)
}

fn has_ending(path: &Path) -> bool {
    let name = path.file_name().and_then(OsStr::to_str).unwrap_or_default();
    name.ends_with(ACTIVE) || parts(name).is_some()
}

/// Name without the number at its end, that number, and the ending, of the file of a bag: bag_10.mcap comes after
/// bag_9.mcap.
fn parts(name: &str) -> Option<(&str, u64, &str)> {
    let (stem, ending) = name.strip_suffix(PACKED).unwrap_or(name).rsplit_once('.')?;
    if !ENDINGS.contains(&ending) {
        return None;
    }
    let base = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    Some((base, stem[base.len()..].parse().unwrap_or(0), ending))
}

/// The files of bags in a directory by the numbers at the end of their names, then by name.
pub(crate) fn listed(path: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(path) else { return Vec::new() };
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| has_ending(file) && file.is_file());
    files.sort_by_key(|file| (parts_of(file).map_or(0, |(_, number, _)| number), file.clone()));
    files
}

pub(crate) fn parts_of(file: &Path) -> Option<(&str, u64, &str)> {
    parts(file.file_name()?.to_str()?)
}
