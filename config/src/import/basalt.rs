//! Basalt: `calibration.json`, all of it under `value0`.
//!
//! `T_imu_cam` takes coordinates from the camera to the IMU, `T_BC`, as position and quaternion. Noise densities are of
//! continuous time. `cam_time_offset_ns` is added to the stamps of images, as [`RigConfig::time_offset_s`].
//!
//! Source: basalt-headers, `calibration.hpp` and `serialization/headers_serialization.h`.
//!
//! [`RigConfig::time_offset_s`]: crate::options::RigConfig::time_offset_s

use super::Calibration;
use super::file::{At, File, Values};
use super::lens::{Lens, camera_of};
use crate::error::ConfigError;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;

/// Largest difference of the length of a quaternion from 1.
const MAX_QUATERNION_ERROR: f64 = 1e-3;
/// Largest scale error and misalignment of an IMU that may be left in its samples: sensors that nobody calibrated have as much,
/// and the noise model of flight covers it.
const MAX_SCALE: f64 = 5e-3;

/// Models of Basalt, and ours.
const MODELS: [(&str, &str); 6] = [
    ("pinhole", "radial-tangential"),
    ("pinhole-radtan8", "rational"),
    ("kb4", "equidistant"),
    ("ds", "double-sphere"),
    ("eucm", "eucm"),
    ("ucm", "eucm"),
];

#[derive(Deserialize)]
struct Root {
    value0: Value,
}

#[derive(Deserialize)]
struct Value {
    #[serde(rename = "T_imu_cam")]
    poses: Vec<Values>,
    intrinsics: Vec<Model>,
    resolution: Vec<[usize; 2]>,
    gyro_noise_std: Density,
    gyro_bias_std: Density,
    accel_noise_std: Density,
    accel_bias_std: Density,
    #[serde(default)]
    cam_time_offset_ns: f64,
    imu_update_rate: f64,
    #[serde(default)]
    calib_accel_bias: Vec<f64>,
    #[serde(default)]
    calib_gyro_bias: Vec<f64>,
}

#[derive(Deserialize)]
struct Model {
    camera_type: String,
    intrinsics: Values,
}

/// A density of all three axes: one number, or one of each axis.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected one number or three")]
enum Density {
    One(f64),
    Axes([f64; 3]),
}

impl Density {
    fn largest(&self) -> f64 {
        match self {
            Self::One(density) => *density,
            Self::Axes(axes) => axes.iter().fold(0.0, |most, axis| if *axis > most { *axis } else { most }),
        }
    }
}

pub(super) fn convert(file: &File, camera_rate_hz: f64) -> Result<Calibration, ConfigError> {
    let (Root { value0: value }, at) = (file.get()?, At { file, path: "value0." });
    let counts = [value.intrinsics.len(), value.poses.len(), value.resolution.len()];
    if !matches!(counts, [1, 1, 1] | [2, 2, 2]) {
        let reason =
            format!("has {} cameras, T_imu_cam {} and resolution {}", counts[0], counts[1], counts[2]);
        return Err(at.refuse("intrinsics", reason, "keep one camera or a stereo pair in all three"));
    }
    check_imu(&at, "calib_accel_bias", &value.calib_accel_bias)?;
    check_imu(&at, "calib_gyro_bias", &value.calib_gyro_bias)?;
    let mut cameras = Vec::new();
    for (index, ((model, pose), size)) in
        value.intrinsics.iter().zip(&value.poses).zip(&value.resolution).enumerate()
    {
        let path = |table: &str| format!("value0.{table}[{index}].");
        let lens = lens_of(&At { file, path: &path("intrinsics") }, model)?;
        let pose = pose_of(&At { file, path: &path("T_imu_cam") }, pose)?;
        cameras.push(camera_of(*size, camera_rate_hz, lens, &pose));
    }
    let noise = [&value.gyro_noise_std, &value.gyro_bias_std, &value.accel_noise_std, &value.accel_bias_std];
    let noise = noise.map(Density::largest);
    let time_offset_s = Some(value.cam_time_offset_ns * 1e-9);
    Ok(Calibration { cameras, imu_rate_hz: value.imu_update_rate, noise, time_offset_s, mounting: None })
}

fn lens_of(at: &At<'_>, model: &Model) -> Result<Lens, ConfigError> {
    let of = |key| at.number(&model.intrinsics, key);
    let name = model.camera_type.as_str();
    let distortion = at.distortion("camera_type", name, &MODELS, |key| match (name, key) {
        ("pinhole", _) => Ok(0.0),
        // The unified model with the share `alpha` is the enhanced one on a sphere.
        ("ucm", "beta") => Ok(1.0),
        _ => of(key),
    })?;
    Ok(([of("fx")?, of("fy")?, of("cx")?, of("cy")?], distortion))
}

fn pose_of(at: &At<'_>, pose: &Values) -> Result<Isometry3<f64>, ConfigError> {
    let of = |key| at.number(pose, key);
    let quaternion = Quaternion::new(of("qw")?, of("qx")?, of("qy")?, of("qz")?);
    let norm = quaternion.norm();
    if norm.is_nan() || (norm - 1.0).abs() > MAX_QUATERNION_ERROR {
        let reason = format!("has a quaternion of length {norm}");
        return Err(at.refuse(
            "qw",
            reason,
            "copy qx, qy, qz, qw from the calibration with all their digits",
        ));
    }
    let translation = Translation3::new(of("px")?, of("py")?, of("pz")?);
    Ok(Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(quaternion)))
}

/// Refuses large scale errors and misalignments of the IMU, which follow the three biases and are not applied here.
fn check_imu(at: &At<'_>, key: &str, numbers: &[f64]) -> Result<(), ConfigError> {
    let large = numbers.iter().enumerate().skip(3).find(|(_, error)| error.abs() > MAX_SCALE);
    large.map_or(Ok(()), |(index, error)| {
        let cure = "scale errors and misalignments of the IMU are not applied here: correct the samples before and write 0 for all \
                    but the first three numbers";
        let reason = format!("is a scale error or misalignment of the IMU of {:.1} %", 100.0 * error);
        Err(at.refuse(&format!("{key}[{index}]"), reason, cure))
    })
}
