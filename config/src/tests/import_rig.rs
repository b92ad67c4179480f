//! Calibrations of public rigs, in the form of the program that each was made for. The numbers are facts of the rigs; the
//! source of each stands beside it.

use super::{euroc, kalibr_texts, with};
use crate::camera::Distortion;
use crate::import::fuzzing::rig_text;
use crate::import::{Import, Source, read_into};
use crate::{CameraModel, ValidConfig};
use nalgebra::{Isometry3, Vector2};

const NO_FILE: &str = "";
const IMU: &str = super::import_kalibr::IMU;

/// UZ-SLAMLab/ORB_SLAM3, `Examples/Stereo-Inertial/TUM-VI.yaml`.
const TUM_VI_ORB_SLAM: &str = include_str!("calibrations/tum_vi_orb_slam.yaml");
/// UZ-SLAMLab/ORB_SLAM3, `Examples/Stereo-Inertial/RealSense_D435i.yaml`.
const D435I_ORB_SLAM: &str = include_str!("calibrations/d435i_orb_slam.yaml");
/// HKUST-Aerial-Robotics/VINS-Fusion, `config/mynteye/mynteye_stereo_imu_config.yaml`, `left_mei.yaml` and `right_mei.yaml`.
const MYNT_EYE_VINS: &str = include_str!("calibrations/mynt_eye_vins.yaml");
const MYNT_EYE_LEFT: &str = include_str!("calibrations/mynt_eye_left.yaml");
const MYNT_EYE_RIGHT: &str = include_str!("calibrations/mynt_eye_right.yaml");
/// HKUST-Aerial-Robotics/VINS-Fusion, `config/realsense_t265`; the left camera in two models, the second as a comment.
const T265_VINS: &str = include_str!("calibrations/t265_vins.yaml");
const T265_KANNALA_BRANDT: &str = include_str!("calibrations/t265_kannala_brandt.yaml");
const T265_MEI: &str = include_str!("calibrations/t265_mei.yaml");
/// HKUST-Aerial-Robotics/VINS-Fusion, `config/euroc/euroc_mono_imu_config.yaml` and `cam0_pinhole.yaml` in one file.
const EUROC_VINS_MONO: &str = include_str!("calibrations/euroc_vins_mono.yaml");

/// VladyslavUsenko/basalt, `data/euroc_ds_calib.json`.
const EUROC_BASALT: &str = include_str!("calibrations/euroc_basalt.json");
/// VladyslavUsenko/basalt, `data/tumvi_512_eucm_calib.json`.
const TUM_VI_BASALT: &str = include_str!("calibrations/tum_vi_basalt.json");
/// CIFASIS/basalt-xr, `data/odysseyplus_rt8_calib.json`: a Samsung Odyssey+, whose cameras look 23 degrees to either side; both, and
/// the left one alone.
const ODYSSEY_BASALT: &str = include_str!("calibrations/odyssey_basalt.json");
const ODYSSEY_LEFT_BASALT: &str = include_str!("calibrations/odyssey_left_basalt.json");
/// rpng/open_vins, `config/rs_d455/kalibr_imucam_chain.yaml`.
const D455_OPENVINS: &str = include_str!("calibrations/d455_openvins.yaml");
/// rpng/open_vins, `config/hilti`: an Alphasense with `T_imu_cam` and `model: "kalibr"`.
const HILTI_OPENVINS: &str = include_str!("calibrations/hilti_openvins.yaml");
const HILTI_IMU: &str = include_str!("calibrations/hilti_imu.yaml");
/// rpng/open_vins, `config/uzhfpv_indoor`: the Snapdragon board of the UZH-FPV drone.
const UZH_FPV_OPENVINS: &str = include_str!("calibrations/uzh_fpv_openvins.yaml");
/// Kalibr's wiki, `yaml-formats`: a VI-Sensor whose second camera was calibrated as omni-radtan.
const VI_SENSOR_KALIBR: &str = include_str!("calibrations/vi_sensor_kalibr.yaml");
/// Public notes on Kalibr's conventions (`camchain-imucam` of 2020-08-05): a drone with fisheye cameras of 1440x1080 px as
/// double sphere; the left one.
const FISHEYE_KALIBR: &str = include_str!("calibrations/fisheye_kalibr.yaml");

