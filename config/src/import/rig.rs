//! Calibrations of other programs, told by their keys.

use super::yaml::{Document, Node};
use super::{Calibration, DEFAULT_CAMERA_RATE_HZ, basalt, kalibr, orb_slam, vins, whose};
use crate::error::{ConfigError, Violation};
use crate::options::Config;
use crate::valid::ValidConfig;
use std::path::{Path, PathBuf};

/// Files in a folder of TUM-VI.
const TUM_VI: [&str; 2] = ["dso/camchain.yaml", "dso/imu_config.yaml"];
const EXPECTED: &str = "a calibration of Basalt (JSON), a configuration of VINS-Fusion, VINS-Mono or OpenVINS \
                        (estimator_config.yaml), settings of ORB-SLAM3, or a folder of TUM-VI (dso/camchain.yaml and \
                        dso/imu_config.yaml in it)";

/// Program that a calibration is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigFormat {
    /// Basalt's `calibration.json`.
    Basalt,
    /// A configuration of VINS-Fusion or VINS-Mono, with camera files of camodocal.
    Vins,
    /// Settings of ORB-SLAM3.
    OrbSlam3,
    /// `estimator_config.yaml` of OpenVINS, with files in Kalibr's form.
    OpenVins,
    /// A folder of TUM-VI, with files of Kalibr.
    TumVi,
}

/// A calibration that was read.
#[derive(Clone, Debug)]
pub struct RigImport {
    /// The base with cameras, rates and time offset replaced, and its own noise model.
    pub config: ValidConfig,
    /// Noise densities of the files, or of the base where they tell none: gyroscope noise and walk, accelerometer noise and
    /// walk, in the units of [`ImuConfig`](crate::options::ImuConfig).
    pub noise: [f64; 4],
    /// Program that it is of.
    pub format: RigFormat,
}

/// `base` with the calibration of another program: cameras, and what the files tell of rates and time offset, are replaced;
/// the noise model and all else are kept.
///
/// # Errors
/// When a file is missing, malformed, of none of these programs, or its values are refused.
pub fn rig_into(base: impl Into<Config>, path: impl AsRef<Path>) -> Result<RigImport, ConfigError> {
    let (base, path) = (base.into(), path.as_ref());
    if path.is_dir() {
        let files = TUM_VI.map(|name| path.join(name));
        if !files[0].is_file() {
            return Err(ConfigError::NoCalibration { directory: path.to_owned(), expected: EXPECTED });
        }
        return of_kalibr(base, &files[0], &files[1], RigFormat::TumVi);
    }
    let document = whose::read(path, EXPECTED)?;
    let beside = |name: &Path| path.parent().unwrap_or(Path::new("")).join(name);
    if let Some(files) = files_of_openvins(&document.root())? {
        let [chain, imu] = files.map(|name| beside(&name));
        return of_kalibr(base, &chain, &imu, RigFormat::OpenVins);
    }
    convert(base, &document, |name| Document::read(&beside(name)))
}

fn convert(
    base: Config,
    document: &Document,
    read: impl Fn(&Path) -> Result<Document, ConfigError>,
) -> Result<RigImport, ConfigError> {
    let root = document.root();
    let rate_hz = base.camera.first().map_or(DEFAULT_CAMERA_RATE_HZ, |camera| camera.rate_hz);
    let (calibration, format) = match format_of(&root) {
        Some(RigFormat::Basalt) => (basalt::convert(&root, rate_hz)?, RigFormat::Basalt),
        Some(RigFormat::OrbSlam3) => (orb_slam::convert(&root)?, RigFormat::OrbSlam3),
        Some(RigFormat::Vins) => (vins::convert(&root, &base, read)?, RigFormat::Vins),
        _ => return Err(unknown(document)),
    };
    put(calibration, base, document.origin(), format)
}

fn put(
    calibration: Calibration,
    base: Config,
    origin: &str,
    format: RigFormat,
) -> Result<RigImport, ConfigError> {
    let noise = calibration.noise;
    Ok(RigImport { config: calibration.put_into(base).validated(origin)?, noise, format })
}

fn of_kalibr(base: Config, chain: &Path, imu: &Path, format: RigFormat) -> Result<RigImport, ConfigError> {
    let rate_hz = base.camera.first().map_or(DEFAULT_CAMERA_RATE_HZ, |camera| camera.rate_hz);
    let calibration = kalibr::read(chain, imu, rate_hz)?;
    put(calibration, base, &chain.display().to_string(), format)
}

fn format_of(root: &Node<'_>) -> Option<RigFormat> {
    let keys = root.keys();
    let has = |key: &str| keys.contains(&key);
    if has("value0") {
        Some(RigFormat::Basalt)
    } else if has("cam0_calib") || has("body_T_cam0") || has("extrinsicRotation") {
        Some(RigFormat::Vins)
    } else if has("Camera.type") {
        Some(RigFormat::OrbSlam3)
    } else {
        None
    }
}

/// Cameras and IMU that a configuration of OpenVINS names.
fn files_of_openvins(root: &Node<'_>) -> Result<Option<[PathBuf; 2]>, ConfigError> {
    if root.optional("relative_config_imu").is_none() {
        return Ok(None);
    }
    let name = |key| Ok::<_, ConfigError>(PathBuf::from(root.get(key)?.text()?));
    Ok(Some([name("relative_config_imucam")?, name("relative_config_imu")?]))
}

fn unknown(document: &Document) -> ConfigError {
    let root = document.root();
    let cure = if root.optional("cam0").is_some() || root.optional("imu0").is_some() {
        "these are Kalibr's keys: give its two files with --camchain and --imu".to_owned()
    } else if root.optional("model_type").is_some() {
        "this is a camera file of camodocal: give the configuration of VINS-Fusion that names it".to_owned()
    } else if root.optional("T_BS").is_some() {
        "this is a sensor.yaml of a data set: give its folder with --euroc".to_owned()
    } else {
        format!("give {EXPECTED}")
    };
    let keys = root.keys();
    let reason = match keys.len() {
        0 => "has no keys".to_owned(),
        _ => format!(
            "is no calibration that is known here (its first keys: {})",
            keys[..keys.len().min(3)].join(", ")
        ),
    };
    ConfigError::one(document.origin(), Violation::new("(file)", reason, cure))
}

/// Reads a text into the preset `euroc`; every file that it names is `camera`. For tests that never touch the disk.
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) fn from_text(base: Config, text: &str, camera: &str) -> Result<RigImport, ConfigError> {
    let document = whose::parse(text, "rig.yaml", EXPECTED)?;
    convert(base, &document, |name| Document::parse(camera, &name.display().to_string()))
}
