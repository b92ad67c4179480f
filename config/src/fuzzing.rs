//! Entry points of the fuzzers (`fuzz/`): each function takes any bytes, and a panic is a finding.
//!
//! The tests of this crate run these functions over the checked-in seeds, and over seeded mutations of them.

use crate::import::fuzzing::{euroc_texts, kalibr_texts, rig_text};
use crate::options::{AutopilotEndpoint, ImuEndpoint, SerialLine};
use crate::validate::is_endpoint;
use crate::{Config, ConfigError, ValidConfig};

/// Stands between the text of the camera and that of the IMU where an importer takes two.
const BETWEEN_FILES: &str = "\n%%%\n";

/// A configuration: what is accepted can be written, comes back as it was, and makes camera models.
///
/// # Panics
/// When it does not.
pub fn config_toml(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    check(Config::from_toml_str(text, "fuzz"));
}

/// The `sensor.yaml` of a camera and of an IMU of a EuRoC data set.
///
/// # Panics
/// As [`config_toml`].
pub fn import_euroc(data: &[u8]) {
    if let Some((camera, imu)) = two_texts(data) {
        check(euroc_texts(preset("euroc"), camera, imu).map(|import| import.config));
    }
}

/// Kalibr's `camchain-imucam.yaml` and `imu.yaml`.
///
/// # Panics
/// As [`config_toml`].
pub fn import_kalibr(data: &[u8]) {
    if let Some((camchain, imu)) = two_texts(data) {
        check(kalibr_texts(preset("euroc"), camchain, imu).map(|import| import.config));
    }
}

/// The address of an autopilot or of an inertial sensor, and an endpoint of the network.
///
/// # Panics
/// When an accepted address does not hold what was given.
pub fn endpoint(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = is_endpoint(text);
    match AutopilotEndpoint::parse(text) {
        Ok(AutopilotEndpoint::Udp(address)) => assert!(text.ends_with(&address)),
        Ok(AutopilotEndpoint::UdpIn { at, from }) => {
            assert!(text.contains(&at) && text.contains("?from=") == from.is_some());
        }
        Ok(AutopilotEndpoint::Serial(line)) => serial_line(text, &line),
        Err(reason) => assert!(!reason.is_empty()),
    }
    match ImuEndpoint::parse(text) {
        Ok(ImuEndpoint::Serial(line)) => serial_line(text, &line),
        Ok(ImuEndpoint::Iio { gyro, accel }) => {
            assert!(!gyro.is_empty() && text.contains(&gyro));
            assert!(accel.is_none_or(|accel| !accel.is_empty() && text.ends_with(&accel)));
        }
        Err(reason) => assert!(!reason.is_empty()),
    }
}

fn serial_line(text: &str, line: &SerialLine) {
    assert!(line.device.starts_with('/') && line.baud > 0 && text.contains(&line.device));
}

/// Factory calibration of a ZED.
///
/// # Panics
/// When what is accepted cannot be written, or an error says nothing.
pub fn import_zed(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    check(
        crate::import::zed::zed_text_into(preset("zed-mini"), text, "fuzz")
            .and_then(|config| config.validated("fuzz")),
    );
}

/// Calibration of another program, and the camera file that it names.
///
/// # Panics
/// As [`config_toml`].
pub fn import_rig(data: &[u8]) {
    let Some((rig, camera)) = two_texts(data) else { return };
    check(rig_text(preset("euroc"), rig, camera).map(|rig| rig.config));
}

fn preset(name: &str) -> Config {
    Config::preset(name).expect("is a preset").into_inner()
}

fn two_texts(data: &[u8]) -> Option<(&str, &str)> {
    std::str::from_utf8(data).ok()?.split_once(BETWEEN_FILES)
}

fn check(read: Result<ValidConfig, ConfigError>) {
    let config = match read {
        Ok(config) => config,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let text = config.to_toml().expect("a validated configuration can be written");
    let back = Config::from_toml_str(&text, "written").expect("what was written is accepted");
    assert_eq!(back, config);
    for camera in &config.camera {
        let _ = camera.model();
    }
}

#[cfg(test)]
#[path = "../../fuzz/smoke.rs"]
mod smoke;

#[cfg(test)]
mod tests {
    use super::Config;
    use super::smoke::over_seeds_and_mutations;

    #[test]
    fn seeds_of_configurations_are_accepted() {
        let folder = plumbline_test_support::workspace().join("fuzz/seeds/config_toml");
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let text = std::fs::read_to_string(&path).unwrap();
            let read = Config::from_toml_str(&text, "seed");
            assert!(read.is_ok(), "{}: {}", path.display(), read.unwrap_err());
        }
    }

    #[test]
    fn fuzz_config_toml() {
        over_seeds_and_mutations("config_toml", 400, super::config_toml);
    }

    #[test]
    fn fuzz_import_euroc() {
        over_seeds_and_mutations("import_euroc", 2000, super::import_euroc);
    }

    #[test]
    fn fuzz_import_kalibr() {
        over_seeds_and_mutations("import_kalibr", 2000, super::import_kalibr);
    }

    #[test]
    fn fuzz_import_rig() {
        over_seeds_and_mutations("import_rig", 2000, super::import_rig);
    }

    #[test]
    fn fuzz_import_zed() {
        over_seeds_and_mutations("import_zed", 2000, super::import_zed);
    }

    #[test]
    fn fuzz_endpoint() {
        over_seeds_and_mutations("endpoint", 20_000, super::endpoint);
    }
}
