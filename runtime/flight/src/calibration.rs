//! Calibrations that data sets bring, which are in YAML: a build without the feature `yaml` refuses them with the cure.

#[cfg(feature = "yaml")]
pub(crate) use plumbline_config::import::{euroc_cameras_into, euroc_into, euroc_pose};
#[cfg(not(feature = "yaml"))]
pub(crate) use refused as euroc_into;
#[cfg(not(feature = "yaml"))]
pub(crate) use refused as euroc_cameras_into;

#[cfg(not(feature = "yaml"))]
pub(crate) fn refused(
    _base: plumbline_config::ValidConfig,
    directory: &std::path::Path,
) -> Result<plumbline_config::ValidConfig, plumbline_config::ConfigError> {
    Err(plumbline_config::ConfigError::NoCalibration {
        directory: directory.to_owned(),
        expected: "--config FILE: this build was made without the feature `yaml`, and reads no sensor.yaml (`make build` makes a full one)",
    })
}

/// Stand-in of a build without `yaml`: the pose of a sensor is not read, and its truth is refused rather than taken for that of
/// the body.
#[cfg(not(feature = "yaml"))]
pub(crate) fn euroc_pose(
    sensor: &std::path::Path,
) -> Result<Option<nalgebra::Isometry3<f64>>, plumbline_config::ConfigError> {
    Err(plumbline_config::ConfigError::NoCalibration {
        directory: sensor.to_owned(),
        expected: "a build with the feature `yaml`, which reads where the sensor of the ground truth is (`make build` makes a full one)",
    })
}
