//! Validation of the socket for frames.

use super::local::check_path;
use crate::Config;
use crate::error::Violation;
use crate::options::FramesConfig;

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    const KEY: &str = "driver.frames.listen";
    let path = &config.driver.frames.listen;
    check_path(KEY, path, FramesConfig::MAX_PATH_BYTES, "/run/plumbline/frames", found);
    if !path.is_empty() && !config.driver.v4l2.left.is_empty() {
        let reason = "frames come from the cameras of `driver.v4l2` already";
        found.push(Violation::new(KEY, reason, "leave this empty, or `driver.v4l2.left`"));
    }
}
