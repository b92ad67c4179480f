//! Cameras are calibrated by images of boards: real ones against the published values, rendered ones against the truth.

use nalgebra::{Isometry3, Vector2, Vector3};
use opencv::core::{Mat, Point2f, Point3f, Size, TermCriteria, TermCriteria_Type, Vector};
use opencv::imgcodecs::imwrite;
use plumbline_boards::{chessboard, markers, refine};
use plumbline_config::camera::Distortion;
use plumbline_config::options::ImageRecording;
use plumbline_config::{CameraModel, Config, Timestamp, ValidConfig, import};
use plumbline_drivers::StereoFrame;
use plumbline_flight::log::{Recorder, WhenFull};
use plumbline_lab::calibrate::camera::images::{Images, read};
use plumbline_lab::calibrate::camera::recording::read_log;
use plumbline_lab::calibrate::camera::result::Residual;
use plumbline_lab::calibrate::camera::{
    CalibrateError, Calibration, Detector, LENSES, Pair, Target, calibrate, output, table,
};
use plumbline_oracle::boards::{Board, BoardCamera, poses};
use plumbline_tests::shared;
use std::path::Path;

const OPENCV: Detector = Detector { markers, chessboard, refine };

fn pairs_of(folder: &Path, most: usize) -> Vec<Pair> {
    let images = Images::list(folder, most, false).unwrap();
    let read = |file: &Option<std::path::PathBuf>| file.as_deref().map(|file| read(file).unwrap());
    images
        .moments
        .iter()
        .map(|m| Pair { name: m.name.clone(), images: m.files.each_ref().map(read) })
        .collect()
}

fn lens_named(name: &str) -> Distortion {
    LENSES.iter().find(|(known, ..)| *known == name).unwrap().2
}

fn calibrated(pairs: &[Pair], target: &str, lens: &str) -> Result<Calibration, CalibrateError> {
    let result = calibrate(pairs, &target.parse().unwrap(), lens_named(lens), &OPENCV, &mut || {});
    if let Ok(calibration) = &result {
        println!("{}{}", table::views(calibration), table::figures(calibration).join("\n"));
    }
    result
}

/// Distances of focal lengths and principal point from others, px, the larger ones.
fn off_px(calibration: &Calibration, camera: usize, truth: &CameraModel) -> (f64, f64) {
    let found = calibration.cameras[camera].model;
    ((found.focal_px - truth.focal_px).amax(), (found.centre_px - truth.centre_px).amax())
}

#[test]
fn real_images_give_the_published_calibration() {
    let Some(root) = shared("euroc/aprilgrid") else { return };
    let pairs = pairs_of(&root.join("euroc/aprilgrid"), 60);
    assert_eq!(pairs.len(), 35);
    let calibration = calibrated(&pairs, "aprilgrid:6x6:0.088:0.3", "radtan").unwrap();
    let base = Config::preset("euroc").unwrap();
    let published = import::euroc_cameras_into(base.clone(), root.join("euroc/calibration")).unwrap();
    for camera in 0..2 {
        let (focal, centre) = off_px(&calibration, camera, &published.camera[camera].model());
        println!("cam{camera}: {focal:.2} {centre:.2} px off");
        assert!(focal < 1.5 && centre < 1.5, "cam{camera}: {focal} {centre} px");
    }
    assert!(calibration.rms_px < 0.26, "{} px", calibration.rms_px);
    let pair = calibration.pair.unwrap();
    assert!((pair.baseline_m - 0.11007).abs() < 0.0003, "{} m", pair.baseline_m);
    // What is written is a configuration that is flown with.
    let config = output::configuration(&base, &calibration, Some(20.0), "my.toml").unwrap();
    let text = output::text(&config, &calibration, "euroc/aprilgrid", "euroc").unwrap();
    let back = Config::from_toml_str(&text, "my.toml").unwrap();
    assert_eq!(back.camera, config.camera);
    let pose = |c: &Config| c.camera[0].pose_b_c().inverse() * c.camera[1].pose_b_c();
    let between = pose(&back).inverse() * pose(&published);
    assert!(between.rotation.angle() < 2e-3, "{} rad", between.rotation.angle());
}

