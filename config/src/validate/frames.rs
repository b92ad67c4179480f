//! Validation of the socket for frames.

use crate::Config;
use crate::error::Violation;
use crate::options::FramesConfig;

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    let path = &config.driver.frames.listen;
    if path.is_empty() {
        return;
    }
    let mut refuse = |reason: String, cure: &str| {
        found.push(Violation::new("driver.frames.listen", reason, cure));
    };
    const CURE: &str = "give an absolute path, such as \"/run/plumbline/frames\", or \"\" for none";
    if !path.starts_with('/') || path.contains('\0') {
        refuse(format!("{path:?} is not an absolute path"), CURE);
    } else if path.len() > FramesConfig::MAX_PATH_BYTES {
        refuse(format!("is longer than {} bytes", FramesConfig::MAX_PATH_BYTES), CURE);
    }
    if !config.driver.v4l2.left.is_empty() {
        let cure = "leave this empty, or `driver.v4l2.left`";
        refuse("frames come from the cameras of `driver.v4l2` already".into(), cure);
    }
}
