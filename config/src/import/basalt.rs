//! Basalt: `calibration.json`, all of it under `value0`.
//!
//! `T_imu_cam` takes coordinates from the camera to the IMU, `T_BC`, as position and quaternion. Noise densities are of
//! continuous time. `cam_time_offset_ns` is added to the stamps of images, as [`RigConfig::time_offset_s`].
//!
//! Source: basalt-headers, `calibration.hpp` and `serialization/headers_serialization.h`.
//!
//! [`RigConfig::time_offset_s`]: crate::options::RigConfig::time_offset_s

use super::lens::{Lens, STRAIGHT};
use super::yaml::Node;
use super::{Calibration, camera_of, whole_size};
use crate::camera::Distortion;
use crate::error::ConfigError;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// Largest difference of the length of a quaternion from 1.
const MAX_QUATERNION_ERROR: f64 = 1e-3;
/// Largest scale error and misalignment of an IMU that may be left in its samples: sensors that nobody calibrated have as much,
/// and the noise model of flight covers it.
const MAX_SCALE: f64 = 5e-3;
const MODELS: &str = "pinhole, pinhole-radtan8, kb4, ds, eucm, ucm";

pub(super) fn convert(root: &Node<'_>, camera_rate_hz: f64) -> Result<Calibration, ConfigError> {
    let value = root.get("value0")?;
    let (poses, lenses) = (value.get("T_imu_cam")?, value.get("intrinsics")?);
    let (poses, lenses, sizes) =
        (poses.elements()?, lenses.elements()?, value.get("resolution")?.elements()?);
    let count = lenses.len();
    if poses.len() != count || sizes.len() != count || !(1..=2).contains(&count) {
        let reason = format!("has {count} cameras, T_imu_cam {} and resolution {}", poses.len(), sizes.len());
        return Err(value.get("intrinsics")?.refuse(reason, "keep one camera or a stereo pair in all three"));
    }
    check_imu(&value)?;
    let camera = |((lens, pose), size): ((&Node<'_>, &Node<'_>), &Node<'_>)| {
        let size = whole_size(size, size.numbers()?)?;
        Ok(camera_of(lens_of(lens)?, size, camera_rate_hz, &pose_of(pose)?))
    };
    let cameras = lenses.iter().zip(&poses).zip(&sizes).map(camera).collect::<Result<_, _>>()?;
    let noise = [
        density(&value, "gyro_noise_std")?,
        density(&value, "gyro_bias_std")?,
        density(&value, "accel_noise_std")?,
        density(&value, "accel_bias_std")?,
    ];
    let offset_ns = value.optional("cam_time_offset_ns").map_or(Ok(0.0), |node| node.number())?;
    let imu_rate_hz = value.get("imu_update_rate")?.number()?;
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s: Some(offset_ns * 1e-9), mounting: None })
}

fn lens_of(camera: &Node<'_>) -> Result<Lens, ConfigError> {
    let (model, values) = (camera.get("camera_type")?, camera.get("intrinsics")?);
    let of = |key| values.get(key)?.number();
    let distortion = match model.text()? {
        "pinhole" => STRAIGHT,
        "kb4" => Distortion::Equidistant { k1: of("k1")?, k2: of("k2")?, k3: of("k3")?, k4: of("k4")? },
        "ds" => Distortion::DoubleSphere { xi: of("xi")?, alpha: of("alpha")? },
        "eucm" => Distortion::Eucm { alpha: of("alpha")?, beta: of("beta")? },
        // The unified model with the share `alpha` is the enhanced one on a sphere.
        "ucm" => Distortion::Eucm { alpha: of("alpha")?, beta: 1.0 },
        "pinhole-radtan8" => Distortion::Rational {
            k1: of("k1")?,
            k2: of("k2")?,
            p1: of("p1")?,
            p2: of("p2")?,
            k3: of("k3")?,
            k4: of("k4")?,
            k5: of("k5")?,
            k6: of("k6")?,
        },
        _ => {
            return Err(model.refuse("is no known model", format!("calibrate with one of {MODELS}")));
        }
    };
    Ok(Lens::new([of("fx")?, of("fy")?, of("cx")?, of("cy")?], distortion))
}

fn pose_of(node: &Node<'_>) -> Result<Isometry3<f64>, ConfigError> {
    let of = |key| node.get(key)?.number();
    let quaternion = Quaternion::new(of("qw")?, of("qx")?, of("qy")?, of("qz")?);
    let norm = quaternion.norm();
    if norm.is_nan() || (norm - 1.0).abs() > MAX_QUATERNION_ERROR {
        let reason = format!("has a quaternion of length {norm}");
        return Err(node.refuse(reason, "copy qx, qy, qz, qw from the calibration with all their digits"));
    }
    let translation = Translation3::new(of("px")?, of("py")?, of("pz")?);
    Ok(Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(quaternion)))
}

/// A density of all three axes: one number, or three of which the largest is taken.
fn density(value: &Node<'_>, key: &str) -> Result<f64, ConfigError> {
    let node = value.get(key)?;
    let density = match node.number() {
        Ok(number) => number,
        Err(_) => {
            let axes: [f64; 3] = node.numbers()?;
            axes.into_iter().fold(0.0, |most, axis| if axis > most { axis } else { most })
        }
    };
    if density > 0.0 {
        return Ok(density);
    }
    Err(node
        .refuse(format!("is {density}"), "give the value of the data sheet or of an Allan plot; none is 0"))
}

/// Refuses large scale errors and misalignments of the IMU, which follow the three biases and are not applied here.
fn check_imu(value: &Node<'_>) -> Result<(), ConfigError> {
    for key in ["calib_accel_bias", "calib_gyro_bias"] {
        let Some(node) = value.optional(key) else { continue };
        for element in node.elements()?.into_iter().skip(3) {
            let error = element.number()?;
            if error.abs() > MAX_SCALE {
                let cure = "scale errors and misalignments of the IMU are not applied here: correct the samples before and \
                            write 0 for all but the first three numbers";
                let reason = format!("is a scale error or misalignment of the IMU of {:.1} %", 100.0 * error);
                return Err(element.refuse(reason, cure));
            }
        }
    }
    Ok(())
}
