//! A calibration as a configuration: that of a base with its cameras replaced.

use super::result::Calibration;
use super::table;
use plumbline_config::options::{CameraConfig, rows_from_isometry};
use plumbline_config::{Config, ConfigError, ValidConfig};
use std::fmt::Write as _;

/// `base` with the cameras of a calibration, at `rate_hz` frames a second or the base's. The left camera keeps its place
/// in the body, which images of a board do not tell; the right one is placed from there.
///
/// # Errors
/// When the values are refused; `origin` names them in messages.
pub fn configuration(
    base: &ValidConfig,
    calibration: &Calibration,
    rate_hz: Option<f64>,
    origin: &str,
) -> Result<ValidConfig, ConfigError> {
    let mut config: Config = base.clone().into();
    let pose_b_c0 = base.camera[0].pose_b_c();
    let rate_hz = rate_hz.unwrap_or(base.camera[0].rate_hz);
    let pose = |index: usize| match (&calibration.pair, index) {
        (Some(pair), 1) => rows_from_isometry(&(pose_b_c0 * pair.pose_c0_c1)),
        _ => base.camera[0].pose_b_c,
    };
    let cameras = calibration.cameras.iter().enumerate().map(|(index, camera)| CameraConfig {
        width_px: camera.model.width_px,
        height_px: camera.model.height_px,
        rate_hz,
        readout_s: 0.0,
        exposure_s: 0.0,
        mask: None,
        focal_px: camera.model.focal_px.into(),
        centre_px: camera.model.centre_px.into(),
        distortion: camera.model.distortion,
        pose_b_c: pose(index),
    });
    config.camera = cameras.collect();
    config.validated(origin)
}

/// The text of the configuration, with the figures of the calibration as comments above.
///
/// # Errors
/// When it cannot be written as TOML.
pub fn text(
    config: &ValidConfig,
    calibration: &Calibration,
    source: &str,
    base: &str,
) -> Result<String, ConfigError> {
    let mut text =
        format!("# Made by `plumbline calibrate camera {source} --target {}`.\n#\n", calibration.target);
    for line in table::figures(calibration) {
        let _ = writeln!(text, "# {line}");
    }
    let _ = writeln!(
        text,
        "#\n# Values with one standard deviation, by the images alone: lengths scale with the measured size of the board.\n\
         # Where camera[0] sits on the IMU (camera[0].pose_b_c) and all else are of {base}.\n"
    );
    text.push_str(&config.to_toml()?);
    Ok(text)
}