fn read(text: &str, camera: &str) -> Import {
    rig_text(euroc().into_inner(), text, camera).unwrap_or_else(|error| panic!("{error}"))
}

/// Size, distance of the second camera from the first and along its x axis, m; and that nothing is doubtful.
fn check_pair(config: &ValidConfig, size: (usize, usize), baseline_m: f64) {
    assert_eq!((config.camera[0].width_px, config.camera[0].height_px), size);
    let shift = (config.camera[0].pose_b_c().inverse() * config.camera[1].pose_b_c()).translation.vector;
    assert!((shift.norm() - baseline_m).abs() < 1e-3, "{shift}");
    assert!(shift.x > 0.95 * shift.norm(), "to the right: {shift}");
    assert_eq!(config.doubts(), Vec::<String>::new());
}

/// Largest distance of the pixels at which two calibrations of one camera see the same direction, over the image as far as it is
/// used.
fn differ_px(a: &CameraModel, b: &CameraModel) -> f64 {
    let pixels = (1..8).flat_map(|i| (1..8).map(move |j| (i, j)));
    let distances = pixels.filter_map(|(i, j)| {
        let px = Vector2::new((i * a.width_px / 8) as f64, (j * a.height_px / 8) as f64);
        Some((b.project(&a.unproject(&px)?.push(1.0))? - px).norm())
    });
    let distances: Vec<f64> = distances.collect();
    assert!(distances.len() > 40, "{} pixels", distances.len());
    distances.into_iter().fold(0.0, |most, distance| if distance > most { distance } else { most })
}

#[test]
fn tum_vi_is_read_from_orb_slam_and_basalt_and_both_mean_the_same() {
    let orb = read(TUM_VI_ORB_SLAM, NO_FILE);
    check_pair(&orb.config, (512, 512), 0.10109);
    assert_eq!(orb.noise, [0.00016, 0.000022, 0.0028, 0.00086]);
    assert_eq!(orb.config.imu.gyro_noise_density, euroc().imu.gyro_noise_density, "that of the base is kept");
    assert!(matches!(
        orb.config.camera[1].distortion,
        Distortion::Equidistant { k4: 0.0003299517423931039, .. }
    ));
    let basalt = read(TUM_VI_BASALT, NO_FILE);
    check_pair(&basalt.config, (512, 512), 0.10099);
    assert_eq!(basalt.config.rig.time_offset_s, 0.002124029);
    for camera in 0..2 {
        let models = [&orb, &basalt].map(|rig| rig.config.camera[camera].model());
        let differ = differ_px(&models[0], &models[1]);
        assert!(differ < 1.0, "{differ} px");
        let poses = [&orb, &basalt].map(|rig| rig.config.camera[camera].pose_b_c());
        assert!((poses[0].inverse() * poses[1]).rotation.angle() < 0.02);
    }
}

#[test]
fn euroc_is_read_from_basalt_and_vins_and_both_mean_the_same_as_the_preset() {
    let basalt = read(EUROC_BASALT, NO_FILE);
    check_pair(&basalt.config, (752, 480), 0.11023);
    for camera in 0..2 {
        let differ = differ_px(&euroc().camera[camera].model(), &basalt.config.camera[camera].model());
        assert!(differ < 3.0, "{differ} px");
        let turn = euroc().camera[camera]
            .pose_b_c()
            .rotation
            .angle_to(&basalt.config.camera[camera].pose_b_c().rotation);
        assert!(turn < 0.02, "{turn}");
    }
    let mono = read(EUROC_VINS_MONO, NO_FILE);
    assert_eq!(mono.config.camera.len(), 1);
    assert!(
        differ_px(&euroc().camera[0].model(), &mono.config.camera[0].model()) < 8.0,
        "another calibration"
    );
    let error: Isometry3<f64> = mono.config.camera[0].pose_b_c().inverse() * euroc().camera[0].pose_b_c();
    assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-7);
    assert_eq!(mono.noise, [0.004, 2e-6, 0.08, 0.00004]);
    assert_eq!(mono.config.imu.rate_hz, euroc().imu.rate_hz, "the files tell none");
}

