//! Tests of [`super`]: on a path whose readings are exact, answers are the path.

use super::*;
use crate::Propagator;
use crate::estimate::Estimate;
use crate::geometry::{exp_so3, log_so3};
use nalgebra::UnitQuaternion;
use plumbline_config::{Config, ImuSample, ValidConfig};
use std::sync::LazyLock;

const RATE_B: Vector3<f64> = Vector3::new(0.3, -0.5, 0.9);
const ACCEL_O: Vector3<f64> = Vector3::new(0.8, -0.4, 0.2);
const V0: Vector3<f64> = Vector3::new(1.0, 0.5, 0.0);
const MS: i64 = 1_000_000;

static SETUP: LazyLock<ValidConfig> = LazyLock::new(|| {
    let config = Config::preset("sim").expect("is valid");
    config.with("test", |c| c.imu.stuck_after_s = 0.0).expect("is valid")
});

fn stamp(ns: i64) -> Timestamp {
    Timestamp::from_nanos(1_000_000_000 + ns)
}

fn truth(ns: i64) -> NavState {
    let t = ns as f64 * 1e-9;
    NavState {
        p_o_b: V0 * t + ACCEL_O * (0.5 * t * t),
        rot_o_b: exp_so3(&(RATE_B * t)),
        v_o_b: V0 + ACCEL_O * t,
        ..NavState::default()
    }
}

fn estimate(ns: i64, error: f64) -> Estimate {
    let nav = truth(ns);
    let off = Isometry3::translation(error, 0.0, 0.0);
    Estimate {
        stamp: stamp(ns),
        state: TrackingState::Tracking,
        pose_o_b: off * nav.pose_o_b(),
        v_o_b: nav.v_o_b,
        covariance: NavCovariance::identity() * 1e-4,
        quality: 90,
        ..Estimate::default()
    }
}

fn sample(ns: i64) -> ImuSample {
    let rot: UnitQuaternion<f64> = truth(ns).rot_o_b;
    let accel = rot.inverse() * (ACCEL_O + Vector3::new(0.0, 0.0, SETUP.imu.gravity_m_s2));
    ImuSample { stamp: stamp(ns), gyro: RATE_B, accel }
}

/// Flies `seconds` at 200 Hz; every 50 ms an estimate with `error`, if it gives one.
fn flown(seconds: i64, error: impl Fn(i64) -> Option<f64>) -> Propagator {
    let mut propagator = Propagator::new(SETUP.setup());
    for k in 0..=200 * seconds {
        propagator.tick(&sample(5 * k * MS));
        if k % 10 == 0
            && let Some(error) = error(5 * k)
        {
            propagator.correct(&estimate(5 * k * MS, error));
        }
    }
    propagator
}

#[test]
fn states_between_samples_are_those_of_the_path() {
    let propagator = flown(2, |_| Some(0.0));
    for ns in [3, 17, 49, 50, 51, 1234, 1999].map(|ms| ms * MS).into_iter().chain([777_777_777, 5 * MS + 1]) {
        let (at, true_state) = (propagator.at(stamp(ns)).expect("is kept"), truth(ns));
        let p = (at.pose_o_b.translation.vector - true_state.p_o_b).norm();
        let turn = log_so3(&(at.pose_o_b.rotation.inverse() * true_state.rot_o_b)).norm();
        assert!(p < 1e-5 && turn < 1e-9, "{ns}: {p} m, {turn} rad");
        assert!((at.v_o_b - true_state.v_o_b).norm() < 1e-4, "{ns}");
        assert!((at.angular_rate_b - RATE_B).norm() < 1e-12 && at.is_settled == (ns <= 2000 * MS), "{ns}");
    }
}

