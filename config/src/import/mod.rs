//! Importers: calibration files of EuRoC data sets (ASL `sensor.yaml`), of Kalibr, and of Basalt, VINS-Fusion, ORB-SLAM3,
//! OpenVINS and TUM-VI into a configuration ([`read_into`]); the factory file of a ZED into the configuration of its rig
//! ([`zed_into`]).
//!
//! All take over the cameras, their extrinsics, and the rate of the IMU and the time offset where the files state them. The noise
//! model of the base is kept, such as that of the preset `euroc`, whose white noises are those of the data sheet times 10
//! (gyroscope) and times 8 (accelerometer): the densities of a data sheet hold for a sensor at rest and are too small in flight.
//! Those of the files are [`Import::noise`].
//!
//! Files are bounded in size before they are read; a file that cannot be used is refused with its name,
//! the key, and the cure.

mod basalt;
mod euroc;
mod file;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) mod fuzzing;
mod kalibr;
mod lens;
mod orb_slam;
mod rig;
mod vins;
pub(crate) mod zed;

pub use euroc::{euroc_cameras_into, euroc_into, euroc_pose};
pub use zed::zed_into;

use crate::camera::Distortion;
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config, Mounting, VehicleConfig};
use crate::valid::ValidConfig;
use crate::validate::pose_problem;
use nalgebra::{Isometry3, Vector3};
use serde::Deserialize;
use std::path::Path;

/// Camera rate where neither the files nor a base state it.
pub const DEFAULT_CAMERA_RATE_HZ: f64 = 20.0;

/// Files of a calibration.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    /// A data set: a directory with `mav0` in it, the `mav0` itself, or one with `cam0.yaml` and `imu0.yaml`.
    Euroc(&'a Path),
    /// The results of `kalibr_calibrate_imu_camera` and the noise file of the IMU (its input, or the `imu-*.yaml` of its results).
    Kalibr {
        /// `camchain-imucam.yaml`.
        camchain: &'a Path,
        /// `imu.yaml`.
        imu: &'a Path,
    },
    /// A file of Basalt, VINS-Fusion, VINS-Mono, ORB-SLAM3 or OpenVINS, or a folder of TUM-VI.
    Rig(&'a Path),
}

/// A calibration that was read.
#[derive(Clone, Debug)]
pub struct Import {
    /// The base with cameras, rates and time offset replaced, and its own noise model.
    pub config: ValidConfig,
    /// Noise densities of the files, or of the base where they state none: gyroscope noise and walk, accelerometer noise and
    /// walk, in the units of [`ImuConfig`](crate::options::ImuConfig).
    pub noise: [f64; 4],
    /// Mounting of the IMU in the vehicle, where the files state it.
    pub mounting: Option<Mounting>,
}

/// `base` with the calibration of the files: cameras, and the rates and time offset that they state, are replaced; the noise
/// model and all else are kept.
///
/// # Errors
/// When a file is missing, malformed, of none of these programs, or its values are refused.
pub fn read_into(base: impl Into<Config>, source: Source<'_>) -> Result<Import, ConfigError> {
    let base = base.into();
    match source {
        Source::Euroc(directory) => euroc::read(base, directory),
        Source::Kalibr { camchain, imu } => kalibr::read(base, camchain, imu),
        Source::Rig(path) => rig::read(base, path),
    }
}

/// Facts that an importer reads off the files.
struct Calibration {
    cameras: Vec<CameraConfig>,
    imu_rate_hz: f64,
    noise: [f64; 4],
    time_offset_s: Option<f64>,
    mounting: Option<Mounting>,
}

impl Calibration {
    /// `base` with its calibration replaced. The mounting is that of the files, or that of the base where both are of the same
    /// rig; otherwise it is unknown.
    fn put_into(self, mut base: Config, origin: &str) -> Result<Import, ConfigError> {
        let is_same_rig = match (base.camera.first(), self.cameras.first()) {
            (Some(before), Some(now)) => agree(&before.pose_b_c(), &now.pose_b_c()),
            _ => false,
        };
        base.vehicle = match self.mounting {
            Some(imu_to_vehicle_deg) => VehicleConfig { imu_to_vehicle_deg },
            None if is_same_rig => base.vehicle,
            None => VehicleConfig::default(),
        };
        base.camera = self.cameras;
        base.imu.rate_hz = self.imu_rate_hz;
        base.rig.time_offset_s = self.time_offset_s.unwrap_or(base.rig.time_offset_s);
        Ok(Import { config: base.validated(origin)?, noise: self.noise, mounting: self.mounting })
    }
}

fn rate_of(base: &Config) -> f64 {
    base.camera.first().map_or(DEFAULT_CAMERA_RATE_HZ, |camera| camera.rate_hz)
}

/// Square matrix.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Numbers")]
struct Matrix<const N: usize>([[f64; N]; N]);

/// Numbers in rows (Kalibr), in one list, or in OpenCV's `{rows, cols, data}` (EuRoC).
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected rows of finite numbers")]
enum Numbers {
    List(Vec<f64>),
    Rows(Vec<Vec<f64>>),
    OpenCv { data: Vec<f64> },
}

impl<const N: usize> TryFrom<Numbers> for Matrix<N> {
    type Error = String;

    fn try_from(numbers: Numbers) -> Result<Self, String> {
        let flat = match numbers {
            Numbers::Rows(rows) if rows.len() != N || rows.iter().any(|row| row.len() != N) => {
                let lengths: Vec<String> = rows.iter().map(|row| row.len().to_string()).collect();
                let lengths = lengths.join(", ");
                return Err(format!(
                    "has rows of {lengths} numbers, {N} rows of {N} expected; is the file cut off? copy it again"
                ));
            }
            Numbers::Rows(rows) => rows.concat(),
            Numbers::List(flat) | Numbers::OpenCv { data: flat } => flat,
        };
        if flat.len() != N * N {
            return Err(format!("has {} numbers; give exactly {}", flat.len(), N * N));
        }
        Ok(Self(std::array::from_fn(|i| std::array::from_fn(|j| flat[N * i + j]))))
    }
}

/// True if two transforms agree to a centimetre and half a degree, as far as hand-written digits go.
fn agree(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let difference = a.inverse() * b;
    difference.translation.vector.norm() < 0.01 && difference.rotation.angle() < 0.01
}

fn is_identity(pose: &Isometry3<f64>) -> bool {
    pose.translation.vector == Vector3::zeros() && pose.rotation.angle() == 0.0
}

/// Error of a path without any of the files that are understood.
fn no_calibration(path: &Path, expected: &str) -> ConfigError {
    ConfigError::unusable(path.display(), format!("no calibration found; expected {expected}"))
}

/// Distortion of the model `name`, each coefficient by `of`; `None` for a name that is no model's. The rational model without
/// coefficients of its own is the radial and tangential one.
fn distortion<E>(
    name: &str,
    of: impl FnMut(&'static str) -> Result<f64, E>,
) -> Result<Option<Distortion>, E> {
    Ok(Distortion::read(name, of)?.map(|distortion| match distortion {
        Distortion::Rational { k1, k2, p1, p2, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 } => {
            Distortion::RadialTangential { k1, k2, p1, p2 }
        }
        distortion => distortion,
    }))
}
