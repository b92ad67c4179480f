//! Texts in place of files, for fuzzers and tests that never touch the disk.

use super::{Import, euroc, kalibr, rig};
use crate::error::ConfigError;
use crate::import::file::File;
use crate::options::Config;

/// Reads the texts as the files of a EuRoC data set.
pub(crate) fn euroc_texts(base: Config, cam0: &str, imu0: &str) -> Result<Import, ConfigError> {
    let (cam0, imu0) = (File::parse(cam0, "cam0")?, File::parse(imu0, "imu0")?);
    euroc::calibration(vec![euroc::camera(&cam0, &euroc::pose(&imu0)?)?], &imu0)?.put_into(base, "texts")
}

/// Reads the texts as the files of Kalibr.
pub(crate) fn kalibr_texts(base: Config, camchain: &str, imu: &str) -> Result<Import, ConfigError> {
    let camchain = File::parse(camchain, "camchain.yaml")?;
    kalibr::convert(base, &camchain, &File::parse(imu, "imu.yaml")?)
}

/// Reads a text into `base`; every file that it names is `camera`.
pub(crate) fn rig_text(base: Config, text: &str, camera: &str) -> Result<Import, ConfigError> {
    let file = File::parse(text, "rig.yaml")?;
    rig::convert(base, &file, |name| File::parse(camera, &name.display().to_string()))
}
