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

fn judged(seed: u64, trouble: &Trouble) -> Vec<Judged> {
    fly(&mut World::new(&config(2), seed, 500), 9.0, trouble)
}

/// Flies with `trouble`, which `names` alone report, all of them within a second.
fn assert_named(what: &str, trouble: Trouble, names: &[HealthBits]) {
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

#[test]
fn a_gyroscope_at_zero() {
    let imu = |t, s: ImuSample| Some(ImuSample { gyro: s.gyro * f64::from(u8::from(t < BEGIN_S)), ..s });
    assert_named("gyro zero", Trouble { imu, ..NONE }, &[HealthBits::GYRO_STUCK]);
}

#[test]
fn one_axis_of_the_gyroscope_stuck() {
    let imu = |t, mut s: ImuSample| {
        s.gyro.y = if t < BEGIN_S { s.gyro.y } else { 0.123 };
        Some(s)
    };
    assert_named("gyro axis", Trouble { imu, ..NONE }, &[HealthBits::GYRO_STUCK]);
}

#[test]
fn an_accelerometer_that_stands_still() {
    let imu = |t, mut s: ImuSample| {
        s.accel = if t < BEGIN_S { s.accel } else { Vector3::new(0.4, -0.3, 9.6) };
        Some(s)
    };
    assert_named("accel stuck", Trouble { imu, ..NONE }, &[HealthBits::ACCEL_STUCK]);
}

#[test]
fn a_frozen_inertial_sensor() {
    let imu = |t, mut s: ImuSample| {
        if t >= BEGIN_S {
            (s.gyro, s.accel) = (Vector3::new(0.3, -0.2, 0.4), Vector3::new(0.4, -0.3, 9.6));
        }
        Some(s)
    };
    assert_named("imu frozen", Trouble { imu, ..NONE }, &[HealthBits::GYRO_STUCK, HealthBits::ACCEL_STUCK]);
}

fn late(t: f64, s: ImuSample, late_s: f64) -> Option<ImuSample> {
    let stamp = if t < BEGIN_S { s.stamp } else { s.stamp.plus_seconds(late_s) };
    Some(ImuSample { stamp, ..s })
}

#[test]
fn inertial_samples_a_tenth_of_a_second_late() {
    let imu = |t, s| late(t, s, 0.1);
    assert_named("imu late 0.1", Trouble { imu, ..NONE }, &[HealthBits::IMU_LATE]);
}

#[test]
fn inertial_samples_half_a_second_late() {
    let imu = |t, s| late(t, s, 0.5);
    assert_named("imu late 0.5", Trouble { imu, ..NONE }, &[HealthBits::IMU_LATE]);
}

#[test]
fn images_a_fifth_of_a_second_late() {
    let age_s = |t: f64| match t {
        _ if t < BEGIN_S => Some(0.0),
        _ if t < BEGIN_S + 0.2 => None,
        _ => Some(0.2),
    };
    assert_named("images late", Trouble { age_s, ..NONE }, &[HealthBits::IMAGES_LATE]);
}

#[test]
fn a_sound_flight() {
    assert_named("sound", NONE, &[]);
}
