//! EuRoC data sets: one `sensor.yaml` a sensor, in the ASL format.
//!
//! `T_BS` takes coordinates from the sensor to the data set's body. Plumbline's body is the IMU: where the
//! IMU's own `T_BS` is not the identity, the cameras are moved by its inverse.

use super::yaml::{Document, Node};
use super::{Calibration, camera_of, is_identity, lens, rigid, size_px};
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config, Mounting, rows_from_isometry};
use crate::valid::ValidConfig;
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};

/// Where the file of a sensor may lie, seen from the directory; `{}` is the sensor.
const LAYOUTS: [&str; 3] = ["mav0/{}/sensor.yaml", "{}/sensor.yaml", "{}.yaml"];
/// Key of the IMU's file that states its mounting: no part of the format, but written into simulated data sets.
const MOUNTING_KEY: &str = "imu_to_vehicle_deg";
const EXPECTED: &str = "mav0/cam0/sensor.yaml, cam0/sensor.yaml or cam0.yaml in it; for files of Kalibr (TUM-VI has them in dso/) \
                        use `plumbline config import --camchain --imu`, and give the result with --config";

/// Calibration of a data set: a directory with `mav0` in it, the `mav0` itself, or one with `cam0.yaml`,
/// `imu0.yaml`. Noise densities are those of the file: see the [module](super) on their inflation.
///
/// # Errors
/// When a file is missing, malformed, or its values are refused.
pub fn euroc(directory: impl AsRef<Path>) -> Result<ValidConfig, ConfigError> {
    let directory = directory.as_ref();
    read(directory)?.into_config().validated(&directory.display().to_string())
}

/// `base` with the calibration of a data set: cameras and rates are replaced, the noise model and all
/// else are kept.
///
/// # Errors
/// As [`euroc`].
pub fn euroc_into(base: impl Into<Config>, directory: impl AsRef<Path>) -> Result<ValidConfig, ConfigError> {
    let directory = directory.as_ref();
    read(directory)?.put_into(base.into()).validated(&directory.display().to_string())
}

/// `base` with the cameras of a data set of images alone: its IMU's file may be missing, and its IMU is then taken to
/// be its body.
///
/// # Errors
/// As [`euroc`].
pub fn euroc_cameras_into(
    base: impl Into<Config>,
    directory: impl AsRef<Path>,
) -> Result<ValidConfig, ConfigError> {
    let (directory, mut config) = (directory.as_ref(), base.into());
    let layout = layout_of(directory)?;
    let imu = file(directory, layout, "imu0");
    let pose_b_imu = if imu.is_file() { pose(&Document::read(&imu)?.root())? } else { Isometry3::identity() };
    config.camera = cameras(directory, layout, &pose_b_imu)?;
    config.validated(&directory.display().to_string())
}

/// Mounting of the IMU in the vehicle that a data set states; real ones state none.
///
/// # Errors
/// When the file of the IMU is missing or malformed.
pub fn euroc_mounting(directory: impl AsRef<Path>) -> Result<Option<Mounting>, ConfigError> {
    let directory = directory.as_ref();
    let layout = layout_of(directory)?;
    mounting(&Document::read(&file(directory, layout, "imu0"))?.root())
}

/// Pose of a sensor in the body of its data set (`T_BS`), by the sensor's file; `None` where that states none.
///
/// # Errors
/// When the file is missing or malformed, or the pose is none.
pub fn euroc_pose(sensor: impl AsRef<Path>) -> Result<Option<Isometry3<f64>>, ConfigError> {
    let document = Document::read(sensor.as_ref())?;
    let root = document.root();
    root.optional("T_BS").map(|_| pose(&root)).transpose()
}

fn mounting(imu: &Node<'_>) -> Result<Option<Mounting>, ConfigError> {
    let Some(node) = imu.optional(MOUNTING_KEY) else { return Ok(None) };
    match node.text() {
        Ok(Mounting::UNKNOWN) => Ok(Some(Mounting::Unknown)),
        _ => Ok(Some(Mounting::Known(node.numbers()?))),
    }
}

fn read(directory: &Path) -> Result<Calibration, ConfigError> {
    let layout = layout_of(directory)?;
    let imu = Document::read(&file(directory, layout, "imu0"))?;
    let cameras = cameras(directory, layout, &pose(&imu.root())?)?;
    let (imu_rate_hz, noise) = inertial(&imu.root())?;
    let mounting = mounting(&imu.root())?;
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s: None, mounting })
}

fn layout_of(directory: &Path) -> Result<&'static str, ConfigError> {
    let layout = LAYOUTS.into_iter().find(|layout| file(directory, layout, "cam0").is_file());
    layout.ok_or_else(|| ConfigError::NoCalibration { directory: directory.to_owned(), expected: EXPECTED })
}

fn cameras(
    directory: &Path,
    layout: &str,
    pose_b_imu: &Isometry3<f64>,
) -> Result<Vec<CameraConfig>, ConfigError> {
    let mut cameras = Vec::new();
    for sensor in ["cam0", "cam1"] {
        let path = file(directory, layout, sensor);
        // The second camera may be missing; one that is there but cannot be read is an error.
        if sensor == "cam1" && !path.exists() {
            continue;
        }
        cameras.push(camera(&Document::read(&path)?.root(), pose_b_imu)?);
    }
    Ok(cameras)
}

fn file(directory: &Path, layout: &str, sensor: &str) -> PathBuf {
    directory.join(layout.replace("{}", sensor))
}

fn pose(sensor: &Node<'_>) -> Result<Isometry3<f64>, ConfigError> {
    let node = sensor.get("T_BS")?;
    rigid(&node, node.matrix()?)
}

fn camera(sensor: &Node<'_>, pose_b_imu: &Isometry3<f64>) -> Result<CameraConfig, ConfigError> {
    let pose_b_c = pose(sensor)?;
    // The file's own digits are kept where nothing has to be computed.
    let rows = if is_identity(pose_b_imu) {
        sensor.get("T_BS")?.matrix()?
    } else {
        rows_from_isometry(&(pose_b_imu.inverse() * pose_b_c))
    };
    let (size, rate_hz) = (size_px(sensor)?, sensor.get("rate_hz")?.number()?);
    let lens = lens::kalibr(sensor, "distortion_coefficients")?;
    Ok(CameraConfig { pose_b_c: rows, ..camera_of(lens, size, rate_hz, &pose_b_c) })
}

fn inertial(sensor: &Node<'_>) -> Result<(f64, [f64; 4]), ConfigError> {
    let number = |key| sensor.get(key)?.number();
    let noise = [
        number("gyroscope_noise_density")?,
        number("gyroscope_random_walk")?,
        number("accelerometer_noise_density")?,
        number("accelerometer_random_walk")?,
    ];
    Ok((number("rate_hz")?, noise))
}

/// Reads the texts as the files of a data set; for tests that never touch the disk.
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) fn from_texts(cam0: &str, imu0: &str) -> Result<ValidConfig, ConfigError> {
    let imu = Document::parse(imu0, "imu0")?;
    let cameras = vec![camera(&Document::parse(cam0, "cam0")?.root(), &pose(&imu.root())?)?];
    let (imu_rate_hz, noise) = inertial(&imu.root())?;
    let mounting = mounting(&imu.root())?;
    Calibration { cameras, imu_rate_hz, noise, time_offset_s: None, mounting }
        .into_config()
        .validated("texts")
}
