//! Faults of the pair of cameras, of its calibration, and of data that repeat.

use super::{ALL, Data, FEW, FlightPath, assert_found, flight, lively, measure, simulated, told};
use crate::scale;
use crate::{CheckupReport, Fitness, NAMED_ABOVE};
use plumbline_config::camera::Distortion;
use plumbline_config::options::{CameraConfig, rows_from_isometry};

/// Another distance between the cameras than the one that the images were taken with.
fn scaled(factor: f64) -> impl FnOnce(&mut Data) {
    move |data| {
        let from = data.config.camera[0].pose_b_c().translation.vector;
        let mut pose = data.config.camera[1].pose_b_c();
        pose.translation.vector = from + (pose.translation.vector - from) * factor;
        data.config.camera[1].pose_b_c = rows_from_isometry(&pose);
    }
}

#[test]
fn a_wrong_baseline_is_told_with_its_factor_and_the_repaired_line() {
    let Some(lively) = lively() else { return };
    let right = measure(&lively.report(), scale::NAME).clone();
    assert_eq!(right.verdict, Fitness::Good, "{}", right.value);
    for factor in [2.0, 0.5, 1.1] {
        let report = lively.with(scaled(factor)).report();
        assert_found(&report, scale::NAME, Fitness::NotFit, "set `pose_b_c = [[");
        let found = measure(&report, scale::NAME);
        let told_factor = found.figure("factor").unwrap();
        assert!((told_factor / factor - 1.0).abs() < 0.03, "{factor}: {}", told(&report));
        // The line that is given is the one that was right.
        let line = found.cure.split("pose_b_c = ").nth(1).unwrap().split('`').next().unwrap();
        let expected = lively.config.camera[1].pose_b_c;
        for (told, expected) in matrix(line).iter().flatten().zip(expected.iter().flatten()) {
            assert!((told - expected).abs() < 5e-3, "{line}");
        }
    }
}

/// A matrix as it stands in a configuration.
fn matrix(line: &str) -> Vec<Vec<f64>> {
    let rows = line.trim_start_matches("[[").trim_end_matches("]]").split("], [");
    rows.map(|row| row.split(", ").map(|value| value.parse().unwrap()).collect()).collect()
}

/// One camera late by so many frames under the stamps of the other.
fn late(camera: usize, frames: usize) -> impl FnOnce(&mut Data) {
    move |data| {
        for k in (frames..data.frames.len()).rev() {
            data.frames[k].2[camera] = data.frames[k - frames].2[camera].clone();
        }
    }
}

#[test]
fn a_camera_that_is_late_by_frames_is_told_with_its_side() {
    let Some(lively) = lively() else { return };
    for (camera, frames, words) in [
        (1, 1, "the right camera is late by 1 frame "),
        (0, 1, "the left camera is late by 1 frame "),
        (1, 3, "the right camera is late by 3 frames"),
    ] {
        let report = lively.with(late(camera, frames)).report();
        assert_found(&report, "epipolar error", Fitness::NotFit, words);
        assert_eq!(measure(&report, "time offset").cure, NAMED_ABOVE, "{}", told(&report));
        assert_eq!(measure(&report, scale::NAME).cure, NAMED_ABOVE, "{}", told(&report));
    }
}

/// The coefficients of the true lens model under the name of the other one.
fn other_model(camera: &mut CameraConfig) {
    camera.distortion = match camera.distortion {
        Distortion::RadialTangential { k1, k2, p1, p2 } => Distortion::Equidistant { k1, k2, k3: p1, k4: p2 },
        Distortion::Equidistant { k1, k2, k3, k4 } => Distortion::RadialTangential { k1, k2, p1: k3, p2: k4 },
        lens => panic!("the rig has a lens of four coefficients, no {lens:?}"),
    };
}