#[test]
fn a_board_that_is_not_the_one_of_the_images_is_refused_with_the_cure() {
    let Some(root) = shared("euroc/aprilgrid") else { return };
    let pairs = pairs_of(&root.join("euroc/aprilgrid"), 7);
    let refusal = |pairs: &[Pair], target: &str| calibrated(pairs, target, "radtan").unwrap_err().to_string();
    for (target, cure) in [
        ("aprilgrid:6x6:0.088:0.15", "numbers of --target"),
        ("aprilgrid:5x6:0.088:0.3", "last is 29"),
        ("chessboard:9x6:0.03", "inner corners"),
        ("charuco:6x6:0.1:0.08", "kind of board"),
    ] {
        let message = refusal(&pairs, target);
        assert!(message.contains(cure) && message.contains(target), "{target}: {message}");
    }
    let few = refusal(&pairs[..3], "aprilgrid:6x6:0.088:0.3");
    assert!(few.contains("in 3 of 3 images") && few.contains("20 to 40"), "{few}");
}

fn camera(lens: &str, focal_px: [f64; 2], centre_px: [f64; 2], k: [f64; 4]) -> CameraModel {
    CameraModel {
        width_px: 640,
        height_px: 480,
        focal_px: Vector2::from(focal_px),
        centre_px: Vector2::from(centre_px),
        distortion: lens_named(lens).with_coefficients(&k),
    }
}

/// Pictures of a board by one camera, or by a second one beside it at `pose_c1_c0`.
fn pictures(
    board: &Board,
    cameras: &[CameraModel],
    pose_c1_c0: &Isometry3<f64>,
    poses_c0_t: &[Isometry3<f64>],
) -> Vec<Pair> {
    let cameras: Vec<BoardCamera> = cameras.iter().map(|model| BoardCamera::new(*model)).collect();
    let pair = |(k, pose): (usize, &Isometry3<f64>)| {
        let left = cameras[0].take(board, pose, 7 + k as u64);
        let right = cameras.get(1).map(|camera| camera.take(board, &(pose_c1_c0 * pose), 1007 + k as u64));
        Pair { name: format!("{k:03}"), images: [Some(left), right] }
    };
    poses_c0_t.iter().enumerate().map(pair).collect()
}

/// Focal lengths to a thousandth, the principal point to 0.3 px, and both within what the calibration says of itself.
fn assert_near(calibration: &Calibration, truth: &[CameraModel]) {
    for (index, truth) in truth.iter().enumerate() {
        let (focal, centre) = off_px(calibration, index, truth);
        println!("cam{index}: {focal:.3} {centre:.3} px off");
        assert!(focal < 1e-3 * truth.focal_px.min(), "cam{index}: {focal} px");
        assert!(centre < 0.3, "cam{index}: {centre} px");
    }
}

#[test]
fn a_rendered_pair_before_an_aprilgrid_is_calibrated_by_files_or_a_log() {
    let target: Target = "aprilgrid:6x6:0.088:0.3".parse().unwrap();
    let board = Board::print(target, true);
    let cameras = [
        camera("radtan", [402.3, 401.1], [322.7, 236.4], [-0.27, 0.065, 3e-4, -2e-4]),
        camera("radtan", [399.8, 400.6], [314.2, 243.9], [-0.26, 0.06, -2e-4, 1e-4]),
    ];
    let pose_c1_c0 = Isometry3::new(Vector3::new(-0.11, 0.001, -0.002), Vector3::new(0.012, -0.02, 0.004));
    let poses = poses(&cameras[0], &board, 0.75, 0.55, 14);
    let taken = pictures(&board, &cameras, &pose_c1_c0, &poses);
    let folder = tempfile::tempdir().unwrap();
    kept(&taken, folder.path());
    let pairs = pairs_of(folder.path(), 60);
    // Files and logs hold the same pixels, so what is made of them is the same.
    let logged = recorded(&taken, &cameras, folder.path());
    assert!(pairs.iter().map(|p| &p.images).eq(logged.iter().map(|p| &p.images)));
    let calibration = calibrated(&pairs, &target.to_string(), "radtan").unwrap();
    assert_near(&calibration, &cameras);
    let pair = calibration.pair.unwrap();
    let error = pair.pose_c0_c1 * pose_c1_c0;
    assert!(error.translation.vector.norm() < 2e-4 && error.rotation.angle() < 5e-4, "{error}");
    assert!(calibration.rms_px < 0.15 && calibration.views.len() == 14, "{} px", calibration.rms_px);
}

