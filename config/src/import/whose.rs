//! Calibration files of other programs, told by their keys, so that what is given can be said by name.

use super::yaml::{Document, Node};
use crate::error::ConfigError;

/// Keys at the top of a file, and whose file it is then. Prefixes end with `*`.
const KEYS: [(&str, &str); 26] = [
    ("body_T_cam0", VINS),
    ("num_of_cam", VINS),
    ("cam0_calib", VINS),
    ("extrinsicRotation", VINS),
    ("projection_parameters", "a camera file of camodocal (VINS-Fusion, VINS-Mono)"),
    ("mirror_parameters", "a camera file of camodocal (VINS-Fusion, VINS-Mono)"),
    ("value0", "a calibration of Basalt"),
    ("Camera.type", ORB_SLAM),
    ("Camera1.*", ORB_SLAM),
    ("Camera.*", ORB_SLAM),
    ("Camera_*", ORB_SLAM),
    ("ORBextractor.*", ORB_SLAM),
    ("IMU.*", ORB_SLAM),
    ("rectification_matrix", "a camera_info of ROS"),
    ("projection_matrix", "a camera_info of ROS"),
    ("camera_matrix", OPENCV),
    ("cameraMatrix*", OPENCV),
    ("Camera_Matrix", OPENCV),
    ("M1", OPENCV),
    ("K1", OPENCV),
    ("T_BS", ASL),
    ("T_SC", ASL),
    ("relative_config_imu", "the estimator_config.yaml of OpenVINS, which names the two files to give"),
    ("cameras", "a camera rig of maplab, OKVIS or Kimera"),
    ("target_type", "Kalibr's description of its target"),
    ("Gyr", "a result of imu_utils"),
];
const VINS: &str = "a configuration of VINS-Fusion or VINS-Mono";
const ORB_SLAM: &str = "a settings file of ORB-SLAM";
const OPENCV: &str = "a calibration of OpenCV";
const ASL: &str = "a sensor.yaml of a data set (EuRoC, Kimera); give its folder with --euroc";

/// First words of the text files of DSO, which TUM-VI has beside those of Kalibr.
const DSO: [&str; 5] = ["EquiDistant", "Pinhole", "RadTan", "FOV", "KannalaBrandt"];

/// Refuses the file of another program; `expected` is what should be given.
pub(super) fn check(document: &Document, expected: &str) -> Result<(), ConfigError> {
    let root = document.root();
    let Some(whose) = whose(&root) else { return Ok(()) };
    let cure = match whose {
        DSO_CAMERA => "TUM-VI has camchain.yaml and imu_config.yaml beside it".to_owned(),
        _ => format!(
            "give {expected}; calibrate with Kalibr, or write its keys with these numbers (mind the direction of the extrinsics: \
             T_cam_imu takes coordinates from the IMU to the camera)"
        ),
    };
    Err(root.refuse(format!("is {whose}; {expected} is expected"), cure))
}

const DSO_CAMERA: &str = "a camera file of DSO (as TUM-VI has in dso/)";

fn whose(root: &Node<'_>) -> Option<&'static str> {
    if let Ok(text) = root.text() {
        return DSO.iter().any(|word| text.trim_start().starts_with(word)).then_some(DSO_CAMERA);
    }
    // A file of Kalibr with more in it is still one.
    if ["cam0", "imu0", "update_rate"].iter().any(|key| root.optional(key).is_some()) {
        return None;
    }
    let keys = root.keys();
    let is_there = |key: &str| match key.strip_suffix('*') {
        Some(prefix) => keys.iter().any(|name| name.starts_with(prefix)),
        None => keys.contains(&key),
    };
    KEYS.iter().find(|(key, _)| is_there(key)).map(|(_, whose)| *whose)
}