#[test]
fn a_mynt_eye_is_read_from_vins_fusion_with_the_camera_files_that_it_names() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for (name, text) in
        [("rig.yaml", MYNT_EYE_VINS), ("left_mei.yaml", MYNT_EYE_LEFT), ("right_mei.yaml", MYNT_EYE_RIGHT)]
    {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    let rig = read_into(euroc(), Source::Rig(&folder.path().join("rig.yaml"))).expect("is good");
    check_pair(&rig.config, (752, 480), 0.1166);
    assert_eq!(rig.config.rig.time_offset_s, 0.0025);
    assert!(matches!(rig.config.camera[1].distortion, Distortion::Omni { xi: 1.5056030540672460, .. }));
    std::fs::remove_file(folder.path().join("right_mei.yaml")).expect("removed");
    let missing =
        read_into(euroc(), Source::Rig(&folder.path().join("rig.yaml"))).expect_err("no file").to_string();
    assert!(missing.contains("right_mei.yaml: cannot be read"), "{missing}");
}

#[test]
fn a_t265_is_read_as_kannala_brandt_and_as_mei_and_both_mean_the_same() {
    let [fisheye, mei] = [T265_KANNALA_BRANDT, T265_MEI].map(|camera| read(T265_VINS, camera).config);
    assert_eq!(fisheye.doubts(), Vec::<String>::new());
    // This fit of the unified model folds 88 degrees from the axis, before the edges of the image.
    assert!(
        matches!(&mei.doubts()[..], [doubt] if doubt.contains("folds back 88 degrees")),
        "{:?}",
        mei.doubts()
    );
    let differ = differ_px(&fisheye.camera[0].model(), &mei.camera[0].model());
    assert!(differ < 6.0, "{differ} px");
}

#[test]
fn a_d435i_is_read_as_rectified_cameras() {
    let rig = read(D435I_ORB_SLAM, NO_FILE);
    check_pair(&rig.config, (640, 480), 0.0499585);
    assert_eq!(rig.config.camera[0].focal_px, rig.config.camera[1].focal_px);
    assert_eq!((rig.config.camera[0].rate_hz, rig.noise[2]), (30.0, 0.01));
}

#[test]
fn the_rational_lenses_of_a_headset_are_read_from_basalt() {
    let rig = read(ODYSSEY_LEFT_BASALT, NO_FILE);
    assert_eq!((rig.config.camera[0].width_px, rig.config.imu.rate_hz), (640, 250.0));
    assert!(matches!(rig.config.camera[0].distortion, Distortion::Rational { k6: 0.06621214747428894, .. }));
    assert_eq!(rig.noise, [0.00095, 0.001, 0.0107, 0.01]);
    // The factory's `rpmax` is 70 degrees.
    assert!(matches!(&rig.config.doubts()[..], [doubt] if doubt.contains("folds back 73 degrees")));
    // Both together look too far apart for a pair.
    let pair = rig_text(euroc().into_inner(), ODYSSEY_BASALT, NO_FILE).expect_err("is refused").to_string();
    assert!(
        pair.contains("rig.yaml: `camera[1].pose_b_c`") && pair.contains("the images must overlap"),
        "{pair}"
    );
}

