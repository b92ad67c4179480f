use super::{euroc, kalibr_texts, with};
use crate::camera::Distortion;
use crate::import::{Source, read_into};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// `camchain-imucam.yaml` as Kalibr writes it; the second camera hangs on the first.
pub(super) const RADTAN: &str = include_str!("calibrations/kalibr_radtan.yaml");
/// One fisheye camera.
pub(super) const EQUIDISTANT: &str = include_str!("calibrations/kalibr_equidistant.yaml");
/// The input file.
pub(super) const IMU: &str = include_str!("calibrations/kalibr_imu.yaml");
/// IMU calibration as Kalibr writes it among its results.
const IMU_RESULT: &str = include_str!("calibrations/kalibr_imu_result.yaml");

/// The camera looks along body x, its x axis is body -y, its y axis body -z.
fn forward(position: [f64; 3]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.5, -0.5, 0.5, -0.5));
    Isometry3::from_parts(Translation3::from(position), rotation)
}

#[test]
fn a_stereo_chain_is_inverted_and_linked() {
    let config = kalibr_texts(RADTAN, IMU).expect("is good");
    // p_C = R p_B + t is zero at p_B = -Rᵀ t; the second camera is 0.11 m to the right, at smaller body y.
    for (camera, expected) in config.camera.iter().zip([[0.05, 0.02, 0.01], [0.05, 0.02 - 0.11, 0.01]]) {
        let difference = camera.pose_b_c().inverse() * forward(expected);
        assert!(difference.translation.vector.norm() < 1e-12, "{difference}");
        assert!(difference.rotation.angle() < 1e-7);
    }
    let ahead = config.camera[0].pose_b_c() * Vector3::z();
    assert!((ahead - Vector3::x()).norm() < 1e-12);
    assert_eq!(config.rig.time_offset_s, -0.0025);
    assert_eq!(config.camera[0].distortion, euroc().camera[0].distortion);
    assert_eq!((config.camera[0].rate_hz, &config.imu), (20.0, &euroc().imu));
}

#[test]
fn a_fisheye_is_read() {
    let config = kalibr_texts(EQUIDISTANT, IMU).expect("is good");
    assert!(
        matches!(config.camera[0].distortion, Distortion::Equidistant { k2, .. } if k2 == 0.0007150348452162257)
    );
    assert_eq!(config.camera.len(), 1);
    let camera_in_body = config.camera[0].pose_b_c();
    let back = camera_in_body.inverse().translation.vector;
    assert!((back - Vector3::new(0.04557484, -0.07116180, -0.04468125)).norm() < 1e-9);
}

#[test]
fn input_and_result_of_the_imu_say_the_same() {
    assert_eq!(kalibr_texts(RADTAN, IMU).expect("good"), kalibr_texts(RADTAN, IMU_RESULT).expect("good"));
    for (from, to, says) in [
        ("model: calibrated", "model: scale-misalignment", "`imu0.model`: is another model"),
        ("[1.0, 0.0, 0.0, 0.0]", "[1.0, 0.0, 0.0, 0.1]", "`imu0.T_i_b`: is not the identity"),
        ("  update_rate: 200.0\n", "", "imu.yaml: `imu0.update_rate`: missing"),
    ] {
        let message = kalibr_texts(RADTAN, &with(IMU_RESULT, from, to)).expect_err("is refused").to_string();
        assert!(message.contains(says), "{message}");
    }
}

#[test]
fn files_are_read_onto_a_base() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (chain, imu) = (folder.path().join("camchain.yaml"), folder.path().join("imu.yaml"));
    std::fs::write(&chain, RADTAN).expect("written");
    std::fs::write(&imu, IMU).expect("written");
    let mut base = euroc().into_inner();
    base.camera.iter_mut().for_each(|c| c.rate_hz = 30.0);
    let onto = read_into(base, Source::Kalibr { camchain: &chain, imu: &imu }).expect("is good");
    assert_eq!((&onto.config.imu, onto.config.camera[1].rate_hz), (&euroc().imu, 30.0));
    assert_eq!(onto.noise, [0.00016, 0.000022, 0.0028, 0.00086]);
    assert_eq!(
        onto.config.camera[1].pose_b_c,
        kalibr_texts(RADTAN, IMU).expect("is good").camera[1].pose_b_c
    );
    let none = folder.path().join("none.yaml");
    let message = read_into(euroc(), Source::Kalibr { camchain: &chain, imu: &none }).expect_err("missing");
    assert!(message.to_string().contains("none.yaml: cannot be read"), "{message}");
}

