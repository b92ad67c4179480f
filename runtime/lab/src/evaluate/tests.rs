//! Tests of the way as a whole.

use super::noise::Noise;
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
        assert!(result.ate_m.max < 1e-9 && result.ate_rotation_deg.max < 1e-5, "{result:?}");
        assert!((result.completion - 1.0).abs() < 1e-12);
        assert!(result.yaw_drift_deg_per_min.unwrap().abs() < 1e-9);
        assert!(result.scale_error_percent.unwrap().abs() < 1e-9);
        assert!(result.drift.unwrap().translation_percent < 1e-9);
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
    assert!(load_trajectory(&dir.path().join("none.tum")).unwrap_err().to_string().contains("none.tum"));
}

#[test]
fn too_little_in_common_is_an_error() {
    let reference = flight(100);
    let error = evaluate(&reference[..2], &reference, &EvaluateOptions::default()).unwrap_err();
    assert!(matches!(error, EvaluateError::TooFew { found: 2, needed: 3 }), "{error}");
}