#[test]
fn rigs_of_openvins_are_read() {
    let d455 = kalibr_texts(D455_OPENVINS, IMU).expect("is good");
    check_pair(&d455, (640, 360), 0.09398);
    let hilti = kalibr_texts(HILTI_OPENVINS, HILTI_IMU).expect("is good");
    // Of this head the first camera is the right one, of which the import tells.
    let [exchanged] = &hilti.doubts()[..] else { panic!("{:?}", hilti.doubts()) };
    assert!(
        exchanged.contains("does not lie to the right of camera[0]") && exchanged.contains("exchanged?"),
        "{exchanged}"
    );
    assert_eq!(hilti.camera[1].width_px, 720);
    assert_eq!(hilti.imu.rate_hz, 400.0);
    let uzh = kalibr_texts(UZH_FPV_OPENVINS, IMU).expect("is good");
    check_pair(&uzh, (640, 480), 0.07962);
    let folder = tempfile::tempdir().expect("temporary folder");
    let config = "%YAML:1.0\nverbosity: \"INFO\"\nuse_stereo: true\nrelative_config_imu: \"imu.yaml\"\nrelative_config_imucam: \"chain.yaml\"\n";
    for (name, text) in
        [("estimator_config.yaml", config), ("chain.yaml", HILTI_OPENVINS), ("imu.yaml", HILTI_IMU)]
    {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    let rig = read_into(euroc(), Source::Rig(&folder.path().join("estimator_config.yaml"))).expect("is good");
    assert_eq!(rig.config.camera[0].pose_b_c, hilti.camera[0].pose_b_c);
    assert_eq!(rig.noise, [1.6968e-4, 1.9393e-5, 2e-3, 3e-3]);
}

#[test]
fn a_folder_of_tum_vi_is_read() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let none = read_into(euroc(), Source::Rig(folder.path())).expect_err("is empty").to_string();
    assert!(none.contains("dso/camchain.yaml"), "{none}");
    std::fs::create_dir(folder.path().join("dso")).expect("made");
    std::fs::write(folder.path().join("dso/camchain.yaml"), super::import_kalibr::EQUIDISTANT)
        .expect("written");
    std::fs::write(folder.path().join("dso/imu_config.yaml"), IMU).expect("written");
    let rig = read_into(euroc(), Source::Rig(folder.path())).expect("is good");
    assert_eq!(rig.config.camera[0].width_px, 512);
}

#[test]
fn kalibrs_omni_and_double_sphere_are_read() {
    let omni = kalibr_texts(VI_SENSOR_KALIBR, IMU).expect("is good");
    check_pair(&omni, (752, 480), 0.11004);
    let lens =
        Distortion::Omni { xi: 0.80065662, k1: -0.33518750, k2: 0.13211436, p1: 0.00055967, p2: 0.00057686 };
    assert_eq!((omni.camera[1].distortion, omni.camera[1].focal_px), (lens, [833.006, 830.345]));
    // Near the axis it has about the focal length of the pinhole beside it.
    let near_axis = omni.camera[1].focal_px[0] / (1.0 + 0.80065662);
    assert!((near_axis / omni.camera[0].focal_px[0] - 1.0).abs() < 0.01, "{near_axis}");
    let sphere = kalibr_texts(FISHEYE_KALIBR, IMU).expect("is good");
    let lens = Distortion::DoubleSphere { xi: -0.21697771106770586, alpha: 0.5920493574492033 };
    assert_eq!((sphere.camera[0].distortion, sphere.doubts()), (lens, Vec::new()));
    let eucm = with(FISHEYE_KALIBR, "camera_model: ds", "camera_model: eucm");
    let eucm = with(&eucm, "[-0.21697771106770586, 0.5920493574492033,", "[0.62, 1.05,");
    let config = kalibr_texts(&eucm, IMU).expect("is good");
    assert_eq!(config.camera[0].distortion, Distortion::Eucm { alpha: 0.62, beta: 1.05 });
}

