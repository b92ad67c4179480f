//! Importers: calibration files of EuRoC data sets (ASL `sensor.yaml`) and of Kalibr to a
//! [`ValidConfig`](crate::ValidConfig); the factory file of a ZED into the configuration of its rig ([`zed_into`]).
//!
//! Both take over the cameras, their extrinsics and the rate of the IMU. The plain importers [`euroc`] and
//! [`kalibr`] take the noise densities as the files say and the defaults for the rest. Those of a data
//! sheet hold for a sensor at rest and are too small in flight; [`euroc_into`] and [`kalibr_into`] keep
//! the noise model of a base configuration, such as the preset `euroc`, whose white noises are those of
//! the data sheet times 10 (gyroscope) and times 8 (accelerometer).
//!
//! Files are bounded in size before they are read; a file that cannot be used is refused with its name,
//! the key, and the cure.

mod euroc;
mod kalibr;
mod whose;
mod yaml;
mod zed;

pub use euroc::{euroc, euroc_cameras_into, euroc_into, euroc_mounting, euroc_pose};
pub use kalibr::{DEFAULT_CAMERA_RATE_HZ, kalibr, kalibr_into};
pub use zed::zed_into;

#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use euroc::from_texts as euroc_texts;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use kalibr::from_texts as kalibr_texts;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use zed::zed_text_into;

use crate::camera::Distortion;
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config, ImuConfig, Mounting, VehicleConfig, isometry_from_rows};
use crate::validate::pose_problem;
use nalgebra::{Isometry3, Vector3};
use yaml::Node;

/// What an importer reads off the files.
struct Calibration {
    cameras: Vec<CameraConfig>,
    imu_rate_hz: f64,
    /// Gyroscope noise and walk, accelerometer noise and walk, in the order and units of [`ImuConfig`].
    noise: [f64; 4],
    time_offset_s: Option<f64>,
    /// Mounting of the IMU in the vehicle, where the files state it.
    mounting: Option<Mounting>,
}

impl Calibration {
    /// A configuration with defaults for whatever the files do not say.
    fn into_config(self) -> Config {
        let [gyro_noise_density, gyro_bias_walk, accel_noise_density, accel_bias_walk] = self.noise;
        let imu = ImuConfig::with_noise(
            self.imu_rate_hz,
            (gyro_noise_density, gyro_bias_walk),
            (accel_noise_density, accel_bias_walk),
        );
        let base = Config::with_defaults(Vec::new(), imu);
        self.put_into(base)
    }

    /// `base` with its calibration replaced, its noise model kept. The mounting is that of the files, or that of the base
    /// where both are of the same rig; otherwise it is unknown.
    fn put_into(self, mut base: Config) -> Config {
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
        if let Some(time_offset_s) = self.time_offset_s {
            base.rig.time_offset_s = time_offset_s;
        }
        base
    }
}

/// `[fx, fy]` and `[cx, cy]` of a pinhole's `[fx, fy, cx, cy]`.
fn pinhole(camera: &Node<'_>) -> Result<([f64; 2], [f64; 2]), ConfigError> {
    if let Some(model) = camera.optional("camera_model")
        && model.text()? != "pinhole"
    {
        return Err(model.refuse("is no pinhole", "calibrate with the pinhole model"));
    }
    let [fx, fy, cx, cy] = camera.get("intrinsics")?.numbers()?;
    Ok(([fx, fy], [cx, cy]))
}

fn size_px(camera: &Node<'_>) -> Result<[usize; 2], ConfigError> {
    let node = camera.get("resolution")?;
    let size: [f64; 2] = node.numbers()?;
    if size.iter().any(|s| !(1.0..=65_535.0).contains(s) || s.fract() != 0.0) {
        return Err(node.refuse("is no image size", "give [width, height] in whole pixels"));
    }
    Ok(size.map(|s| s as usize))
}

/// The distortion of a camera, whichever way the format names the models.
fn distortion(camera: &Node<'_>, coefficients_key: &str) -> Result<Distortion, ConfigError> {
    let model = camera.get("distortion_model")?;
    let four = || camera.get(coefficients_key)?.numbers();
    match model.text()? {
        "radial-tangential" | "radtan" => {
            four().map(|[k1, k2, p1, p2]| Distortion::RadialTangential { k1, k2, p1, p2 })
        }
        "equidistant" => four().map(|[k1, k2, k3, k4]| Distortion::Equidistant { k1, k2, k3, k4 }),
        "none" => Ok(Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 }),
        _ => {
            Err(model.refuse("is no known model", "calibrate with radtan (radial-tangential) or equidistant"))
        }
    }
}

/// A rigid transform from a matrix that was checked to be one.
fn rigid(node: &Node<'_>, rows: [[f64; 4]; 4]) -> Result<Isometry3<f64>, ConfigError> {
    match pose_problem(&rows) {
        // The cure names the matrix as the file does.
        Some((reason, cure)) => Err(node.refuse(reason, cure.replace("T_BC", node.name()))),
        None => Ok(isometry_from_rows(&rows)),
    }
}

/// Whether two transforms agree to a centimetre and half a degree, as far as hand-written digits go.
fn agree(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let difference = a.inverse() * b;
    difference.translation.vector.norm() < 0.01 && difference.rotation.angle() < 0.01
}

fn is_identity(pose: &Isometry3<f64>) -> bool {
    pose.translation.vector == Vector3::zeros() && pose.rotation.angle() == 0.0
}
