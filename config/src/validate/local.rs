//! Validation of the local socket.

use crate::error::Violation;
use crate::options::LocalConfig;

pub(super) fn check(local: &LocalConfig, found: &mut Vec<Violation>) {
    let path = &local.path;
    if !path.is_empty() {
        const CURE: &str = "give an absolute path, such as \"/run/plumbline/local\", or \"\" for none";
        if !path.starts_with('/') || path.contains('\0') || path.ends_with('/') {
            found.push(Violation::new(
                "local.path",
                format!("{path:?} is not an absolute path of a file"),
                CURE,
            ));
        } else if path.len() > LocalConfig::MAX_PATH_BYTES {
            let reason = format!("is longer than {} bytes", LocalConfig::MAX_PATH_BYTES);
            found.push(Violation::new("local.path", reason, CURE));
        }
    }
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
