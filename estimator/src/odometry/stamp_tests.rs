//! Stamps that are off by milliseconds cost little, are no fault of a sensor, and are what the covariance says.

use super::synthetic::{World, config};
use super::trust_tests::{Judged, NONE, Trouble, fly};
use crate::estimate::HealthBits;

const SEEDS: [u64; 2] = [1, 2];
/// The bits that name a sensor.
const NAMES: [HealthBits; 4] = [
    HealthBits::GYRO_CONTRADICTED,
    HealthBits::ROTATION_DISPUTED,
    HealthBits::IMU_LATE,
    HealthBits::IMAGES_LATE,
];

/// A number of mean 0 and standard deviation 1 that belongs to the time `t`.
fn drawn(t: f64) -> f64 {
    let hash =
        ((t * 20.0).round() as u32).wrapping_mul(2_654_435_761).rotate_left(11).wrapping_mul(2_246_822_519)
            >> 8;
    (f64::from(hash) / f64::from(1 << 24) - 0.5) * 12.0_f64.sqrt()
}

fn flown(seed: u64, age_s: fn(f64) -> Option<f64>) -> Vec<Judged> {
    fly(&mut World::new(&config(2), seed, 500), 10.0, &Trouble { age_s: &age_s, ..NONE })
}

/// Largest error of the position after the first seconds, m.
fn worst_m(judged: &[Judged]) -> f64 {
    judged.iter().filter(|pose| pose.time_s > 3.0).map(|pose| pose.error_m).fold(0.0, f64::max)
}

/// Asserts that wrong stamps did little: positions are nearly as good as with exact ones (`exact_m`), poses within `sigmas` standard
/// deviations, and no sensor is named.
fn assert_harmless(what: &str, judged: &[Judged], exact_m: f64, sigmas: f64) {
    let settled = || judged.iter().filter(|pose| pose.time_s > 3.0);
    let worst_m = worst_m(judged);
    let worst = settled().flat_map(|pose| pose.sigmas).fold(0.0, f64::max);
    println!("{what}: {worst_m:.4} of {exact_m:.4} m, {worst:.1} standard deviations");
    assert!(worst_m < 1.5 * exact_m + 0.02, "{what}: {worst_m} of {exact_m} m");
    assert!(worst < sigmas, "{what}: {worst} standard deviations");
    let named = settled().find(|pose| NAMES.iter().any(|bit| pose.health.contains(*bit)));
    assert!(named.is_none(), "{what}: {:?} at {:?}", named.map(|n| n.health), named.map(|n| n.time_s));
}

#[test]
fn stamps_that_jitter_or_swing_cost_little_and_blame_nobody() {
    type Age = fn(f64) -> Option<f64>;
    // A swing too slow to show turns the frame by what the vehicle turns meanwhile.
    let ages: [(&str, Age, f64); 3] = [
        ("1 ms", |t| Some(1e-3 * drawn(t)), 5.0),
        ("3 ms", |t| Some(3e-3 * drawn(t)), 5.0),
        ("swing of 3 ms", |t| Some(3e-3 * libm::sin(0.8 * t)), 6.0),
    ];
    for seed in SEEDS {
        let exact_m = worst_m(&flown(seed, |_| Some(0.0)));
        for (what, age_s, sigmas) in ages {
            assert_harmless(&format!("{what} {seed}"), &flown(seed, age_s), exact_m, sigmas);
        }
    }
}

#[test]
fn a_start_anew_among_late_stamps_is_as_well_known_as_it_says() {
    for seed in SEEDS {
        let late: fn(f64) -> Option<f64> = |t| Some(5e-3 + 1e-3 * drawn(t));
        let trouble = Trouble { age_s: &late, reset_s: Some(5.0), ..NONE };
        let judged = fly(&mut World::new(&config(2), seed, 500), 8.0, &trouble);
        let after = || judged.iter().filter(|pose| (5.3..8.0).contains(&pose.time_s));
        let worst = after().flat_map(|pose| pose.sigmas).fold(0.0, f64::max);
        assert!(after().count() > 40 && worst < 5.0, "{seed}: {worst} standard deviations");
    }
}
