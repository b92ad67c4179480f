//! The real clips: a rig at rest in stereo, a flight with one camera.

use plumbline::flight::{fly, open_dataset};
use plumbline::pipeline::{Control, RunOptions};
use plumbline::report::Report;
use plumbline_tests::shared;

const OPTIONS: RunOptions = RunOptions { speed: None, threads: 2 };

#[test]
fn at_rest_nothing_drifts() {
    let Some(shared) = shared("euroc/V1_01_easy_clip") else { return };
    let flight = open_dataset(&shared.join("euroc/V1_01_easy_clip"), None, None, false).unwrap();
    let flown = fly(flight, &OPTIONS, &Control::default(), vec![]).unwrap();
    let (report, poses) = (Report::new(&flown), &flown.poses);
    assert!(poses.len() >= 90, "{} poses of {} frames", poses.len(), report.frames);
    assert_eq!(report.resets, 0);
    let (first, last) = (&poses[0].pose_o_b, &poses[poses.len() - 1].pose_o_b);
    let drift_m = (last.translation.vector - first.translation.vector).norm();
    let drift_deg = first.rotation.angle_to(&last.rotation).to_degrees();
    println!("{} poses, drift {drift_m:.5} m and {drift_deg:.4} degrees", poses.len());
    assert!(drift_m <= 0.005 && drift_deg <= 0.2);
}

#[test]
fn one_camera_in_flight_finds_scale_and_keeps_it_with_and_without_lines() {
    let Some(shared) = shared("euroc/MH_05_mono_clip") else { return };
    let [with, without] = [true, false].map(|lines| {
        let mut flight = open_dataset(&shared.join("euroc/MH_05_mono_clip"), None, None, true).unwrap();
        flight.config = flight.config.with("test", |c| c.estimator.lines.enabled = lines).unwrap();
        let flown = fly(flight, &OPTIONS, &Control::default(), vec![]).unwrap();
        keeps_scale(&Report::new(&flown))
    });
    assert!(with <= without, "lines make it worse: {with:.4} m, without {without:.4} m");
}

/// The ATE of a sound flight with one camera, m.
fn keeps_scale(report: &Report) -> f64 {
    let accuracy = report.accuracy.as_ref().unwrap();
    println!("ATE {:.4} m, scale error {:+.2} %", accuracy.ate_rmse_m, accuracy.scale_error_percent);
    assert_eq!(report.resets, 0);
    assert!(report.first_pose_s.unwrap() <= 2.0);
    assert!(accuracy.ate_rmse_m <= 0.09);
    assert!(accuracy.scale_error_percent.abs() <= 2.0);
    accuracy.ate_rmse_m
}
