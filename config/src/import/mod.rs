//! Importers: calibration files of EuRoC data sets (ASL `sensor.yaml`) and of Kalibr to a
//! [`ValidConfig`](crate::ValidConfig); those of Basalt, VINS-Fusion, ORB-SLAM3, OpenVINS and TUM-VI into a configuration
//! ([`rig_into`]); the factory file of a ZED into the configuration of its rig ([`zed_into`]).
//!
//! All take over the cameras, their extrinsics and the rate of the IMU. The plain importers [`euroc`] and
//! [`kalibr`] take the noise densities as the files say and the defaults for the rest. Those of a data
//! sheet hold for a sensor at rest and are too small in flight; [`euroc_into`] and [`kalibr_into`] keep
//! the noise model of a base configuration, such as the preset `euroc`, whose white noises are those of
//! the data sheet times 10 (gyroscope) and times 8 (accelerometer).
//!
//! Files are bounded in size before they are read; a file that cannot be used is refused with its name,
//! the key, and the cure.

mod basalt;
mod euroc;
mod kalibr;
mod lens;
mod orb_slam;
mod rig;
mod vins;
mod whose;
mod yaml;
mod zed;

pub use euroc::{euroc, euroc_cameras_into, euroc_into, euroc_mounting, euroc_pose};
pub use kalibr::{DEFAULT_CAMERA_RATE_HZ, kalibr, kalibr_into};
pub use rig::{RigFormat, RigImport, rig_into};
pub use zed::zed_into;

#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use euroc::from_texts as euroc_texts;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use kalibr::from_texts as kalibr_texts;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use rig::from_text as rig_text;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use zed::zed_text_into;

use crate::error::ConfigError;
use crate::options::{
    CameraConfig, Config, ImuConfig, Mounting, VehicleConfig, isometry_from_rows, rows_from_isometry,
};
use crate::validate::pose_problem;
use lens::Lens;
use nalgebra::{Isometry3, Vector3};
use yaml::Node;

/// Facts that an importer reads off the files.
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

fn size_px(camera: &Node<'_>) -> Result<[usize; 2], ConfigError> {
    let node = camera.get("resolution")?;
    whole_size(&node, node.numbers()?)
}

/// Image size of two numbers that `node` gives.
fn whole_size(node: &Node<'_>, size: [f64; 2]) -> Result<[usize; 2], ConfigError> {
    if size.iter().any(|s| !(1.0..=65_535.0).contains(s) || s.fract() != 0.0) {
        return Err(node.refuse("is no image size", "give width and height in whole pixels"));
    }
    Ok(size.map(|s| s as usize))
}

/// A camera of a file: its lens, image size and pose.
fn camera_of(
    lens: Lens,
    [width_px, height_px]: [usize; 2],
    rate_hz: f64,
    pose_b_c: &Isometry3<f64>,
) -> CameraConfig {
    CameraConfig {
        width_px,
        height_px,
        rate_hz,
        readout_s: 0.0,
        exposure_s: 0.0,
        mask: None,
        focal_px: lens.focal_px,
        centre_px: lens.centre_px,
        distortion: lens.distortion,
        pose_b_c: rows_from_isometry(pose_b_c),
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

/// True if two transforms agree to a centimetre and half a degree, as far as hand-written digits go.
fn agree(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let difference = a.inverse() * b;
    difference.translation.vector.norm() < 0.01 && difference.rotation.angle() < 0.01
}

fn is_identity(pose: &Isometry3<f64>) -> bool {
    pose.translation.vector == Vector3::zeros() && pose.rotation.angle() == 0.0
}
