//! EuRoC data sets: one `sensor.yaml` a sensor, in the ASL format.
//!
//! `T_BS` takes coordinates from the sensor to the data set's body. Plumbline's body is the IMU: where the
//! IMU's own `T_BS` is not the identity, the cameras are moved by its inverse.

use super::file::{At, File};
use super::lens::Camera;
use super::{Calibration, Import, Matrix, Source, is_identity, read_into};
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config, Mounting, rows_from_isometry};
use crate::valid::ValidConfig;
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Places of a sensor's file, seen from the directory; `{}` is the sensor.
const LAYOUTS: [&str; 3] = ["mav0/{}/sensor.yaml", "{}/sensor.yaml", "{}.yaml"];
const EXPECTED: &str = "mav0/cam0/sensor.yaml, cam0/sensor.yaml or cam0.yaml in it; for files of Kalibr (TUM-VI has them in dso/) \
                        use `plumbline config import --camchain --imu`, and give the result with --config";
const NEEDED: &str = "the sensor.yaml of an IMU, without which nothing can be flown";

/// Pose of a sensor in the body of its data set.
#[derive(Deserialize)]
struct Sensor {
    #[serde(rename = "T_BS")]
    pose: Option<Matrix<4>>,
}

#[derive(Deserialize)]
struct Imu {
    rate_hz: f64,
    gyroscope_noise_density: f64,
    gyroscope_random_walk: f64,
    accelerometer_noise_density: f64,
    accelerometer_random_walk: f64,
    /// No part of the format, but written into simulated data sets.
    imu_to_vehicle_deg: Option<Mounting>,
}

/// `base` with the calibration of a data set, see [`Source::Euroc`]: cameras and rates are replaced, the noise model and all
/// else are kept.
///
/// # Errors
/// When a file is missing, malformed, or its values are refused.
pub fn euroc_into(base: impl Into<Config>, directory: impl AsRef<Path>) -> Result<ValidConfig, ConfigError> {
    read_into(base, Source::Euroc(directory.as_ref())).map(|import| import.config)
}

/// `base` with the cameras of a data set of images alone: its IMU's file may be missing, and its IMU is then taken to
/// be its body.
///
/// # Errors
/// As [`euroc_into`].
pub fn euroc_cameras_into(
    base: impl Into<Config>,
    directory: impl AsRef<Path>,
) -> Result<ValidConfig, ConfigError> {
    let (directory, mut config) = (directory.as_ref(), base.into());
    let layout = layout_of(directory)?;
    let imu = file(directory, layout, "imu0");
    let pose_b_imu = if imu.is_file() { pose(&File::read(&imu)?)? } else { Isometry3::identity() };
    config.camera = cameras(directory, layout, &pose_b_imu)?;
    config.validated(&directory.display().to_string())
}

/// Pose of a sensor in the body of its data set (`T_BS`), by the sensor's file; `None` where that states none.
///
/// # Errors
/// When the file is missing or malformed, or the pose is none.
pub fn euroc_pose(sensor: impl AsRef<Path>) -> Result<Option<Isometry3<f64>>, ConfigError> {
    let file = File::read(sensor.as_ref())?;
    if file.has("T_BS") { pose(&file).map(Some) } else { Ok(None) }
}

pub(super) fn read(base: Config, directory: &Path) -> Result<Import, ConfigError> {
    let layout = layout_of(directory)?;
    let imu = file(directory, layout, "imu0");
    if !imu.exists() {
        return Err(super::no_calibration(&imu, NEEDED));
    }
    let imu = File::read(&imu)?;
    calibration(cameras(directory, layout, &pose(&imu)?)?, &imu)?
        .put_into(base, &directory.display().to_string())
}

pub(super) fn calibration(cameras: Vec<CameraConfig>, imu: &File) -> Result<Calibration, ConfigError> {
    let imu: Imu = imu.get()?;
    let noise = [
        imu.gyroscope_noise_density,
        imu.gyroscope_random_walk,
        imu.accelerometer_noise_density,
        imu.accelerometer_random_walk,
    ];
    let (imu_rate_hz, mounting) = (imu.rate_hz, imu.imu_to_vehicle_deg);
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s: None, mounting })
}

fn layout_of(directory: &Path) -> Result<&'static str, ConfigError> {
    let layout = LAYOUTS.into_iter().find(|layout| file(directory, layout, "cam0").is_file());
    layout.ok_or_else(|| super::no_calibration(directory, EXPECTED))
}

fn cameras(
    directory: &Path,
    layout: &str,
    pose_b_imu: &Isometry3<f64>,
) -> Result<Vec<CameraConfig>, ConfigError> {
    let paths = ["cam0", "cam1"].map(|sensor| file(directory, layout, sensor));
    // The second camera may be missing; one that is there but cannot be read is an error.
    let used = paths.iter().enumerate().filter(|(index, path)| *index == 0 || path.exists());
    used.map(|(_, path)| camera(&File::read(path)?, pose_b_imu)).collect()
}

fn file(directory: &Path, layout: &str, sensor: &str) -> PathBuf {
    directory.join(layout.replace("{}", sensor))
}

pub(super) fn pose(file: &File) -> Result<Isometry3<f64>, ConfigError> {
    let at = At { file, path: "" };
    at.rigid("T_BS", &file.get::<Sensor>()?.pose.ok_or_else(|| at.missing("T_BS"))?)
}

pub(super) fn camera(file: &File, pose_b_imu: &Isometry3<f64>) -> Result<CameraConfig, ConfigError> {
    let pose_b_s = pose(file)?;
    let camera: Camera = file.get()?;
    let at = At { file, path: "" };
    let rate_hz = camera.rate_hz.ok_or_else(|| at.missing("rate_hz"))?;
    let mut config = camera.config(&at, rate_hz, &pose_b_s)?;
    // The file's own digits are kept where nothing has to be computed.
    config.pose_b_c = match camera.pose_b_s {
        Some(Matrix(rows)) if is_identity(pose_b_imu) => rows,
        _ => rows_from_isometry(&(pose_b_imu.inverse() * pose_b_s)),
    };
    Ok(config)
}
