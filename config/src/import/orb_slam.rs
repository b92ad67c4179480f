//! ORB-SLAM3: settings in OpenCV's YAML with flat keys (`File.version: "1.0"`).
//!
//! `IMU.T_b_c1` takes coordinates from the left camera to the IMU, `T_BC`; `Stereo.T_c1_c2` from the right camera to the left
//! one. Rectified cameras have the same intrinsics, and lie `Stereo.b` apart.
//!
//! Source: ORB-SLAM3, `Settings.cc`.

use super::lens::{Lens, STRAIGHT, brown};
use super::yaml::Node;
use super::{Calibration, camera_of, rigid, whole_size};
use crate::camera::Distortion;
use crate::error::ConfigError;
use nalgebra::Isometry3;

const MODELS: &str = "PinHole, KannalaBrandt8, Rectified";

pub(super) fn convert(root: &Node<'_>) -> Result<Calibration, ConfigError> {
    if root.optional("Camera1.fx").is_none() {
        let cure = "write the file in the form of ORB-SLAM3 1.0 (File.version: \"1.0\", Camera1.fx, IMU.T_b_c1), as in its Examples";
        return Err(root.child("Camera1.fx").refuse("missing", cure));
    }
    let width = root.get("Camera.width")?;
    let size = whole_size(&width, [width.number()?, root.get("Camera.height")?.number()?])?;
    let rate_hz = root.get("Camera.fps")?.number()?;
    let pose_b_c1 = match root.optional("IMU.T_b_c1") {
        Some(node) => rigid(&node, node.matrix()?)?,
        None => {
            let cure = "give settings of an inertial example: the pose of the left camera in the axes of the IMU is needed";
            return Err(root.child("IMU.T_b_c1").refuse("missing", cure));
        }
    };
    let model = root.get("Camera.type")?;
    let mut cameras = vec![camera_of(lens(root, &model, "Camera1")?, size, rate_hz, &pose_b_c1)];
    if let Some(pose_c1_c2) = pose_of_second(root)? {
        let second = if model.text()? == "Rectified" { "Camera1" } else { "Camera2" };
        cameras.push(camera_of(lens(root, &model, second)?, size, rate_hz, &(pose_b_c1 * pose_c1_c2)));
    }
    let imu = |key| root.get(key)?.number();
    let noise = [imu("IMU.NoiseGyro")?, imu("IMU.GyroWalk")?, imu("IMU.NoiseAcc")?, imu("IMU.AccWalk")?];
    let imu_rate_hz = imu("IMU.Frequency")?;
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s: None, mounting: None })
}

/// Pose of the right camera in the axes of the left one; `None` for a single camera.
fn pose_of_second(root: &Node<'_>) -> Result<Option<Isometry3<f64>>, ConfigError> {
    if let Some(node) = root.optional("Stereo.T_c1_c2") {
        return Ok(Some(rigid(&node, node.matrix()?)?));
    }
    let baseline = root.optional("Stereo.b").map(|node| node.number()).transpose()?;
    Ok(baseline.map(|baseline_m| Isometry3::translation(baseline_m, 0.0, 0.0)))
}

fn lens(root: &Node<'_>, model: &Node<'_>, camera: &str) -> Result<Lens, ConfigError> {
    let of = |key: &str| root.get(&format!("{camera}.{key}"))?.number();
    let or_zero = |key: &str| root.optional(&format!("{camera}.{key}")).map_or(Ok(0.0), |node| node.number());
    let distortion = match model.text()? {
        "PinHole" => brown(or_zero("k1")?, or_zero("k2")?, or_zero("p1")?, or_zero("p2")?, or_zero("k3")?),
        "KannalaBrandt8" => {
            Distortion::Equidistant { k1: of("k1")?, k2: of("k2")?, k3: of("k3")?, k4: of("k4")? }
        }
        "Rectified" => STRAIGHT,
        _ => {
            return Err(model.refuse("is no known model", format!("calibrate with one of {MODELS}")));
        }
    };
    Ok(Lens::new([of("fx")?, of("fy")?, of("cx")?, of("cy")?], distortion))
}
