//! ORB-SLAM3: settings in OpenCV's YAML with flat keys (`File.version: "1.0"`).
//!
//! `IMU.T_b_c1` takes coordinates from the left camera to the IMU, `T_BC`; `Stereo.T_c1_c2` from the right camera to the left
//! one. Rectified cameras have the same intrinsics, and lie `Stereo.b` apart.
//!
//! Source: ORB-SLAM3, `Settings.cc`.

use super::file::{At, File, Values};
use super::lens::{Lens, camera_of};
use super::{Calibration, Matrix};
use crate::error::ConfigError;
use nalgebra::Isometry3;
use serde::Deserialize;

/// Models of ORB-SLAM3, and ours.
const MODELS: [(&str, &str); 3] =
    [("PinHole", "rational"), ("KannalaBrandt8", "equidistant"), ("Rectified", "radial-tangential")];

#[derive(Deserialize)]
struct Settings {
    #[serde(rename = "Camera.type")]
    model: String,
    #[serde(rename = "Camera.width")]
    width: usize,
    #[serde(rename = "Camera.height")]
    height: usize,
    #[serde(rename = "IMU.T_b_c1")]
    pose_b_c1: Option<Matrix<4>>,
    #[serde(rename = "Stereo.T_c1_c2")]
    pose_c1_c2: Option<Matrix<4>>,
}

pub(super) fn convert(file: &File) -> Result<Calibration, ConfigError> {
    let at = At { file, path: "" };
    if !file.has("Camera1.fx") {
        let cure = "write the file in the form of ORB-SLAM3 1.0 (File.version: \"1.0\", Camera1.fx, IMU.T_b_c1), as in its Examples";
        return Err(at.refuse("Camera1.fx", "missing", cure));
    }
    let (settings, values): (Settings, Values) = (file.get()?, file.get()?);
    let of = |key| at.number(&values, key);
    let (size, rate_hz) = ([settings.width, settings.height], of("Camera.fps")?);
    let Some(rows) = &settings.pose_b_c1 else {
        let cure = "give settings of an inertial example: the pose of the left camera in the axes of the IMU is needed";
        return Err(at.refuse("IMU.T_b_c1", "missing", cure));
    };
    let pose_b_c1 = at.rigid("IMU.T_b_c1", rows)?;
    // Pose of the right camera in the axes of the left one; none for a single camera.
    let pose_c1_c2 = match &settings.pose_c1_c2 {
        Some(rows) => Some(at.rigid("Stereo.T_c1_c2", rows)?),
        None if file.has("Stereo.b") => Some(Isometry3::translation(of("Stereo.b")?, 0.0, 0.0)),
        None => None,
    };
    let lens = |camera| lens(&at, &values, &settings.model, camera);
    let mut cameras = vec![camera_of(size, rate_hz, lens("Camera1")?, &pose_b_c1)];
    if let Some(pose_c1_c2) = pose_c1_c2 {
        let second = if settings.model == "Rectified" { "Camera1" } else { "Camera2" };
        cameras.push(camera_of(size, rate_hz, lens(second)?, &(pose_b_c1 * pose_c1_c2)));
    }
    let noise = [of("IMU.NoiseGyro")?, of("IMU.GyroWalk")?, of("IMU.NoiseAcc")?, of("IMU.AccWalk")?];
    let imu_rate_hz = of("IMU.Frequency")?;
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s: None, mounting: None })
}

fn lens(at: &At<'_>, values: &Values, model: &str, camera: &str) -> Result<Lens, ConfigError> {
    let of = |key: &str| at.number(values, &format!("{camera}.{key}"));
    let distortion = at.distortion("Camera.type", model, &MODELS, |key| match model {
        "Rectified" => Ok(0.0),
        // Coefficients may be left out.
        "PinHole" if !values.contains_key(&format!("{camera}.{key}")) => Ok(0.0),
        _ => of(key),
    })?;
    Ok(([of("fx")?, of("fy")?, of("cx")?, of("cy")?], distortion))
}