#[test]
fn a_wrong_lens_model_is_named_and_no_time_offset_is_advised() {
    let seen = flight(ALL);
    let wrong = seen.with(|data| data.config.camera.iter_mut().for_each(other_model));
    let report = wrong.report();
    assert_found(&report, "epipolar error", Fitness::NotFit, "lens model");
    assert!(!told(&report).contains("set `rig.time_offset_s"), "{}", told(&report));
    // One of the two cameras alone, and a lens said to be without distortion.
    let one = seen.with(|data| other_model(&mut data.config.camera[1])).report();
    assert_found(&one, "epipolar error", Fitness::NotFit, "lens model");
    let none = seen.with(|data| {
        data.config.camera.iter_mut().for_each(|camera| {
            camera.distortion = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 }
        });
    });
    assert_found(&none.report(), "epipolar error", Fitness::NotFit, "lens model");
}

#[test]
fn images_and_samples_that_repeat_are_told_with_their_keys() {
    let twice = flight(ALL).with(|data| {
        for k in (1..data.frames.len()).step_by(2) {
            data.frames[k].2 = data.frames[k - 1].2.clone();
        }
    });
    let report = twice.report();
    assert_found(&report, "repeated data", Fitness::NotFit, "refuse_repeated_images");
    assert_eq!(measure(&report, "time offset").verdict, Fitness::NotMeasured, "{}", told(&report));
    let held = flight(0).with(|data| {
        let first = data.samples[0].1;
        data.samples[..400].iter_mut().for_each(|(_, sample)| {
            (sample.gyro, sample.accel) = (first.gyro, first.accel);
        });
    });
    assert_found(&held.report(), "repeated data", Fitness::NotFit, "imu.stuck_after_s");
    assert!(flight(FEW).report().measure("repeated data").is_none());
}

/// A rig whose two cameras are calibrated with focal lengths that are wrong by a factor, and with principal points moved by px.
fn misjudged(data: &Data, focal: f64, moved_px: [f64; 2]) -> CheckupReport {
    let wrong = data.with(|data| {
        for camera in &mut data.config.camera {
            camera.focal_px = camera.focal_px.map(|px| px * focal);
            camera.centre_px = [0, 1].map(|k| camera.centre_px[k] + moved_px[k]);
        }
    });
    wrong.report()
}

#[test]
fn focal_lengths_that_are_off_are_named_and_no_time_offset_is_advised() {
    let Some(lively) = lively() else { return };
    for (factor, words) in [(1.1, "too long"), (0.9, "too short")] {
        let report = misjudged(&lively, factor, [0.0; 2]);
        println!("{factor}\n{}", told(&report));
        assert_found(&report, "focal length", Fitness::NotFit, words);
        assert!(!told(&report).contains("set `rig.time_offset_s"), "{}", told(&report));
        assert!(!measure(&report, scale::NAME).cure.contains("set `pose_b_c"), "{}", told(&report));
    }
}

#[test]
fn little_turning_leaves_focal_lengths_open_and_advises_no_time_offset() {
    let calm = simulated(FlightPath::Demo, 0.0, 14.0, ALL);
    for factor in [0.9, 0.95, 1.05, 1.1] {
        let report = misjudged(&calm, factor, [0.0; 2]);
        println!("{factor}\n{}", told(&report));
        assert_ne!(measure(&report, "focal length").verdict, Fitness::Good, "{factor}: {}", told(&report));
        assert!(!told(&report).contains("set `rig.time_offset_s"), "{factor}: {}", told(&report));
    }
}

#[test]
fn principal_points_that_are_off_are_named_and_no_time_offset_is_advised() {
    let Some(lively) = lively() else { return };
    for (moved_px, name) in [
        ([20.0, 0.0], "camera-IMU rotation"),
        ([-20.0, 0.0], "camera-IMU rotation"),
        ([0.0, 20.0], "epipolar error"),
    ] {
        let report = misjudged(&lively, 1.0, moved_px);
        println!("{moved_px:?}\n{}", told(&report));
        assert_found(&report, name, Fitness::Mind, "camera.centre_px");
        assert!(!told(&report).contains("set `rig.time_offset_s"), "{}", told(&report));
    }
}
