//! Tests by behaviour: what is accepted, what is refused and how it is said, and that nothing panics.

mod camera;
mod import_euroc;
mod import_kalibr;
mod import_rig;
mod loading;
mod presets;
mod rigs;
mod robustness;
mod validation;
mod validation_network;

use crate::{Config, ConfigError, ValidConfig, import};

/// The preset `euroc`.
fn euroc() -> ValidConfig {
    Config::preset("euroc").expect("the preset is good")
}

/// The preset `euroc` with the calibration of Kalibr's files.
fn kalibr_texts(camchain: &str, imu: &str) -> Result<ValidConfig, ConfigError> {
    import::fuzzing::kalibr_texts(euroc().into_inner(), camchain, imu).map(|import| import.config)
}

/// The preset `euroc` with the calibration of the files of a data set.
fn euroc_texts(camera: &str, imu: &str) -> Result<ValidConfig, ConfigError> {
    import::fuzzing::euroc_texts(euroc().into_inner(), camera, imu).map(|import| import.config)
}

/// `text` with one occurrence of `from` replaced, which must be there.
fn with(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from} is in the text");
    text.replacen(from, to, 1)
}
