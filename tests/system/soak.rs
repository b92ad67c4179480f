//! Long flights, run by `make soak`: rates per minute and consistency need more than the seconds of the
//! other tests.

use super::accuracy::with_and_without_lines;
use plumbline_flight::flight::open_simulation;
use plumbline_simulator::{Scenario, Scene};
use plumbline_test_support::{SOAK_IN_FULL_MIN, soak_minutes};
use plumbline_tests::{along, reported};

/// Trajectories.
const PATHS: [&str; 4] = ["V1_02_medium", "V2_02_medium", "MH_04_difficult", "V1_03_difficult"];
/// Scenes, each with the largest error over the path, percent.
const SCENES: [(Scene, f64); 3] = [(Scene::Room, 0.08), (Scene::Hall, 0.08), (Scene::LowTexture, 0.2)];

/// Each built-in trajectory in each scene for a minute, with the limits of the README.
#[test]
#[ignore = "a quarter of an hour; run by `make soak`"]
fn soak_a_minute_of_flight_keeps_heading_and_covariance() {
    let mut failures = Vec::new();
    // A short soak flies every trajectory and every scene, but not every one in every other.
    let is_flown = |k: usize| soak_minutes() >= SOAK_IN_FULL_MIN || k.is_multiple_of(2);
    for (i, (scene, max_ate_percent)) in SCENES.into_iter().enumerate() {
        for (_, path) in PATHS.into_iter().enumerate().filter(|(j, _)| is_flown(i + j)) {
            let Some(scenario) = along(path, scene, 60.0) else { return };
            let scenario = Scenario { resolution_scale: 1.0, ..scenario };
            let report = reported(open_simulation(None, &scenario, false, 0.0, None).unwrap());
            let accuracy = report.accuracy.as_ref().unwrap();
            let yaw = accuracy.yaw_drift_deg_per_min.unwrap();
            let nees = accuracy.nees_ratio.unwrap();
            let checks = [
                (report.resets == 0, "resets".to_owned()),
                (yaw.abs() <= 0.2, format!("yaw {yaw:.2} deg/min")),
                ((0.3..=3.0).contains(&nees), format!("NEES {nees:.2}")),
                (accuracy.ate_percent <= max_ate_percent, format!("ATE {:.3} %", accuracy.ate_percent)),
            ];
            let missed = checks.into_iter().filter(|(holds, _)| !holds);
            failures.extend(missed.map(|(_, what)| format!("{path} in {scene:?}: {what}")));
        }
    }
    assert!(failures.is_empty(), "missed: {failures:#?}");
}

/// Over the four trajectories without texture lines take at least 30 % off the error.
#[test]
#[ignore = "minutes; run by `make soak`"]
fn soak_lines_lower_the_error_by_a_third_where_texture_is_missing() {
    let mut sums_m = [0.0; 2];
    for path in PATHS {
        let Some(scenario) = along(path, Scene::LowTexture, 60.0) else { return };
        let scenario = Scenario { resolution_scale: 1.0, ..scenario };
        for (sum_m, report) in sums_m.iter_mut().zip(with_and_without_lines(&scenario)) {
            *sum_m += report.ate_rmse_m.unwrap();
        }
    }
    println!("ATE {:.4} m with lines, {:.4} m without, sums of four", sums_m[0], sums_m[1]);
    assert!(sums_m[0] <= 0.7 * sums_m[1]);
}