#[test]
fn what_is_wrong_is_named_by_file_and_key_with_what_is_known() {
    let refused = |text: &str, camera: &str| {
        rig_text(euroc().into_inner(), text, camera).expect_err("is refused").to_string()
    };
    for (from, to, says) in [
        (
            "\"KannalaBrandt8\"",
            "\"Omni\"",
            "rig.yaml: `Camera.type`: is no known model; calibrate with one of PinHole",
        ),
        ("Camera2.k4: 0.0003299517423931039\n", "", "`Camera2.k4`: missing"),
        ("Camera.width: 512", "Camera.width: 512.5", "`Camera.width` (line"),
        ("[-0.9995250378696743,", "[0.5,", "`IMU.T_b_c1`: the upper-left 3x3 block is not a rotation"),
        ("IMU.Frequency: 200.0\n", "", "`IMU.Frequency`: missing"),
        (
            "Camera1.fx: 190.97847715128717",
            "Camera.fx: 190.9",
            "`Camera1.fx`: missing; write the file in the form of ORB-SLAM3 1.0",
        ),
        (
            "Camera1.k1: 0.0034823894022493434",
            "Camera1.k1: -9.0",
            "`camera[0].distortion`: the lens model folds back",
        ),
    ] {
        let message = refused(&with(TUM_VI_ORB_SLAM, from, to), NO_FILE);
        assert!(message.contains(says), "{to}: {message}");
    }
    let camera = |from: &str, to: &str| refused(MYNT_EYE_VINS, &with(MYNT_EYE_LEFT, from, to));
    let unknown = camera("MEI", "SCARAMUZZA");
    assert!(
        unknown.contains("left_mei.yaml: `model_type`")
            && unknown.contains("PINHOLE_FULL, KANNALA_BRANDT, MEI"),
        "{unknown}"
    );
    let missing = camera("   xi: 1.4456544769803834e+00\n", "   chi: 1.0\n");
    assert!(missing.contains("left_mei.yaml: `mirror_parameters.xi`: missing"), "{missing}");
    let three = refused(&with(MYNT_EYE_VINS, "num_of_cam: 2", "num_of_cam: 3"), MYNT_EYE_LEFT);
    assert!(three.contains("`num_of_cam`: is 3"), "{three}");
    let basalt = |from: &str, to: &str| refused(&with(EUROC_BASALT, from, to), NO_FILE);
    let unknown = basalt("\"ds\"", "\"fov\"");
    assert!(
        unknown.contains("`value0.intrinsics[0].camera_type`: is no known model") && unknown.contains("kb4"),
        "{unknown}"
    );
    let scaled = basalt("0.067, 0.0,", "0.067, 0.016,");
    assert!(
        scaled.contains("`value0.calib_accel_bias[3]`: is a scale error") && scaled.contains("1.6 %"),
        "{scaled}"
    );
    let long = basalt("\"qw\": 0.7123125505904486", "\"qw\": 0.9");
    assert!(long.contains("`value0.T_imu_cam[0].qw`: has a quaternion of length"), "{long}");
    let wild = basalt("\"alpha\": 0.566996899163044", "\"alpha\": 1.5");
    assert!(wild.contains("`camera[0].distortion.alpha`: 1.5 is outside 0 to 1"), "{wild}");
    for (text, says) in [
        (D455_OPENVINS, "--camchain and --imu"),
        (T265_MEI, "VINS-Mono that names it"),
        ("a: 1\nb: 2\n", "its first keys: a, b"),
        ("[1, 2]", "has no keys"),
    ] {
        let message = refused(text, NO_FILE);
        assert!(message.contains("rig.yaml: `(file)`") && message.contains(says), "{message}");
    }
    for (from, to, says) in [
        (
            "distortion_model: none",
            "distortion_model: radtan",
            "`cam0.distortion_model`: radtan of 0 coefficients does not go with camera_model ds",
        ),
        ("0.5920493574492033", "1.5", "`camera[0].distortion.alpha`: 1.5 is outside 0 to 1"),
        (
            "-0.21697771106770586, ",
            "",
            "`cam0.intrinsics`: has 5 numbers; camera_model ds has 6: [xi, alpha, fu, fv, pu, pv]",
        ),
    ] {
        let message = kalibr_texts(&with(FISHEYE_KALIBR, from, to), IMU).expect_err("is refused").to_string();
        assert!(message.contains(says), "{message}");
    }
}
