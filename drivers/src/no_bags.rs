//! ROS bags in a build without the feature `bags`: a bag is known by its name, and can be refused
//! ([`crate::DriverError::LeftOut`]).

use std::path::Path;

/// Names of the topics to fly; where one is not given it is looked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BagTopics {
    /// Images of the left camera.
    pub left: Option<String>,
    /// Images of the right camera.
    pub right: Option<String>,
    /// Inertial samples.
    pub imu: Option<String>,
    /// The accelerometer, where several topics could be it.
    pub accel: Option<String>,
}

/// True if there may be a bag at `path`: a file with the ending of one, or a directory with a description.
#[must_use]
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return path.join("metadata.yaml").is_file();
    }
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let name = name.strip_suffix(".zstd").unwrap_or(name);
    [".mcap", ".db3", ".bag", ".bag.active"].iter().any(|ending| name.ends_with(ending))
}
