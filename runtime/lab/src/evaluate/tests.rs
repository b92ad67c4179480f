//! Tests of the way as a whole.

use super::test_noise::Noise;
use super::*;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_drivers::tum::write_tum;

fn flight(n: i64) -> Vec<StampedPose> {
    (0..n)
        .map(|i| {
            let a = i as f64 * 0.05;
            let position = Vector3::new(3.0 * a.cos(), 2.0 * a.sin(), 0.5 * (2.0 * a).sin());
            let pose = Isometry3::new(position, Vector3::new(0.1 * a.sin(), 0.0, 0.3 * a));
            StampedPose { stamp: Timestamp::from_nanos(i * 50_000_000), pose }
        })
        .collect()
}

#[test]
fn a_perfect_estimate_in_another_frame_has_no_error() {
    let reference = flight(400);
    let frame = Isometry3::new(Vector3::new(5.0, -3.0, 1.0), Vector3::z() * 2.0);
    let estimate: Vec<StampedPose> =
        reference.iter().map(|p| StampedPose { pose: frame * p.pose, ..*p }).collect();
    for alignment in [AlignmentMode::Origin, AlignmentMode::Yaw, AlignmentMode::Se3, AlignmentMode::Sim3] {
        let result =
            evaluate(&estimate, &reference, &EvaluateOptions { alignment, ..Default::default() }).unwrap();
        assert!(result.ate_m.max < 1e-9 && result.ate_rotation_deg.unwrap().max < 1e-5, "{result:?}");
        assert!((result.completion - 1.0).abs() < 1e-12);
        assert!(result.yaw_drift_deg_per_min.unwrap().abs() < 1e-9);
        assert!(result.scale_error_percent.unwrap().abs() < 1e-9);
        assert_eq!(result.rpe.unwrap().translation_m.count, 399);
    }
}

#[test]
fn scale_and_noise_are_measured() {
    let reference = flight(2000);
    let mut noise = Noise::new(3);
    let mut estimate = reference.clone();
    for p in &mut estimate {
        p.pose.translation.vector *= 1.03;
        p.pose.translation.vector += Vector3::from_fn(|_, _| 0.01 * noise.normal());
        p.pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| 0.01 * noise.normal()));
    }
    let options =
        EvaluateOptions { alignment: AlignmentMode::Sim3, delta: Delta::Metres(1e6), ..Default::default() };
    let result = evaluate(&estimate, &reference, &options).unwrap();
    assert!((result.scale_error_percent.unwrap() - 3.0).abs() < 0.05, "{result:?}");
    assert!((result.ate_m.rmse - 0.01 * 3.0_f64.sqrt() / 1.03).abs() < 1e-3, "{result:?}");
    assert_eq!(result.rpe, None);
}

/// The error of a wrong scale is one of the scale, however large it is.
#[test]
fn scales_that_are_far_off_are_told_and_hide_no_rotation_error() {
    let reference = flight(400);
    for factor in [0.5, 1.4, 2.0, 3.0] {
        let scaled = |p: &StampedPose| {
            let mut pose = p.pose;
            pose.translation.vector *= factor;
            StampedPose { pose, ..*p }
        };
        let estimate: Vec<_> = reference.iter().map(scaled).collect();
        let result = evaluate(&estimate, &reference, &EvaluateOptions::default()).unwrap();
        let scale = result.scale_error_percent.unwrap();
        assert!((scale - 100.0 * (factor - 1.0)).abs() < 0.1, "{factor}: {scale}");
        assert!(result.ate_rotation_deg.unwrap().max < 1e-3, "{factor}");
    }
}

