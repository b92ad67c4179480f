use super::{euroc, euroc_texts, with};
use crate::import::{Source, euroc_into, read_into};
use crate::options::{Mounting, isometry_from_rows};
use std::fs;
use std::path::Path;

pub(super) const CAM0: &str = "%YAML:1.0
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
";
pub(super) const IMU0: &str = "#Default imu sensor yaml file
sensor_type: imu
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]
gyroscope_random_walk: 1.9393e-05
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
";

fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().expect("has a folder")).expect("created");
    fs::write(path, text).expect("written");
}

#[test]
fn the_real_calibration_is_that_of_the_presets() {
    let Some(calibration) = plumbline_test_support::shared("euroc/calibration") else { return };
    let import = read_into(euroc(), Source::Euroc(&calibration)).expect("is good");
    assert_eq!(import.config, euroc());
    let simulated = crate::Config::preset("sim").expect("is good").imu.clone();
    let noise = [simulated.gyro_noise_density, simulated.gyro_bias_walk];
    assert_eq!(import.noise[..2], noise);
    assert_eq!(import.noise[2..], [simulated.accel_noise_density, simulated.accel_bias_walk]);
}

#[test]
fn every_layout_is_found_and_the_second_camera_is_optional() {
    for layout in ["mav0/{}/sensor.yaml", "{}/sensor.yaml", "{}.yaml"] {
        let folder = tempfile::tempdir().expect("temporary folder");
        write(folder.path(), &layout.replace("{}", "cam0"), CAM0);
        write(folder.path(), &layout.replace("{}", "imu0"), IMU0);
        let import = read_into(euroc(), Source::Euroc(folder.path())).expect("is good");
        assert_eq!((&import.config.camera[..], import.noise[0]), (&euroc().camera[..1], 1.6968e-4));
        assert_eq!(import.config.imu, euroc().imu, "the inflated noise is kept");
        write(folder.path(), &layout.replace("{}", "cam1"), "broken: [");
        let message = euroc_into(euroc(), folder.path()).expect_err("cam1 is there, and broken").to_string();
        assert!(message.contains("cam1"), "{message}");
    }
}

#[test]
fn a_missing_file_is_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let error = euroc_into(euroc(), folder.path()).expect_err("empty");
    assert!(error.to_string().contains("no calibration found"), "{error}");
    write(folder.path(), "cam0.yaml", CAM0);
    let message = euroc_into(euroc(), folder.path()).expect_err("no IMU").to_string();
    assert!(
        message.contains("imu0.yaml: no calibration found; expected the sensor.yaml of an IMU"),
        "{message}"
    );
}

#[test]
fn headers_of_opencv_and_of_yaml_and_none_are_read() {
    let good = euroc_texts(CAM0, IMU0).expect("is good");
    let bare = CAM0.trim_start_matches("%YAML:1.0\n");
    for header in
        ["", "---\n", "%YAML:1.0\n---\n", "%YAML 1.0\n---\n", "%YAML:1.0\r\n", "\u{feff}%YAML:1.0\n"]
    {
        assert_eq!(euroc_texts(&format!("{header}{bare}"), IMU0).expect("is good"), good, "{header:?}");
    }
    let tagged = with(CAM0, "T_BS:", "T_BS: !!opencv-matrix");
    assert_eq!(euroc_texts(&tagged, IMU0).expect("is good"), good);
}

#[test]
fn an_imu_off_the_body_moves_the_cameras() {
    let off = with(IMU0, "[1.0, 0.0, 0.0, 0.0, 0.0,", "[1.0, 0.0, 0.0, 0.25, 0.0,");
    let config = euroc_texts(CAM0, &off).expect("is good");
    let (moved, original) = (isometry_from_rows(&config.camera[0].pose_b_c), euroc().camera[0].pose_b_c());
    let difference = original.translation.vector - moved.translation.vector;
    assert!((difference - nalgebra::Vector3::new(0.25, 0.0, 0.0)).norm() < 1e-12);
    assert!(moved.rotation.angle_to(&original.rotation) < 1e-7);
}

#[test]
fn what_is_wrong_is_named_by_file_and_key() {
    for (from, to, says) in [
        ("resolution: [752, 480]", "resolution: [752]", "cam0: `resolution"),
        ("resolution: [752, 480]", "resolution: [752.5, 480]", "`resolution[0]` (line 13): no whole number"),
        ("intrinsics: [458.654", "intrinsics: [abc", "`intrinsics[0]` (line 15)"),
        ("intrinsics: [458.654", "intrinsics: [.nan", "`intrinsics[0]` (line 15)"),
        ("rate_hz: 20", "", "cam0: `rate_hz`: missing"),
        (
            "radial-tangential",
            "fov",
            "`distortion_model`: fov of 4 coefficients does not go with camera_model pinhole",
        ),
        ("pinhole", "omni", "`intrinsics`: has 4 numbers; camera_model omni has 5: [xi, fu, fv, pu, pv]"),
        (
            "distortion_coefficients: [",
            "distortion_coefficients: [0.1, ",
            "`distortion_model`: radial-tangential of 5 coefficients does not go with camera_model pinhole; use",
        ),
        ("[0.0148655429818,", "[0.5,", "`T_BS`: the upper-left 3x3 block is not a rotation"),
        ("[0.0148655429818,", "[", "has 15 numbers; give exactly 16"),
        ("-0.0216401454975", "-21.6401454975", "`T_BS`: the camera is 21.640 m from the IMU"),
        ("intrinsics: [458.654", "intrinsics: [-458.654", "`camera[0].focal_px[0]`: -458.654 is outside"),
        ("resolution: [752, 480]", "resolution: [752, 480", "(line 14)"),
    ] {
        let message = euroc_texts(&with(CAM0, from, to), IMU0).expect_err("is refused").to_string();
        assert!(message.contains(says), "{to}: {message}");
    }
    for text in ["", "7", "[1, 2]", "a: b"] {
        euroc_texts(text, IMU0).expect_err("is refused");
    }
}

#[test]
fn a_mounting_is_stated_or_that_of_the_same_rig_or_unknown() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let stated = |imu: &str, cam: &str| {
        write(folder.path(), "cam0/sensor.yaml", cam);
        write(folder.path(), "imu0/sensor.yaml", imu);
        let import = read_into(euroc(), Source::Euroc(folder.path())).expect("is good");
        (import.config.vehicle.imu_to_vehicle_deg.degrees(), import.mounting)
    };
    // The rig of the base, and one whose camera looks elsewhere.
    assert_eq!(stated(IMU0, CAM0), (Some([180.0, -70.3, 0.0]), None));
    let other = CAM0.replace("-0.999880929698, 0.00414029679422", "0.999880929698, -0.00414029679422");
    let other = other.replace("0.0149672133247, 0.025715529948", "-0.0149672133247, -0.025715529948");
    let other = other.replace("0.00375618835797, 0.999660727178", "-0.00375618835797, -0.999660727178");
    assert_eq!(stated(IMU0, &other), (None, None));
    let known = format!("{IMU0}imu_to_vehicle_deg: [1.0, 2.0, 3.0]\n");
    assert_eq!(stated(&known, CAM0), (Some([1.0, 2.0, 3.0]), Some(Mounting::Known([1.0, 2.0, 3.0]))));
    let unknown = format!("{IMU0}imu_to_vehicle_deg: unknown\n");
    assert_eq!(stated(&unknown, CAM0), (None, Some(Mounting::Unknown)));
}