#[test]
fn what_is_wrong_is_named_by_file_and_key() {
    let own = "  T_cam_imu:\n  - [0.0, -1.0, 0.0, 0.5]\n  - [0.0, 0.0, -1.0, 0.01]\n  - [1.0, 0.0, 0.0, -0.05]\n  \
               - [0.0, 0.0, 0.0, 1.0]\n  T_cn_cnm1:";
    for (from, to, says) in [
        ("T_cam_imu", "T_cam_body", "camchain.yaml: `cam0.T_cam_imu`: missing"),
        ("  T_cn_cnm1:", own, "`cam1.T_cam_imu`: contradicts T_cn_cnm1"),
        ("[0.0, -1.0, 0.0, 0.02]", "[0.0, -1.0, 0.0]", "has rows of 3, 4, 4, 4 numbers"),
        (
            "[0.0, -1.0, 0.0, 0.02]",
            "[0.0, 1.0, 0.0, 0.02]",
            "`cam0.T_cam_imu`: the upper-left 3x3 block is a refl",
        ),
        ("T_cn_cnm1", "T_other", "`cam1.T_cam_imu`: missing"),
        ("timeshift_cam_imu: -0.0026", "timeshift_cam_imu: 0.1", "`cam1.timeshift_cam_imu`: differs"),
        ("timeshift_cam_imu: -0.0025", "timeshift_cam_imu: x", "`cam0.timeshift_cam_imu` (line"),
        ("cam1:", "cam2:", "`cam2`: is a third camera"),
        ("cam_overlaps: [0]", "cam_overlaps: [0, 3]", "`cam1.cam_overlaps`: names cam3, which is missing"),
        (
            "  - [1.0, 0.0, 0.0, -0.05]\n  - [0.0, 0.0, 0.0, 1.0]\n  cam_overlaps",
            "  cam_overlaps",
            "has rows of 4, 4 numbers, 4 rows of 4 expected; is the file cut off",
        ),
        ("cam0:", "cam:", "`cam0`: missing"),
        (
            "pinhole",
            "scaramuzza",
            "`cam0.camera_model`: is no known projection; calibrate with one of pinhole, omni, eucm, ds",
        ),
    ] {
        let message = kalibr_texts(&with(RADTAN, from, to), IMU).expect_err("is refused").to_string();
        assert!(message.contains(says), "{to}: {message}");
    }
}

#[test]
fn a_file_that_is_cut_off_before_its_second_camera_is_refused() {
    let (first, _) = RADTAN.split_once("cam1:").unwrap();
    let message = kalibr_texts(first, IMU).unwrap_err().to_string();
    assert!(message.contains("`cam0.cam_overlaps`: names cam1, which is missing"), "{message}");
    assert!(message.contains("cut off"), "{message}");
}

#[test]
fn exchanged_files_are_named() {
    for (camchain, imu, words) in [
        (IMU, RADTAN, "camchain.yaml: `(file)`: is the other file"),
        (RADTAN, RADTAN, "imu.yaml: `(file)`: is the other file"),
    ] {
        let message = kalibr_texts(camchain, imu).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("--camchain and --imu exchanged"), "{message}");
    }
}

/// The shape of every `kalibr_imu_chain.yaml` of OpenVINS.
fn openvins_imu(changed: (&str, &str)) -> String {
    let identity = "  - [1.0, 0.0, 0.0]\n    - [0.0, 1.0, 0.0]\n    - [0.0, 0.0, 1.0]\n";
    let zero = "  - [0.0, 0.0, 0.0]\n".to_owned() + &"    - [0.0, 0.0, 0.0]\n".repeat(2);
    let mut text = format!("%YAML:1.0\n\n{}", with(IMU_RESULT, "model: calibrated", "model: \"kalibr\""));
    for name in ["Tw", "R_IMUtoGYRO", "Ta", "R_IMUtoACC", "Tg"] {
        text += &format!("  {name}:\n  {}", if name == "Tg" { &zero } else { identity });
    }
    text.replacen(changed.0, changed.1, 1)
}

