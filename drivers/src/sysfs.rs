//! What the kernel shows of devices: folders, links, and attributes, which are small files of text.

use crate::DriverError;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// An attribute is a page at most, bytes.
const MAX_BYTES: u64 = 4096;
/// Entries of a folder that are looked at, at most.
const MAX_ENTRIES: usize = 1024;

/// Entries of a folder in order of their names; none if it does not exist.
pub fn entries(folder: &Path) -> Vec<PathBuf> {
    let listed = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = listed.take(MAX_ENTRIES).map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// The text of an attribute, without blanks around it and without what controls a terminal; none where it is not there or
/// cannot be read.
pub fn text(path: &Path) -> Option<String> {
    let mut text = Vec::new();
    std::fs::File::open(path).ok()?.take(MAX_BYTES).read_to_end(&mut text).ok()?;
    let text = String::from_utf8_lossy(&text);
    Some(text.trim().chars().filter(|c| !c.is_control()).collect())
}

/// A number, finite.
pub fn number(path: &Path) -> Option<f64> {
    text(path)?.parse().ok().filter(|number: &f64| number.is_finite())
}

/// The first of these attributes of a device that is a number.
pub fn first_number(folder: &Path, names: &[&str]) -> Option<f64> {
    names.iter().find_map(|name| number(&folder.join(name)))
}

/// Writes an attribute.
///
/// # Errors
/// With what to do about it.
pub fn write(path: &Path, value: &str) -> Result<(), DriverError> {
    std::fs::write(path, value).map_err(|error| match error.kind() {
        std::io::ErrorKind::PermissionDenied => DriverError::refused(
            path,
            "this user may not write it; run as root, or give the user's group the attribute by a udev rule",
        ),
        _ => DriverError::refused(path, format!("the kernel does not take {value:?} ({error})")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attributes_are_read_up_to_a_limit_and_show_no_controls() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("name");
        std::fs::write(&path, format!("a\x1b[31mb{}", "c".repeat(10_000))).unwrap();
        let shown = text(&path).unwrap();
        assert!(shown.starts_with("a[31mb") && shown.len() < MAX_BYTES as usize, "{shown}");
        assert_eq!(entries(folder.path()), [path]);
        assert!(entries(&folder.path().join("nothing")).is_empty());
    }
}
