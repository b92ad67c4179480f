//! Calibration files of other programs, told by their keys, so that what is given can be said by name.

use super::yaml::{Document, Node};
use crate::error::{ConfigError, Violation};
use crate::text;
use std::path::Path;

/// Keys at the top of a file, and whose file it is then. Prefixes end with `*`.
const KEYS: [(&str, &str); 33] = [
    ("body_T_cam0", VINS),
    ("num_of_cam", VINS),
    ("cam0_calib", VINS),
    ("extrinsicRotation", VINS),
    ("projection_parameters", "a camera file of camodocal (VINS-Fusion, VINS-Mono)"),
    ("mirror_parameters", "a camera file of camodocal (VINS-Fusion, VINS-Mono)"),
    ("value0", BASALT),
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
    ("relative_config_imu", OPENVINS),
    ("cameras", "a camera rig of maplab, OKVIS or Kimera"),
    ("target_type", "Kalibr's description of its target"),
    ("Gyr", "a result of imu_utils"),
    ("Camera", "a configuration of stella_vslam or OpenVSLAM"),
    ("cameraData", DEPTHAI),
    ("boardName", DEPTHAI),
    ("camera_name", "a camera_info of ROS"),
    ("distortion_model", "a camera_info of ROS"),
    ("P0", "a calib.txt of KITTI"),
    ("P_rect_00", "a calibration of KITTI's raw data"),
];
const VINS: &str = "a configuration of VINS-Fusion or VINS-Mono";
const BASALT: &str = "a calibration of Basalt";
const OPENVINS: &str = "the estimator_config.yaml of OpenVINS, which names the two files to give";
const ORB_SLAM: &str = "a settings file of ORB-SLAM";
const OPENCV: &str = "a calibration of OpenCV";
const ASL: &str = "a sensor.yaml of a data set (EuRoC, Kimera); give its folder with --euroc";

const DEPTHAI: &str = "a calibration of an OAK camera (DepthAI)";

/// Marks of files that are no YAML, and the program of each.
const TEXTS: [(&str, &str); 12] = [
    ("T_SC", "a configuration of OKVIS"),
    ("<?xml", OPENCV),
    ("<opencv_storage", OPENCV),
    ("[LEFT_CAM_", ZED),
    ("[STEREO]", ZED),
    ("CalibrationFile", "a configuration of ROVIO"),
    ("# oST version", "a calibration of ROS (ost.txt)"),
    ("Calibration results", "the results of Kalibr as text"),
    ("Camera-system parameters", "the results of Kalibr as text"),
    ("# Camera list with one line", "a cameras.txt of COLMAP"),
    ("\"cameraData\"", DEPTHAI),
    ("calib_time:", "a calibration of KITTI's raw data"),
];
const ZED: &str = "a factory file of a ZED (`plumbline setup zed-mini` takes it)";

/// First words of the text files of DSO, which TUM-VI has beside those of Kalibr.
const DSO: [&str; 5] = ["EquiDistant", "Pinhole", "RadTan", "FOV", "KannalaBrandt"];

/// Keys by which a file of Kalibr is known, cut off or not.
const OF_KALIBR: [&str; 7] = [
    "cam0",
    "cam1",
    "imu0",
    "update_rate",
    "accelerometer_noise_density",
    "gyroscope_noise_density",
    "rostopic",
];

/// Reads a file of Kalibr; names the file of another program that is no YAML.
pub(super) fn read(path: &Path, expected: &str) -> Result<Document, ConfigError> {
    parse(&text::read_bounded(path)?, &path.display().to_string(), expected)
}

/// Parses a file of Kalibr, as [`read`].
pub(super) fn parse(content: &str, origin: &str, expected: &str) -> Result<Document, ConfigError> {
    Document::parse(content, origin).map_err(|error| match whose_text(content) {
        Some(whose) => refuse(origin, whose, expected),
        None => error,
    })
}

/// Refuses the file of another program; `expected` is what should be given.
pub(super) fn check(document: &Document, expected: &str) -> Result<(), ConfigError> {
    let root = document.root();
    // A file of Kalibr with more in it is still one.
    if OF_KALIBR.iter().any(|key| root.optional(key).is_some()) {
        return Ok(());
    }
    let keys = root.keys();
    let whose =
        whose(&root).map(str::to_owned).or_else(|| root.text().ok().and_then(whose_text).map(str::to_owned));
    let whose = whose.unwrap_or_else(|| match keys.len() {
        0 => "no table of keys".to_owned(),
        _ => format!("no file of Kalibr (its first keys: {})", keys[..keys.len().min(3)].join(", ")),
    });
    Err(refuse(document.origin(), &whose, expected))
}

fn refuse(origin: &str, whose: &str, expected: &str) -> ConfigError {
    let cure = match whose {
        VINS | ORB_SLAM | BASALT | OPENVINS => {
            format!("`plumbline config import --rig` takes it as it is; otherwise give {expected}")
        }
        DSO_CAMERA => "TUM-VI has camchain.yaml and imu_config.yaml beside it".to_owned(),
        _ => format!(
            "give {expected}; calibrate with Kalibr, or write its keys with these numbers (mind the direction of the extrinsics: \
             T_cam_imu takes coordinates from the IMU to the camera)"
        ),
    };
    ConfigError::one(origin, Violation::new("(file)", format!("is {whose}; {expected} is expected"), cure))
}

const DSO_CAMERA: &str = "a camera file of DSO (as TUM-VI has in dso/)";

fn whose_text(content: &str) -> Option<&'static str> {
    if DSO.iter().any(|word| content.trim_start().starts_with(word)) {
        return Some(DSO_CAMERA);
    }
    TEXTS.iter().find(|(part, _)| content.contains(part)).map(|(_, whose)| *whose)
}

fn whose(root: &Node<'_>) -> Option<&'static str> {
    let keys = root.keys();
    let is_there = |key: &str| match key.strip_suffix('*') {
        Some(prefix) => keys.iter().any(|name| name.starts_with(prefix)),
        None => keys.contains(&key),
    };
    KEYS.iter().find(|(key, _)| is_there(key)).map(|(_, whose)| *whose)
}
