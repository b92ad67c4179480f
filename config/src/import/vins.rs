//! VINS-Fusion and VINS-Mono: a configuration in OpenCV's YAML that names camera files of camodocal beside it.
//!
//! `body_T_cam0` takes coordinates from the camera to the IMU, `T_BC`. `td` is added to the stamps of images, as
//! [`RigConfig::time_offset_s`]. The files tell no rate of the IMU or the cameras; their noise densities are tuned for the
//! estimator that they configure.
//!
//! Source: VINS-Fusion, `parameters.cpp`; camodocal, `camera_models`: `MEI` is our `omni`, `KANNALA_BRANDT` our `equidistant`
//! with `k2` to `k5` for `k1` to `k4`, `PINHOLE` our `radial-tangential`, `PINHOLE_FULL` our `rational`.
//!
//! [`RigConfig::time_offset_s`]: crate::options::RigConfig::time_offset_s

use super::lens::Lens;
use super::yaml::{Document, Node};
use super::{Calibration, camera_of, rigid, whole_size};
use crate::camera::Distortion;
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config};
use nalgebra::Isometry3;
use std::path::Path;

const MODELS: &str = "PINHOLE, PINHOLE_FULL, KANNALA_BRANDT, MEI";

/// `read` gives the file that a configuration names.
pub(super) fn convert(
    root: &Node<'_>,
    base: &Config,
    read: impl Fn(&Path) -> Result<Document, ConfigError>,
) -> Result<Calibration, ConfigError> {
    let rate_hz = base.camera.first().map_or(super::DEFAULT_CAMERA_RATE_HZ, |camera| camera.rate_hz);
    let mut cameras: Vec<CameraConfig> = Vec::new();
    for index in 0..count(root)? {
        let pose_b_c = pose(root, index)?;
        let name = format!("cam{index}_calib");
        let camera = match root.optional(&name) {
            Some(file) => {
                let document = read(Path::new(file.text()?))?;
                camera(&document.root(), rate_hz, &pose_b_c)?
            }
            // VINS-Mono states the camera in the same file.
            None if index == 0 && root.optional("model_type").is_some() => camera(root, rate_hz, &pose_b_c)?,
            None => return Err(root.child(&name).refuse("missing", "name the camera file of camodocal")),
        };
        cameras.push(camera);
    }
    let imu = &base.imu;
    let noise = [
        density(root, "gyr_n", imu.gyro_noise_density)?,
        density(root, "gyr_w", imu.gyro_bias_walk)?,
        density(root, "acc_n", imu.accel_noise_density)?,
        density(root, "acc_w", imu.accel_bias_walk)?,
    ];
    let time_offset_s = root.optional("td").map(|node| node.number()).transpose()?;
    Ok(Calibration { cameras, imu_rate_hz: imu.rate_hz, noise, time_offset_s, mounting: None })
}

fn count(root: &Node<'_>) -> Result<usize, ConfigError> {
    let Some(node) = root.optional("num_of_cam") else { return Ok(1) };
    match node.number()? {
        1.0 => Ok(1),
        2.0 => Ok(2),
        other => Err(node.refuse(format!("is {other}"), "one camera or a stereo pair is used")),
    }
}

fn density(root: &Node<'_>, key: &str, otherwise: f64) -> Result<f64, ConfigError> {
    root.optional(key).map_or(Ok(otherwise), |node| node.number())
}

/// `T_BC`: of VINS-Fusion as a matrix, of VINS-Mono as rotation and translation.
fn pose(root: &Node<'_>, index: usize) -> Result<Isometry3<f64>, ConfigError> {
    let name = format!("body_T_cam{index}");
    if let Some(node) = root.optional(&name) {
        return rigid(&node, node.matrix()?);
    }
    let Some(rotation) = root.optional("extrinsicRotation").filter(|_| index == 0) else {
        let cure = "add it: the pose of the camera in the axes of the IMU; where VINS estimated it, it is in \
                    extrinsic_parameter.csv of its output";
        return Err(root.child(&name).refuse("missing", cure));
    };
    let rows = rotation.matrix3()?;
    let translation = root.get("extrinsicTranslation")?;
    let [x, y, z]: [f64; 3] = translation.optional("data").unwrap_or(translation).numbers()?;
    let [[a, b, c], [d, e, f], [g, h, i]] = rows;
    rigid(&rotation, [[a, b, c, x], [d, e, f, y], [g, h, i, z], [0.0, 0.0, 0.0, 1.0]])
}

fn camera(root: &Node<'_>, rate_hz: f64, pose_b_c: &Isometry3<f64>) -> Result<CameraConfig, ConfigError> {
    let width = root.get("image_width")?;
    let size = whole_size(&width, [width.number()?, root.get("image_height")?.number()?])?;
    Ok(camera_of(lens(root)?, size, rate_hz, pose_b_c))
}

fn lens(root: &Node<'_>) -> Result<Lens, ConfigError> {
    let model = root.get("model_type")?;
    let number = |table: &str, key: &str| root.get(table)?.get(key)?.number();
    let projection = |key| number("projection_parameters", key);
    let distorted = |key| number("distortion_parameters", key);
    let of_pinhole = || Ok([projection("fx")?, projection("fy")?, projection("cx")?, projection("cy")?]);
    let lens = match model.text()? {
        "PINHOLE" => Lens::new(
            of_pinhole()?,
            Distortion::RadialTangential {
                k1: distorted("k1")?,
                k2: distorted("k2")?,
                p1: distorted("p1")?,
                p2: distorted("p2")?,
            },
        ),
        "PINHOLE_FULL" => Lens::new(
            of_pinhole()?,
            Distortion::Rational {
                k1: distorted("k1")?,
                k2: distorted("k2")?,
                p1: distorted("p1")?,
                p2: distorted("p2")?,
                k3: distorted("k3")?,
                k4: distorted("k4")?,
                k5: distorted("k5")?,
                k6: distorted("k6")?,
            },
        ),
        "KANNALA_BRANDT" => Lens::new(
            [projection("mu")?, projection("mv")?, projection("u0")?, projection("v0")?],
            Distortion::Equidistant {
                k1: projection("k2")?,
                k2: projection("k3")?,
                k3: projection("k4")?,
                k4: projection("k5")?,
            },
        ),
        "MEI" => Lens::new(
            [projection("gamma1")?, projection("gamma2")?, projection("u0")?, projection("v0")?],
            Distortion::Omni {
                xi: number("mirror_parameters", "xi")?,
                k1: distorted("k1")?,
                k2: distorted("k2")?,
                p1: distorted("p1")?,
                p2: distorted("p2")?,
            },
        ),
        _ => {
            return Err(model.refuse("is no known model", format!("calibrate with one of {MODELS}")));
        }
    };
    Ok(lens)
}
