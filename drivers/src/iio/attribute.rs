//! Attributes of sysfs: small files of text.

use crate::DriverError;
use std::io::Read as _;
use std::path::Path;

/// An attribute is a page at most, bytes.
const MAX_BYTES: u64 = 4096;

/// The text of an attribute, without blanks around it; none where it is not there or cannot be read.
pub fn text(path: &Path) -> Option<String> {
    let mut text = String::new();
    std::fs::File::open(path).ok()?.take(MAX_BYTES).read_to_string(&mut text).ok()?;
    Some(text.trim().to_owned())
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
