//! Equal input gives equal bits: again, under load, and with another number of threads.

use plumbline_flight::flight::fly;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_simulator::{Scenario, Scene};
use plumbline_tests::simulated;
use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};

fn digests(seed: u64, threads: usize) -> (String, String) {
    let scenario = Scenario {
        scene: Scene::Room,
        start_s: 2.0,
        duration_s: 3.0,
        seed,
        resolution_scale: 0.5,
        ..Scenario::default()
    };
    let flight = simulated(&scenario);
    let options = RunOptions { speed: None, threads };
    let flown = fly(flight, &options, &Control::default(), vec![]).unwrap();
    assert!(10 * flown.poses.len() as u64 > 9 * flown.outcome.figures.frames);
    (flown.outcome.estimate_digest, flown.outcome.odometry_digest)
}

#[test]
fn two_executions_agree_with_other_threads_and_under_load() {
    let first = digests(1, 1);
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let mut x = 1u64;
                while !stop.load(Ordering::Relaxed) {
                    x = black_box(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
                }
            });
        }
        let loaded = digests(1, 2);
        stop.store(true, Ordering::Relaxed);
        assert_eq!(first, loaded);
    });
    assert_ne!(first, digests(2, 1), "another seed must give another answer");
}