/// At rest the positions are noise, and no rotation or scale is to be had from them.
#[test]
fn a_standing_vehicle_has_no_rotation_error_by_positions_and_no_scale_error() {
    let mut noise = Noise::new(5);
    let stand = |millimetres: f64, noise: &mut Noise| -> Vec<StampedPose> {
        let moved = |p: &StampedPose| {
            let p_m = Vector3::from_fn(|_, _| 1e-3 * millimetres * noise.normal());
            StampedPose { pose: Isometry3::new(p_m, Vector3::z() * 0.3), ..*p }
        };
        flight(400).iter().map(moved).collect()
    };
    let (reference, estimate) = (stand(1.0, &mut noise), stand(3.0, &mut noise));
    let result = evaluate(&estimate, &reference, &EvaluateOptions::default()).unwrap();
    assert_eq!((result.ate_rotation_deg, result.scale_error_percent), (None, None));
    assert!(result.ate_m.rmse < 0.006, "{result:?}");
    let by_first = EvaluateOptions { alignment: AlignmentMode::Origin, ..EvaluateOptions::default() };
    let result = evaluate(&estimate, &reference, &by_first).unwrap();
    assert!(result.ate_rotation_deg.unwrap().max < 1e-5, "{result:?}");
}

#[test]
fn a_flight_by_another_clock_is_compared_by_a_shift_given_or_found() {
    // Ever faster: a motion that repeats itself agrees at several shifts.
    let (steady, stamps) = (flight(900), flight(400));
    let pose_at = |i: usize| steady[i + i * i / 800].pose;
    let reference: Vec<StampedPose> =
        stamps.iter().enumerate().map(|(i, p)| StampedPose { pose: pose_at(i), ..*p }).collect();
    let estimate: Vec<StampedPose> =
        reference.iter().map(|p| StampedPose { stamp: p.stamp.plus_seconds(-1234.5), ..*p }).collect();
    let none = evaluate(&estimate, &reference, &EvaluateOptions::default());
    assert!(none.unwrap_err().to_string().ends_with("give the shift with --time-offset"));
    let options = EvaluateOptions { time_offset_s: 1234.5, ..Default::default() };
    let given = evaluate(&estimate, &reference, &options).unwrap();
    assert!(given.ate_m.max < 1e-9 && given.associated == 400, "{given:?}");
}

#[test]
fn trajectories_are_loaded_from_files_tables_and_data_sets() {
    let dir = tempfile::tempdir().unwrap();
    let tum = dir.path().join("a.tum");
    write_tum(&tum, &flight(5)).unwrap();
    assert_eq!(load_trajectory(&tum).unwrap().len(), 5);
    let message = load_trajectory(dir.path()).unwrap_err().to_string();
    assert!(message.contains("holds no mav0/state_groundtruth_estimate0"), "{message}");
    let table = dir.path().join("mav0/state_groundtruth_estimate0");
    std::fs::create_dir_all(&table).unwrap();
    std::fs::write(table.join("data.csv"), "#t,...\n5,1,2,3,1,0,0,0\n6,1,2,4,1,0,0,0\n").unwrap();
    for path in [dir.path().to_path_buf(), table.join("data.csv")] {
        assert_eq!(load_trajectory(&path).unwrap()[1].pose.translation.z, 4.0);
    }
    // As TUM-VI has it, and a motion capture whose markers are half a metre above the body.
    std::fs::rename(&table, dir.path().join("mav0/mocap0")).unwrap();
    assert_eq!(load_trajectory(dir.path()).unwrap()[1].pose.translation.z, 4.0);
    std::fs::rename(dir.path().join("mav0/mocap0"), dir.path().join("mav0/vicon0")).unwrap();
    let sensor = "%YAML:1.0\nsensor_type: pose\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1,0,0,0, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]\n";
    std::fs::write(dir.path().join("mav0/vicon0/sensor.yaml"), sensor).unwrap();
    assert_eq!(load_trajectory(dir.path()).unwrap()[1].pose.translation.z, 3.5);
    std::fs::rename(dir.path().join("mav0/vicon0"), dir.path().join("mav0/leica0")).unwrap();
    let message = load_trajectory(dir.path()).unwrap_err().to_string();
    assert!(message.contains("leica0/data.csv, which holds positions without attitudes"), "{message}");
    assert!(load_trajectory(&dir.path().join("none.tum")).unwrap_err().to_string().contains("none.tum"));
}

#[test]
fn too_little_in_common_is_an_error() {
    let reference = flight(100);
    let error = evaluate(&reference[..2], &reference, &EvaluateOptions::default()).unwrap_err();
    assert!(matches!(error, EvaluateError::TooFew { found: 2, needed: 3 }), "{error}");
}
