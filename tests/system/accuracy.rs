//! Simulated flights along real trajectories stay within their limits.

use plumbline_lab::campaign::{CampaignFault, Entry, Setup};
use plumbline_lab::report::Report;
use plumbline_simulator::Scene;
use plumbline_tests::entry;

/// Flies `path` for ten seconds and checks what a sound flight keeps. Yaw drift per minute and the NEES that is
/// asked for (0.3 to 3 times its expectation) are those of whole minutes: see `soak.rs`. In the first seconds
/// the covariance is wider than the errors, so the lower bound here only guards against getting worse.
fn flies(path: &str, scene: (&'static str, Scene), max_ate_percent: f64) {
    let Some(entry) = entry(path, scene, 1, 10.0, CampaignFault::None) else { return };
    let report = entry.fly(None, false, None, 2).unwrap();
    println!("{}", entry.row(&report));
    let accuracy = report.accuracy.as_ref().unwrap();
    assert_eq!(report.resets, 0);
    assert!(report.completion >= 0.98, "completion {}", report.completion);
    assert!(report.first_pose_s.unwrap() < 1.0);
    assert!(accuracy.ate_percent < max_ate_percent, "ATE {} %", accuracy.ate_percent);
    let nees = accuracy.nees_ratio.unwrap();
    assert!((0.1..3.0).contains(&nees), "NEES {nees} of its expectation");
    assert_eq!(report.hot_path_allocations, 0);
}

#[test]
fn in_a_textured_room() {
    flies("V1_02_medium", ("room", Scene::Room), 0.08);
}

#[test]
fn in_a_large_hall() {
    flies("V2_02_medium", ("hall", Scene::Hall), 0.08);
}

#[test]
fn almost_without_texture() {
    flies("V1_03_difficult", ("low-texture", Scene::LowTexture), 0.2);
}

/// Lines lower the error where points are few: the same flight with and without them. The gain over several minutes is measured
/// in `soak.rs`; a single flight scatters too much for that.
#[test]
fn lines_lower_the_error_where_texture_is_missing() {
    let Some(entry) = entry("V1_02_medium", ("low-texture", Scene::LowTexture), 1, 20.0, CampaignFault::None)
    else {
        return;
    };
    let [with, without] = with_and_without_lines(&entry);
    let ate_m = |report: &Report| report.ate_rmse_m.unwrap();
    println!("ATE {:.4} m with lines, {:.4} m without", ate_m(&with), ate_m(&without));
    assert!(with.lines.in_window > 20.0 && without.lines.in_window == 0.0);
    assert!(ate_m(&with) < ate_m(&without));
    assert_eq!(with.hot_path_allocations, 0);
}

/// Flies the flight with and without lines; its frames are rendered once.
pub(crate) fn with_and_without_lines(entry: &Entry) -> [Report; 2] {
    let cache = tempfile::tempdir().unwrap();
    ["true", "false"].map(|enabled| {
        let overrides = vec![format!("estimator.lines.enabled={enabled}")];
        let cache = Some(cache.path().to_owned());
        let setup = Setup { config: None, overrides, mono: false, cache, threads: 2 };
        entry.fly_as(&setup).unwrap()
    })
}