#[test]
fn neutral_intrinsics_of_the_imu_are_those_of_a_calibrated_one() {
    let plain = kalibr_texts(RADTAN, IMU).expect("good");
    assert_eq!(kalibr_texts(RADTAN, &openvins_imu(("", ""))).expect("good"), plain);
    let model_alone = with(IMU_RESULT, "model: calibrated", "model: rpng");
    assert_eq!(kalibr_texts(RADTAN, &model_alone).expect("good"), plain);
    let of_kalibr = with(IMU_RESULT, "model: calibrated", "model: scale-misalignment")
        + "  gyroscopes:\n    M: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n    A: [[0, 0, 0], [0, 0, 0], [0, 0, 0]]\n";
    assert_eq!(kalibr_texts(RADTAN, &of_kalibr).expect("good"), plain);
    for (from, to, says) in [
        ("Tw:\n    - [1.0", "Tw:\n    - [1.02", "`imu0.Tw`: Tw is not the identity"),
        ("Ta:\n    - [1.0, 0.0", "Ta:\n    - [1.0, 0.01", "`imu0.Ta`: Ta is not the identity"),
        ("Tg:\n    - [0.0", "Tg:\n    - [0.001", "`imu0.Tg`: Tg is not the zero matrix"),
    ] {
        let message = kalibr_texts(RADTAN, &openvins_imu((from, to))).expect_err("is refused").to_string();
        assert!(message.contains(says) && message.contains("not applied here"), "{message}");
    }
}

#[test]
fn the_inverse_pose_of_openvins_is_taken() {
    let plain = kalibr_texts(EQUIDISTANT, IMU).expect("good").camera[0].pose_b_c();
    let m = plain.to_homogeneous();
    let rows = (0..4).map(|i| format!("  - [{}, {}, {}, {}]\n", m[(i, 0)], m[(i, 1)], m[(i, 2)], m[(i, 3)]));
    let own = EQUIDISTANT.lines().skip(2).take(4).map(|line| format!("{line}\n")).collect::<String>();
    let inverse = with(
        EQUIDISTANT,
        &format!("  T_cam_imu:\n{own}"),
        &format!("  T_imu_cam:\n{}", rows.collect::<String>()),
    );
    let taken = kalibr_texts(&inverse, IMU).expect("good").camera[0].pose_b_c();
    assert!((taken.inverse() * plain).translation.vector.norm() < 1e-9);
    // Both, which contradict each other.
    let both = with(EQUIDISTANT, "  camera_model", &format!("  T_imu_cam:\n{own}  camera_model"));
    let message = kalibr_texts(&both, IMU).expect_err("contradicts").to_string();
    assert!(message.contains("`cam0.T_imu_cam`: is not the inverse of T_cam_imu"), "{message}");
    let cameras_alone = with(EQUIDISTANT, &format!("  T_cam_imu:\n{own}"), "");
    let message = kalibr_texts(&cameras_alone, IMU).expect_err("no pose").to_string();
    assert!(message.contains("cam0.T_cam_imu") && message.contains("camchain-imucam.yaml"), "{message}");
}

#[test]
fn files_of_other_programs_are_refused_with_the_option_that_takes_them() {
    let vins = "%YAML:1.0\nimu: 1\nnum_of_cam: 2\nbody_T_cam0: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [1, 0]\n";
    for (text, cure) in [
        (vins, "--rig"),
        ("{\"value0\":{\"T_imu_cam\":[{\"px\":0}]}}", "--rig"),
        ("%YAML:1.0\nFile.version: \"1.0\"\nCamera.type: \"PinHole\"\nCamera1.fx: 458.6\n", "--rig"),
        ("relative_config_imu: kalibr_imu_chain.yaml\n", "--rig"),
        ("sensor_type: camera\nT_BS:\n  data: [1]\n", "--euroc"),
        ("Camera:\n  name: \"EuRoC\"\n  setup: \"stereo\"\n", "calibrate with Kalibr"),
        ("fx: 458.6\nfy: 457.2\n", "no file of Kalibr (its first keys: fx, fy)"),
        ("a sentence\n", "it has no keys"),
    ] {
        let message = kalibr_texts(text, IMU).expect_err("another program's").to_string();
        assert!(
            message.contains(cure) && message.contains("camchain.yaml: `(file)`: is "),
            "{cure}: {message}"
        );
        let message = kalibr_texts(RADTAN, text).expect_err("another program's").to_string();
        assert!(message.contains(cure) && message.contains("imu.yaml: `(file)`: is "), "{cure}: {message}");
    }
}