/// Writes the pictures as PNG files.
fn kept(taken: &[Pair], folder: &Path) {
    for (pair, camera) in taken.iter().flat_map(|pair| [(pair, 0), (pair, 1)]) {
        let (image, cam) = (pair.images[camera].as_ref().unwrap(), folder.join(format!("cam{camera}")));
        std::fs::create_dir_all(&cam).unwrap();
        let path = cam.join(format!("{}.png", pair.name));
        let pixels =
            Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.pixels());
        imwrite(path.to_str().unwrap(), &pixels.unwrap(), &Vector::new()).unwrap();
    }
}

/// A configuration with cameras of these sizes that records their images.
fn rig(cameras: &[CameraModel]) -> ValidConfig {
    let change = |config: &mut Config| {
        for (camera, model) in config.camera.iter_mut().zip(cameras) {
            (camera.width_px, camera.height_px) = (model.width_px, model.height_px);
            (camera.focal_px, camera.centre_px) = (model.focal_px.into(), model.centre_px.into());
        }
        config.recorder.images = ImageRecording::Png;
    };
    Config::preset("sim").unwrap().with("test", change).unwrap()
}

/// Returns the pictures as read back from a flight log.
fn recorded(taken: &[Pair], cameras: &[CameraModel], folder: &Path) -> Vec<Pair> {
    let (config, log) = (rig(cameras), folder.join("log.mcap"));
    let recorder = Recorder::start(&log, &config, (None, 0), WhenFull::Wait).unwrap();
    for (k, pair) in taken.iter().enumerate() {
        let images = pair.images.each_ref().map(|image| image.clone().unwrap());
        let stamp = Timestamp::from_nanos(50_000_000 * k as i64);
        let mut frame = StereoFrame { sequence: k as u64, stamp, images, valid: [true; 2] };
        assert!(recorder.handle().offer_frame(&mut frame));
    }
    assert_eq!(recorder.finish().not_recorded, 0);
    let recorded = read_log(&log, 60, false).unwrap();
    assert_eq!(recorded.total, taken.len());
    recorded.pairs
}

#[test]
fn a_rendered_camera_before_a_charuco_board_is_calibrated() {
    let target: Target = "charuco:9x6:0.06:0.045:5X5_100".parse().unwrap();
    let lens = camera("radtan", [452.0, 453.4], [310.2, 247.1], [0.05, -0.08, 5e-4, -3e-4]);
    for black_first in [true, false] {
        let board = Board::print(target, black_first);
        let poses = poses(&lens, &board, 0.5, 0.55, 20);
        let pairs = pictures(&board, &[lens], &Isometry3::identity(), &poses);
        let calibration = calibrated(&pairs, &target.to_string(), "radtan").unwrap();
        assert_near(&calibration, &[lens]);
    }
}

#[test]
fn a_rendered_fisheye_before_an_aprilgrid_is_calibrated() {
    let target: Target = "aprilgrid:6x6:0.088:0.3".parse().unwrap();
    let board = Board::print(target, true);
    let lens = camera("equidistant", [231.5, 230.9], [317.4, 242.3], [-0.012, 0.008, -0.004, 0.001]);
    let poses = poses(&lens, &board, 0.42, 0.5, 14);
    let pairs = pictures(&board, &[lens], &Isometry3::identity(), &poses);
    let calibration = calibrated(&pairs, &target.to_string(), "equidistant").unwrap();
    assert_near(&calibration, &[lens]);
}

