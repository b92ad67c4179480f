//! Validation of the sockets of this computer: for programs that read the flight, and for frames.

use crate::error::Violation;
use crate::options::{Config, FramesConfig, LocalConfig};

/// Checks the path of a socket; none where it is empty.
fn check_path(key: &str, path: &str, most: usize, example: &str, found: &mut Vec<Violation>) {
    let is_path = path.starts_with('/') && !path.contains('\0') && !path.ends_with('/') && path.len() <= most;
    if !path.is_empty() && !is_path {
        let reason = format!("{path:?} is not an absolute path of a file of at most {most} bytes");
        let cure = format!("give an absolute path, such as {example:?}, or \"\" for none");
        found.push(Violation::new(key, reason, cure));
    }
}

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    let (local, listen) = (&config.local, &config.driver.frames.listen);
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
    const KEY: &str = "driver.frames.listen";
    check_path(KEY, listen, FramesConfig::MAX_PATH_BYTES, "/run/plumbline/frames", found);
    if !listen.is_empty() && !config.driver.v4l2.left.is_empty() {
        let reason = "frames come from the cameras of `driver.v4l2` already";
        found.push(Violation::new(KEY, reason, "leave this empty, or `driver.v4l2.left`"));
    }
}