#[test]
fn refused_values_are_said_of_both_files_and_by_their_keys_here() {
    let message = |chain: &str, imu: &str| kalibr_texts(chain, imu).expect_err("is refused").to_string();
    let both = message(&with(RADTAN, "367.215", "967.215"), &with(IMU, "200.0", "26.0"));
    assert!(both.contains("camchain.yaml, imu.yaml"), "{both}");
    assert!(both.contains("`imu.rate_hz`: 26 Hz") && both.contains("`camera[0].centre_px"), "{both}");
    let digits = message(&with(RADTAN, "[1.0, 0.0, 0.0, -0.05]", "[0.9, 0.0, 0.0, -0.05]"), IMU);
    assert!(digits.contains("copy T_cam_imu from the calibration with all its digits"), "{digits}");
}

#[test]
fn slips_in_files_of_kalibr_are_refused_with_what_to_write() {
    let message = |chain: &str, imu: &str| kalibr_texts(chain, imu).expect_err("is refused").to_string();
    for (from, to, words) in [
        ("458.654,", "458.654 px,", "`cam0.intrinsics[0]` (line"),
        (
            "[458.654, 457.296, 367.215, 248.375]",
            "[458.654, 0, 367.215, 0, 457.296, 248.375, 0, 0, 1]",
            "has 9 numbers; camera_model pinhole has 4: [fu, fv, pu, pv]",
        ),
        ("distortion_model: radtan", "distortion_model: plumb_bob8", "plumb_bob (k1 k2 p1 p2 k3)"),
        ("distortion_model: radtan", "distortion_model:", "`cam0.distortion_model`: missing"),
    ] {
        let said = message(&RADTAN.replacen(from, to, 1), IMU);
        assert!(said.contains(words), "{to}: {said}");
    }
    let rate = message(RADTAN, &with(IMU, "200.0", "200 Hz"));
    assert!(rate.contains("imu.yaml: `update_rate`") && rate.contains("no unit"), "{rate}");
    let comma = message(RADTAN, &with(IMU, "0.0028", "2,8e-3"));
    assert!(comma.contains("`accelerometer_noise_density`") && comma.contains("no decimal comma"), "{comma}");
}

/// ROS's `plumb_bob` with four numbers has no k3.
#[test]
fn plumb_bob_of_four_numbers_is_radial_tangential() {
    let four = RADTAN.replace("distortion_model: radtan", "distortion_model: plumb_bob");
    let [of_four, of_radtan] = [&four, RADTAN].map(|chain| kalibr_texts(chain, IMU).unwrap().camera.clone());
    assert_eq!(of_four, of_radtan);
}

/// Numbers of OpenVINS's configuration of a T265: a little more than 90 degrees to each side.
pub(super) const T265: &str = include_str!("calibrations/t265_openvins.yaml");

#[test]
fn a_lens_that_sees_beyond_a_right_angle_is_taken_and_one_that_folds_is_not() {
    let config = kalibr_texts(T265, IMU).expect("is good");
    assert_eq!(config.doubts(), Vec::<String>::new());
    let model = config.camera[0].model();
    let edge = nalgebra::Vector2::new(847.0, 396.0);
    assert!(model.unproject(&edge).is_none() && model.has_direction(&edge));
    // Folds 82 degrees from the axis: beyond the edges, but within the corners.
    let folding =
        with(T265, "[-0.003269003, 0.054052581, -0.051594096, 0.010749180]", "[0.0, 0.0, 0.0, -0.00631]");
    let folding = with(&folding, "[282.020, 280.715, 415.956, 396.661]", "[350.0, 350.0, 423.5, 399.5]");
    let doubts = kalibr_texts(&folding, IMU).expect("within its edges").doubts();
    assert!(
        doubts.len() == 1 && doubts[0].contains("82 degrees") && doubts[0].contains("4 of the corners"),
        "{doubts:?}"
    );
    let folded = with(&folding, "[350.0, 350.0,", "[300.0, 300.0,");
    let message = kalibr_texts(&folded, IMU).expect_err("folds").to_string();
    assert!(message.contains("camera[0].distortion") && message.contains("82 degrees"), "{message}");
}
