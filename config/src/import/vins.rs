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

use super::file::{At, File, Values};
use super::lens::Lens;
use super::{Calibration, Matrix, Numbers, camera_of, rate_of};
use crate::camera::Distortion;
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config};
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::Path;

#[derive(Deserialize)]
struct Vins {
    num_of_cam: Option<f64>,
    cam0_calib: Option<String>,
    cam1_calib: Option<String>,
    #[serde(rename = "body_T_cam0")]
    pose_b_c0: Option<Matrix<4>>,
    #[serde(rename = "body_T_cam1")]
    pose_b_c1: Option<Matrix<4>>,
    #[serde(rename = "extrinsicRotation")]
    rotation: Option<Matrix<3>>,
    #[serde(rename = "extrinsicTranslation")]
    translation: Option<Numbers>,
    gyr_n: Option<f64>,
    gyr_w: Option<f64>,
    acc_n: Option<f64>,
    acc_w: Option<f64>,
    td: Option<f64>,
}

/// A camera file of camodocal.
#[derive(Deserialize)]
struct Camodocal {
    model_type: String,
    image_width: f64,
    image_height: f64,
    projection_parameters: Values,
    #[serde(default)]
    distortion_parameters: Values,
    #[serde(default)]
    mirror_parameters: Values,
}

/// `read` gives the file that a configuration names.
pub(super) fn convert(
    file: &File,
    base: &Config,
    read: impl Fn(&Path) -> Result<File, ConfigError>,
) -> Result<Calibration, ConfigError> {
    let (vins, rate_hz): (Vins, f64) = (file.get()?, rate_of(base));
    let count = vins.num_of_cam.unwrap_or(1.0);
    if count != 1.0 && count != 2.0 {
        return Err(file.refuse("num_of_cam", format!("is {count}"), "one camera or a stereo pair is used"));
    }
    let mut cameras = Vec::new();
    for (index, name) in [&vins.cam0_calib, &vins.cam1_calib].into_iter().enumerate().take(count as usize) {
        let pose_b_c = pose(&At { file, path: "" }, &vins, index)?;
        cameras.push(match name {
            Some(name) => camera(&read(Path::new(name))?, rate_hz, &pose_b_c)?,
            // VINS-Mono states the camera in the same file.
            None if index == 0 && file.has("model_type") => camera(file, rate_hz, &pose_b_c)?,
            None => {
                let cure = "name the camera file of camodocal";
                return Err(file.refuse(&format!("cam{index}_calib"), "missing", cure));
            }
        });
    }
    let imu = &base.imu;
    let noise = [
        vins.gyr_n.unwrap_or(imu.gyro_noise_density),
        vins.gyr_w.unwrap_or(imu.gyro_bias_walk),
        vins.acc_n.unwrap_or(imu.accel_noise_density),
        vins.acc_w.unwrap_or(imu.accel_bias_walk),
    ];
    let (imu_rate_hz, time_offset_s) = (imu.rate_hz, vins.td);
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s, mounting: None })
}

/// `T_BC`: of VINS-Fusion as a matrix, of VINS-Mono as rotation and translation.
fn pose(at: &At<'_>, vins: &Vins, index: usize) -> Result<Isometry3<f64>, ConfigError> {
    let name = format!("body_T_cam{index}");
    if let Some(rows) = [&vins.pose_b_c0, &vins.pose_b_c1][index] {
        return at.rigid(&name, rows);
    }
    match (&vins.rotation, &vins.translation) {
        (Some(Matrix(r)), Some(Numbers::List(t) | Numbers::OpenCv { data: t }))
            if index == 0 && t.len() == 3 =>
        {
            let row = |i: usize| [r[i][0], r[i][1], r[i][2], t[i]];
            at.rigid("extrinsicRotation", &Matrix([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]))
        }
        _ => {
            let cure = "add it: the pose of the camera in the axes of the IMU; where VINS estimated it, it is in \
                        extrinsic_parameter.csv of its output";
            Err(at.refuse(&name, "missing", cure))
        }
    }
}

fn camera(file: &File, rate_hz: f64, pose_b_c: &Isometry3<f64>) -> Result<CameraConfig, ConfigError> {
    let (at, camera): (_, Camodocal) = (At { file, path: "" }, file.get()?);
    let size = at.whole_size("image_width", [camera.image_width, camera.image_height])?;
    let table = |path| At { file, path };
    let p = |key| table("projection_parameters.").number(&camera.projection_parameters, key);
    let d = |key| table("distortion_parameters.").number(&camera.distortion_parameters, key);
    let lens = match camera.model_type.as_str() {
        "PINHOLE" | "PINHOLE_FULL" => {
            let (k1, k2, p1, p2) = (d("k1")?, d("k2")?, d("p1")?, d("p2")?);
            let distortion = match camera.model_type.as_str() {
                "PINHOLE" => Distortion::RadialTangential { k1, k2, p1, p2 },
                _ => {
                    let (k3, k4, k5, k6) = (d("k3")?, d("k4")?, d("k5")?, d("k6")?);
                    Distortion::Rational { k1, k2, p1, p2, k3, k4, k5, k6 }
                }
            };
            Lens::new([p("fx")?, p("fy")?, p("cx")?, p("cy")?], distortion)
        }
        "KANNALA_BRANDT" => Lens::new(
            [p("mu")?, p("mv")?, p("u0")?, p("v0")?],
            Distortion::Equidistant { k1: p("k2")?, k2: p("k3")?, k3: p("k4")?, k4: p("k5")? },
        ),
        "MEI" => {
            let xi = table("mirror_parameters.").number(&camera.mirror_parameters, "xi")?;
            Lens::new(
                [p("gamma1")?, p("gamma2")?, p("u0")?, p("v0")?],
                Distortion::Omni { xi, k1: d("k1")?, k2: d("k2")?, p1: d("p1")?, p2: d("p2")? },
            )
        }
        _ => {
            let cure = "calibrate with one of PINHOLE, PINHOLE_FULL, KANNALA_BRANDT, MEI";
            return Err(at.refuse("model_type", "is no known model", cure));
        }
    };
    Ok(camera_of(lens, size, rate_hz, pose_b_c))
}
