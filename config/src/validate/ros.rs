//! Validation of names that ROS 2 is to understand.

use super::network::{is_endpoint, no_endpoint, shortened};
use crate::Config;
use crate::error::Violation;

/// Longest namespace and frame: both are part of keys or of every message.
const MAX_NAMESPACE_BYTES: usize = 128;
const MAX_FRAME_BYTES: usize = 64;

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    let ros = &config.ros;
    if !is_endpoint(&ros.router) {
        found.push(no_endpoint("ros.router".into(), &ros.router));
    }
    let namespace = ros.namespace(&config.network.vehicle);
    // The vehicle's name stands in only when it is needed: without ROS it may be what it wants.
    if (ros.enabled || !ros.namespace.is_empty()) && !is_namespace(&namespace) {
        let reason = format!("{} is no namespace of ROS", shortened(&namespace));
        let cure = "write /name or /name/name of letters, digits and single `_`, not beginning with a digit";
        found.push(Violation::new("ros.namespace", reason, cure));
    }
    let frames = [
        ("ros.map_frame", &ros.map_frame),
        ("ros.odom_frame", &ros.odom_frame),
        ("ros.base_frame", &ros.base_frame),
        ("ros.body_frame", &ros.body_frame),
    ];
    for (i, (key, frame)) in frames.into_iter().enumerate() {
        if !is_frame(frame) {
            let reason = format!("{} is no name of a frame", shortened(frame));
            let cure = "use 1 to 64 letters, digits, `_`, `-`, `.` and `/`, not beginning with `/`";
            found.push(Violation::new(key, reason, cure));
        }
        if let Some((other, _)) = frames[..i].iter().find(|(_, earlier)| *earlier == frame) {
            let reason = format!("{} is the name of `{other}` too", shortened(frame));
            let cure = "give every frame a name of its own, such as map, odom, base_link (the vehicle) and body (the IMU)";
            found.push(Violation::new(key, reason, cure));
        }
    }
}

/// True if it is absolute and fully qualified, as the design article on topic names requires.
fn is_namespace(text: &str) -> bool {
    let is_token = |token: &str| {
        token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !token.contains("__")
    };
    text == "/"
        || text.len() <= MAX_NAMESPACE_BYTES
            && text.strip_prefix('/').is_some_and(|names| names.split('/').all(is_token))
}

/// tf2 refuses a leading slash.
fn is_frame(text: &str) -> bool {
    (1..=MAX_FRAME_BYTES).contains(&text.len())
        && !text.starts_with('/')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.' | '/'))
}
