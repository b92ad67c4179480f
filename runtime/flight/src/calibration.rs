//! Calibrations that data sets bring, which are in YAML: a build without the feature `yaml` refuses them with the cure.

#[cfg(feature = "yaml")]
pub(crate) use plumbline_config::import::{euroc_cameras_into, euroc_into};
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
