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
use super::lens::camera_of;
use super::{Calibration, Matrix, Numbers, rate_of};
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config};
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::Path;

/// Models of camodocal, and ours.
const MODELS: [(&str, &str); 4] = [
    ("PINHOLE", "radial-tangential"),
    ("PINHOLE_FULL", "rational"),
    ("KANNALA_BRANDT", "equidistant"),
    ("MEI", "omni"),
];

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
    image_width: usize,
    image_height: usize,
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
    let of = |path, values, key| At { file, path }.number(values, key);
    let p = |key| of("projection_parameters.", &camera.projection_parameters, key);
    let model = camera.model_type.as_str();
    let distortion = at.distortion("model_type", model, &MODELS, |key| match (model, key) {
        ("KANNALA_BRANDT", "k1") => p("k2"),
        ("KANNALA_BRANDT", "k2") => p("k3"),
        ("KANNALA_BRANDT", "k3") => p("k4"),
        ("KANNALA_BRANDT", _) => p("k5"),
        (_, "xi") => of("mirror_parameters.", &camera.mirror_parameters, key),
        _ => of("distortion_parameters.", &camera.distortion_parameters, key),
    })?;
    let names = match model {
        "KANNALA_BRANDT" => ["mu", "mv", "u0", "v0"],
        "MEI" => ["gamma1", "gamma2", "u0", "v0"],
        _ => ["fx", "fy", "cx", "cy"],
    };
    let [fx, fy, cx, cy] = names.map(p);
    let size = [camera.image_width, camera.image_height];
    Ok(camera_of(size, rate_hz, ([fx?, fy?, cx?, cy?], distortion), pose_b_c))
}