#[test]
fn a_rendered_pair_before_a_chessboard_is_calibrated_and_opencv_agrees() {
    let target: Target = "chessboard:9x6:0.05".parse().unwrap();
    let board = Board::print(target, true);
    let cameras = [
        camera("radtan", [430.0, 431.0], [325.0, 236.0], [-0.1, 0.03, 0.0, 0.0]),
        camera("radtan", [428.0, 429.5], [312.0, 244.0], [-0.12, 0.04, 1e-4, 0.0]),
    ];
    let pose_c1_c0 = Isometry3::new(Vector3::new(-0.06, 0.0, 0.001), Vector3::new(0.0, 0.01, -0.003));
    let poses = poses(&cameras[0], &board, 0.68, 0.55, 22);
    let pairs = pictures(&board, &cameras, &pose_c1_c0, &poses);
    let calibration = calibrated(&pairs, &target.to_string(), "radtan").unwrap();
    assert_near(&calibration, &cameras);
    let error = calibration.pair.unwrap().pose_c0_c1 * pose_c1_c0;
    assert!(error.translation.vector.norm() < 3e-4 && error.rotation.angle() < 1e-3, "{error}");
    // The left camera by itself, and by OpenCV of the same corners.
    let left: Vec<Pair> = pairs
        .into_iter()
        .map(|p| {
            let [left, _] = p.images;
            Pair { images: [left, None], ..p }
        })
        .collect();
    let alone = calibrated(&left, &target.to_string(), "radtan").unwrap();
    let (rms_px, model) = by_opencv(&target, &alone);
    assert!((alone.rms_px - rms_px).abs() < 1e-3, "{} {rms_px}", alone.rms_px);
    let (focal, centre) = off_px(&alone, 0, &model);
    assert!(focal < 0.02 && centre < 0.02, "{focal} {centre}");
}

/// OpenCV's calibration by the corners that ours is by.
fn by_opencv(target: &Target, calibration: &Calibration) -> (f64, CameraModel) {
    let points = target.corners_m();
    let (mut objects, mut images) = (Vector::<Vector<Point3f>>::new(), Vector::<Vector<Point2f>>::new());
    let mut rest = calibration.cameras[0].residuals.as_slice();
    for view in &calibration.views {
        let (corners, others) = rest.split_at(view.corners[0]);
        let point = |r: &Residual| Point3f::new(points[r.number].x as f32, points[r.number].y as f32, 0.0);
        objects.push(corners.iter().map(point).collect());
        images.push(corners.iter().map(|r| Point2f::new(r.px.x as f32, r.px.y as f32)).collect());
        rest = others;
    }
    let (mut k, mut d) = (Mat::default(), Mat::default());
    let (mut rotations, mut translations) = (Vector::<Mat>::new(), Vector::<Mat>::new());
    let model = calibration.cameras[0].model;
    let size = Size::new(model.width_px as i32, model.height_px as i32);
    let stop = TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32;
    let rms_px = opencv::calib3d::calibrate_camera(
        &objects,
        &images,
        size,
        &mut k,
        &mut d,
        &mut rotations,
        &mut translations,
        opencv::calib3d::CALIB_FIX_K3,
        TermCriteria::new(stop, 200, 1e-12).unwrap(),
    )
    .unwrap();
    let at = |i: i32, j: i32| *opencv::prelude::MatTraitConst::at_2d::<f64>(&k, i, j).unwrap();
    let focal_px = Vector2::new(at(0, 0), at(1, 1));
    (rms_px, CameraModel { focal_px, centre_px: Vector2::new(at(0, 2), at(1, 2)), ..model })
}
