//! Validation of the cameras behind Video4Linux: devices, what fits together, controls.

use crate::error::Violation;
use crate::options::{Config, PairBy, V4l2Control, V4l2Format};

const NAMES: &str = "give the stable path that `plumbline devices` lists, such as \
    \"/dev/v4l/by-path/platform-...-video-index0\", or \"\" for no device";
const ONE_DEVICE: &str = "give `driver.v4l2.right` the second device, or both cameras one size";

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    check_devices(config, found);
    check_one_device(config, found);
    check_exposure(config, found);
    for (i, control) in config.driver.v4l2.controls.iter().enumerate() {
        if let Err(reason) = V4l2Control::parse(control) {
            let cure = "write NAME=VALUE as `plumbline devices` lists it, such as \"power_line_frequency=1\"";
            found.push(Violation::new(format!("driver.v4l2.controls[{i}]"), reason, cure));
        }
    }
}

fn check_devices(config: &Config, found: &mut Vec<Violation>) {
    let v4l2 = &config.driver.v4l2;
    for (key, path) in [("driver.v4l2.left", &v4l2.left), ("driver.v4l2.right", &v4l2.right)] {
        if !path.is_empty() && (!path.starts_with('/') || path.contains('\0')) {
            found.push(Violation::new(key, format!("{path:?} is not an absolute path of a device"), NAMES));
        }
    }
    if v4l2.right.is_empty() {
        return;
    }
    let mut refuse = |reason: &str, cure: &str| {
        found.push(Violation::new("driver.v4l2.right", reason, cure));
    };
    if v4l2.left.is_empty() {
        refuse("there is no left device", "give `driver.v4l2.left` too; a single camera is the left one");
    } else if v4l2.left == v4l2.right {
        refuse("left and right are the same device", "leave it empty where one device gives both images");
    }
    if config.camera.len() == 1 {
        refuse(
            "there is one `[[camera]]` only",
            "add the calibration of the right camera, or leave this empty",
        );
    }
    if v4l2.format == V4l2Format::Y8i {
        refuse("format Y8I has both images in one device", "leave this empty, or choose another `format`");
    }
}

/// One device for two cameras, or one for one.
fn check_one_device(config: &Config, found: &mut Vec<Violation>) {
    let v4l2 = &config.driver.v4l2;
    if v4l2.left.is_empty() || !v4l2.right.is_empty() {
        return;
    }
    match config.camera.as_slice() {
        [left, right] if (left.width_px, left.height_px) != (right.width_px, right.height_px) => {
            let reason = format!(
                "one device gives both images, which are {} x {} and {} x {} px",
                left.width_px, left.height_px, right.width_px, right.height_px
            );
            found.push(Violation::new("camera[1].width_px", reason, ONE_DEVICE));
        }
        [_] if v4l2.format == V4l2Format::Y8i => {
            let cure = "choose another `format`, or add the second `[[camera]]`";
            found.push(Violation::new("driver.v4l2.format", "Y8I has the images of two cameras", cure));
        }
        _ => {}
    }
    if v4l2.pair_by == PairBy::Sequence {
        let cure = "leave it \"time\"; what one device gives is paired already";
        found.push(Violation::new("driver.v4l2.pair_by", "there is one device, and nothing to pair", cure));
    }
}

fn check_exposure(config: &Config, found: &mut Vec<Violation>) {
    let exposure_us = config.driver.v4l2.exposure_us;
    let Some(period_us) = config.camera.first().map(|camera| 1e6 / camera.rate_hz) else { return };
    if !config.driver.v4l2.left.is_empty() && exposure_us >= period_us {
        let reason = format!("{exposure_us} us do not fit into the {period_us:.0} us from frame to frame");
        let cure = "write it in microseconds, below 1/rate_hz of the cameras";
        found.push(Violation::new("driver.v4l2.exposure_us", reason, cure));
    }
}
