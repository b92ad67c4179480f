//! Sensors that fail without a word, from five seconds on: an estimate of quality 20 or more is within five standard
//! deviations, and a health bit names the sensor within a second.

use super::synthetic::{World, config};
use super::trust_tests::{Judged, NONE, Trouble, fly};
use super::*;
use plumbline_config::ImuSample;

const BEGIN_S: f64 = 5.0;
const QUALITY_TO_USE: i8 = 20;
const MAX_SIGMAS: f64 = 5.0;
const SEEDS: [u64; 3] = [1, 2, 3];

/// The bits that name a sensor that fails in silence.
const NAMES: [HealthBits; 5] = [
    HealthBits::GYRO_STUCK,
    HealthBits::ACCEL_STUCK,
    HealthBits::IMU_LATE,
    HealthBits::IMAGES_LATE,
    HealthBits::ROTATION_DISPUTED,
];

fn judged(seed: u64, trouble: &Trouble<'_>) -> Vec<Judged> {
    fly(&mut World::new(&config(2), seed, 500), 9.0, trouble)
}

/// Flies with `trouble`, which `names` alone report, all of them within a second.
fn assert_named(what: &str, trouble: Trouble<'_>, names: &[HealthBits]) {
    for seed in SEEDS {
        let judged = judged(seed, &trouble);
        let mut worst = [0.0_f64; 2];
        for pose in judged.iter().filter(|j| j.time_s > BEGIN_S && j.quality >= QUALITY_TO_USE) {
            worst = [0, 1].map(|k| worst[k].max(pose.sigmas[k]));
        }
        let first =
            |bit: &HealthBits| judged.iter().find(|j| j.health.contains(*bit)).map(|j| j.time_s - BEGIN_S);
        let named: Vec<_> = NAMES.iter().map(first).collect();
        println!("{what} {seed}: {worst:.1?} standard deviations, named {named:.2?}");
        assert!(worst.iter().all(|sigmas| *sigmas <= MAX_SIGMAS), "{what}: {worst:?}");
        for bit in names {
            assert!(first(bit).is_some_and(|s| (0.0..=1.0).contains(&s)), "{what}: {:?}", first(bit));
        }
        assert!(NAMES.iter().all(|bit| names.contains(bit) || first(bit).is_none()), "{what}: {named:?}");
    }
}

/// A sample that `spoil` changes once the trouble has begun.
fn spoilt(t: f64, mut sample: ImuSample, spoil: fn(&mut ImuSample)) -> Option<ImuSample> {
    if t >= BEGIN_S {
        spoil(&mut sample);
    }
    Some(sample)
}

#[test]
fn an_inertial_sensor_that_stands_still_or_is_late() {
    const STILL: [Vector3<f64>; 2] = [Vector3::new(0.3, -0.2, 0.4), Vector3::new(0.4, -0.3, 9.6)];
    type Imu = fn(f64, ImuSample) -> Option<ImuSample>;
    let (gyro, accel, late) = (HealthBits::GYRO_STUCK, HealthBits::ACCEL_STUCK, HealthBits::IMU_LATE);
    let troubles: [(&str, Imu, &[HealthBits]); 6] = [
        ("gyro zero", |t, s| spoilt(t, s, |s| s.gyro = Vector3::zeros()), &[gyro]),
        ("gyro axis", |t, s| spoilt(t, s, |s| s.gyro.y = 0.123), &[gyro]),
        ("accel stuck", |t, s| spoilt(t, s, |s| s.accel = STILL[1]), &[accel]),
        ("imu frozen", |t, s| spoilt(t, s, |s| [s.gyro, s.accel] = STILL), &[gyro, accel]),
        ("imu late 0.1", |t, s| spoilt(t, s, |s| s.stamp = s.stamp.plus_seconds(0.1)), &[late]),
        ("imu late 0.5", |t, s| spoilt(t, s, |s| s.stamp = s.stamp.plus_seconds(0.5)), &[late]),
    ];
    for (what, imu, names) in troubles {
        assert_named(what, Trouble { imu: &imu, ..NONE }, names);
    }
}

#[test]
fn images_a_fifth_of_a_second_late() {
    let age_s = |t: f64| match t {
        _ if t < BEGIN_S => Some(0.0),
        _ if t < BEGIN_S + 0.2 => None,
        _ => Some(0.2),
    };
    assert_named("images late", Trouble { age_s: &age_s, ..NONE }, &[HealthBits::IMAGES_LATE]);
}

#[test]
fn a_sound_flight() {
    assert_named("sound", NONE, &[]);
}