#[test]
fn an_answer_at_a_sample_ahead_of_estimates_is_the_odometry() {
    let mut propagator = flown(1, |ms| Some(0.0).filter(|_| ms == 900));
    let odometry = propagator.tick(&sample(1005 * MS)).expect("there is a pose");
    let at = propagator.at(odometry.stamp).expect("is kept");
    assert_eq!((at.pose_o_b, at.v_o_b), (odometry.pose_o_b, odometry.v_o_b));
    assert_eq!((at.covariance, at.angular_rate_b), (odometry.covariance, odometry.angular_rate_b));
    assert!(!at.is_settled && at.estimated == stamp(900 * MS));
}

#[test]
fn a_correction_is_shared_out_without_a_step_and_is_in_the_covariance() {
    let propagator = flown(1, |ms| Some(if ms >= 500 { 0.04 } else { 0.0 }));
    let off = |ns: i64| propagator.at(stamp(ns)).expect("is kept").pose_o_b.translation.x - truth(ns).p_o_b.x;
    assert!(
        off(450 * MS).abs() < 1e-6
            && (off(475 * MS) - 0.02).abs() < 1e-6
            && (off(500 * MS) - 0.04).abs() < 1e-6
    );
    assert!((off(499_999_999) - off(500 * MS)).abs() < 1e-6);
    let middle = propagator.at(stamp(475 * MS)).expect("is kept").covariance[(0, 0)];
    let before = propagator.at(stamp(425 * MS)).expect("is kept").covariance[(0, 0)];
    assert!((middle - before - 0.25 * 0.04 * 0.04).abs() < 1e-5, "{middle} {before}");
}

#[test]
fn a_reset_is_not_smoothed_over() {
    let mut propagator = flown(1, |ms| Some(0.0).filter(|_| ms < 1000));
    let reset = Estimate { reset_counter: 1, ..estimate(1000 * MS, 5.0) };
    propagator.correct(&reset);
    let at = |ms: i64| propagator.at(stamp(ms * MS)).expect("is kept");
    assert!(
        (at(999).pose_o_b.translation.x - truth(999 * MS).p_o_b.x).abs() < 1e-3 && at(999).reset_counter == 0
    );
    assert!(at(1000).pose_o_b.translation.x > 5.0 && at(1000).reset_counter == 1);
}

#[test]
fn instants_without_a_state_are_refused_with_the_reason() {
    let mut propagator = flown(1, |ms| Some(0.0).filter(|_| ms >= 200));
    assert_eq!(propagator.at(stamp(1000 * MS + 1)), Err(NoInstant::Ahead));
    assert_eq!(propagator.at(stamp(199 * MS)), Err(NoInstant::NoPose));
    propagator.correct(&Estimate { state: TrackingState::Failed, ..estimate(1000 * MS, 0.0) });
    propagator.tick(&sample(1005 * MS));
    assert_eq!(propagator.at(stamp(1003 * MS)), Err(NoInstant::NoPose));
    assert!(propagator.at(stamp(990 * MS)).is_ok());
    propagator.correct(&estimate(1005 * MS, 0.0));
    assert_eq!(propagator.at(stamp(1003 * MS)), Err(NoInstant::NoPose));
    assert!(propagator.at(stamp(1005 * MS)).is_ok());
    let long = flown(8, |_| Some(0.0));
    assert_eq!(long.at(stamp(1000 * MS)), Err(NoInstant::TooOld));
    assert!(long.at(stamp(5100 * MS)).is_ok());
    assert_eq!(Propagator::new(SETUP.setup()).at(stamp(0)), Err(NoInstant::Ahead));
}

#[test]
fn old_estimates_make_an_answer_blind_and_wide() {
    let propagator = flown(3, |ms| Some(0.0).filter(|_| ms <= 1500));
    let at = |ms: i64| propagator.at(stamp(ms * MS)).expect("is kept");
    assert_eq!((at(1900).state, at(1900).quality), (TrackingState::Tracking, 90));
    assert_eq!((at(2900).state, at(2900).quality), (TrackingState::Blind, 0));
    assert!(at(2900).covariance[(0, 0)] > at(1900).covariance[(0, 0)]);
}
