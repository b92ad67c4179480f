//! Simulated flights along real trajectories stay within their limits.

use plumbline_flight::flight::open_simulation;
use plumbline_lab::report::Report;
use plumbline_simulator::{Scenario, Scene};
use plumbline_tests::{along, reported};

/// Flies `path` for ten seconds, twice, and checks what a sound flight keeps. Yaw drift per minute and the NEES that is
/// asked for (0.3 to 3 times its expectation) are those of whole minutes: see `soak.rs`. In the first seconds
/// the covariance is wider than the errors, so the lower bound here only guards against getting worse; by the mean, since an error
/// that is small by chance is no modesty.
fn flies(path: &str, scene: Scene, max_ate_percent: f64) {
    let Some(scenario) = along(path, scene, 10.0) else { return };
    let of_seeds = [1, 2].map(|seed| {
        let scenario = Scenario { seed, ..scenario.clone() };
        let report = reported(open_simulation(None, &scenario, false, 0.0, None).unwrap());
        let accuracy = report.accuracy.as_ref().unwrap();
        assert_eq!(report.resets, 0);
        assert!(report.completion >= 0.98, "completion {}", report.completion);
        assert!(report.first_pose_s.unwrap() < 1.0);
        assert!(accuracy.ate_percent < max_ate_percent, "ATE {} %", accuracy.ate_percent);
        assert_eq!(report.hot_path_allocations, 0);
        accuracy.nees_ratio.unwrap()
    });
    let nees = (of_seeds[0] + of_seeds[1]) / 2.0;
    assert!(of_seeds.iter().all(|nees| *nees < 3.0) && nees > 0.1, "NEES {of_seeds:?} of its expectation");
}

#[test]
fn in_a_textured_room() {
    flies("V1_02_medium", Scene::Room, 0.08);
}

#[test]
fn in_a_large_hall() {
    flies("V2_02_medium", Scene::Hall, 0.08);
}

#[test]
fn almost_without_texture() {
    flies("V1_03_difficult", Scene::LowTexture, 0.2);
}

/// Lines lower the error where points are few: the same flight with and without them. The gain over several minutes is measured
/// in `soak.rs`; a single flight scatters too much for that.
#[test]
fn lines_lower_the_error_where_texture_is_missing() {
    let Some(scenario) = along("V1_02_medium", Scene::LowTexture, 20.0) else { return };
    let [with, without] = with_and_without_lines(&scenario);
    let ate_m = |report: &Report| report.ate_rmse_m.unwrap();
    println!("ATE {:.4} m with lines, {:.4} m without", ate_m(&with), ate_m(&without));
    assert!(with.lines["in_window"] > 20.0 && without.lines["in_window"] == 0.0);
    assert!(ate_m(&with) < ate_m(&without));
    assert_eq!(with.hot_path_allocations, 0);
}

/// Flies the flight with and without lines; its frames are rendered once.
pub(crate) fn with_and_without_lines(scenario: &Scenario) -> [Report; 2] {
    let cache = tempfile::tempdir().unwrap();
    [true, false].map(|enabled| {
        let mut flight = open_simulation(None, scenario, false, 0.0, Some(cache.path())).unwrap();
        flight.config = flight.config.with("test", |c| c.estimator.lines.enabled = enabled).unwrap();
        reported(flight)
    })
}
