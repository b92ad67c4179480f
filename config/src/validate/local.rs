//! Validation of the local socket.

use crate::error::Violation;
use crate::options::LocalConfig;

/// Checks the path of a socket; none where it is empty.
pub(super) fn check_path(key: &str, path: &str, most: usize, example: &str, found: &mut Vec<Violation>) {
    let reason = if path.is_empty() {
        return;
    } else if !path.starts_with('/') || path.contains('\0') || path.ends_with('/') {
        format!("{path:?} is not an absolute path of a file")
    } else if path.len() > most {
        format!("is longer than {most} bytes")
    } else {
        return;
    };
    found.push(Violation::new(
        key,
        reason,
        format!("give an absolute path, such as {example:?}, or \"\" for none"),
    ));
}

pub(super) fn check(local: &LocalConfig, found: &mut Vec<Violation>) {
    check_path("local.path", &local.path, LocalConfig::MAX_PATH_BYTES, "/run/plumbline/local", found);
    if local.mode_bits().is_none() {
        let reason = format!("{:?} is no octal number of permissions", local.mode);
        let cure =
            "give three octal digits, such as \"0660\" (owner and group) or \"0666\" (everyone may read)";
        found.push(Violation::new("local.mode", reason, cure));
    }
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if !local.group.chars().all(is_plain) || local.group.len() > 64 {
        let reason = format!("{:?} is no name or number of a group", local.group);
        let cure = "name a group of this computer, such as \"plumbline\", or \"\" for that of the process";
        found.push(Violation::new("local.group", reason, cure));
    }
}
