//! Tests of [`super`].

use super::*;
use crate::estimate::{BiasVariances, FrameFigures, HealthBits, NavCovariance, TrackingState};
use nalgebra::Isometry3;
use plumbline_config::{Config, ValidConfig};

/// The rig of the tests, whose readings repeat.
fn sensor_without_noise() -> ValidConfig {
    let config = Config::preset("sim").expect("is valid");
    config.with("test", |c| c.imu.stuck_after_s = 0.0).expect("is valid")
}

fn estimate() -> Estimate {
    Estimate {
        frame_sequence: 0,
        stamp: Timestamp::from_nanos(1_000_000_000),
        state: TrackingState::Tracking,
        pose_o_b: Isometry3::identity(),
        v_o_b: Vector3::zeros(),
        bias_gyro: Vector3::zeros(),
        bias_accel: Vector3::zeros(),
        covariance: NavCovariance::identity() * 1e-4,
        origin: OriginUncertainty::default(),
        bias_variances: BiasVariances::zeros(),
        time_offset_s: 0.0,
        time_offset_sigma_s: 0.0,
        pose_b_c0: Isometry3::identity(),
        quality: 90,
        health: HealthBits::default(),
        reset_counter: 0,
        figures: FrameFigures::default(),
    }
}

#[test]
fn odometry_without_news_of_the_cameras_goes_on_and_says_that_it_is_blind() {
    let config = sensor_without_noise();
    let mut propagator = Propagator::new(config.setup());
    propagator.correct(&estimate());
    let outputs: Vec<_> = (1..=200)
        .filter_map(|k| {
            let stamp = Timestamp::from_nanos(1_000_000_000 + k * 5_000_000);
            let accel = Vector3::new(0.0, 0.0, config.imu.gravity_m_s2);
            propagator.tick(&ImuSample { stamp, gyro: Vector3::zeros(), accel })
        })
        .collect();
    assert_eq!(outputs.len(), 200);
    let said = |k: usize| (outputs[k].state, outputs[k].quality);
    assert_eq!(said(90), (TrackingState::Tracking, 90));
    assert_eq!(said(199), (TrackingState::Blind, 0));
    assert!(outputs[199].covariance[(0, 0)] > outputs[0].covariance[(0, 0)]);
}

/// Standard deviations of position and velocity, m and m/s, a second after `estimate`, of samples that `spoil` changes.
fn sigmas(estimate: &Estimate, spoil: fn(i64, &mut ImuSample), skips: fn(i64) -> bool) -> [f64; 2] {
    let mut propagator = Propagator::new(sensor_without_noise().setup());
    propagator.correct(estimate);
    let sample = |k: i64| {
        let stamp = Timestamp::from_nanos((1000 + 5 * k) * 1_000_000);
        let mut reading = ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::new(0.0, 0.0, 9.81) };
        spoil(k, &mut reading);
        reading
    };
    let odometry = (1..=200).filter(|k| !skips(*k)).filter_map(|k| propagator.tick(&sample(k)));
    let odometry = odometry.reduce(|_, newest| newest);
    let covariance = odometry.expect("there is a pose").covariance;
    [covariance[(0, 0)].sqrt(), covariance[(6, 6)].sqrt()]
}

#[test]
fn biases_gaps_and_saturation_cost_certainty() {
    let known = estimate();
    let variances = BiasVariances::from_column_slice(&[0.0, 0.0, 0.0, 0.01, 0.01, 0.01]);
    let unsure = Estimate { bias_variances: variances, ..known.clone() };
    let [position_m, velocity_m_s] = sigmas(&known, |_, _| {}, |_| false);
    assert!(position_m < 0.06 && velocity_m_s < 0.15, "{position_m} {velocity_m_s}");
    // A bias of 0.1 m/s² is 0.1 m/s and 5 cm after a second.
    let [of_bias_m, of_bias_m_s] = sigmas(&unsure, |_, _| {}, |_| false);
    let hypot = |a: f64, b: f64| (a * a + b * b).sqrt();
    assert!((of_bias_m / hypot(position_m, 0.05) - 1.0).abs() < 0.02, "{of_bias_m}");
    assert!((of_bias_m_s / hypot(velocity_m_s, 0.1) - 1.0).abs() < 0.02, "{of_bias_m_s}");
    let [_, of_gap_m_s] = sigmas(&known, |_, _| {}, |k| (80..120).contains(&k));
    assert!(of_gap_m_s > 0.8, "0.2 s without a sample: {of_gap_m_s} m/s");
    let hit = |k: i64, reading: &mut ImuSample| {
        if (80..140).contains(&k) {
            reading.accel = Vector3::new(156.9, -156.9, 156.9);
        }
    };
    let [_, of_blow_m_s] = sigmas(&known, hit, |_| false);
    assert!(of_blow_m_s > 2.0, "0.3 s at the end of the range: {of_blow_m_s} m/s");
}

#[test]
fn sensors_that_are_contradicted_carry_no_state() {
    let carried = |bit: HealthBits| {
        let mut propagator = Propagator::new(sensor_without_noise().setup());
        propagator.correct(&Estimate { health: bit, ..estimate() });
        let wrong = |_: i64, reading: &mut ImuSample| {
            reading.accel.x += 5.0;
            reading.gyro.z += 0.5;
        };
        let newest = run(&mut propagator, 1000, wrong).swap_remove(20);
        let sigma = |part: usize| newest.covariance[(part, part)].sqrt();
        (newest.v_o_b.x, sigma(6), newest.pose_o_b.rotation.angle(), sigma(3))
    };
    let (gained_m_s, sigma_m_s, ..) = carried(HealthBits::ACCEL_CONTRADICTED);
    assert!(gained_m_s.abs() < 0.05 && sigma_m_s > 0.1, "{gained_m_s}, {sigma_m_s} m/s");
    let (.., turned_rad, sigma_rad) = carried(HealthBits::GYRO_CONTRADICTED);
    assert!(turned_rad < 1e-3 && sigma_rad > 0.02, "{turned_rad}, {sigma_rad} rad");
    let (gained_m_s, _, turned_rad, _) = carried(HealthBits::default());
    assert!(gained_m_s > 0.4 && turned_rad > 0.04, "sensors that are believed carry it");
}

fn is_finite(odometry: &Odometry) -> bool {
    let pose = &odometry.pose_o_b;
    let vectors = [&pose.translation.vector, &odometry.v_o_b, &odometry.angular_rate_b];
    vectors
        .into_iter()
        .flatten()
        .chain(pose.rotation.coords.iter())
        .chain(&odometry.covariance)
        .all(|x| x.is_finite())
}

/// A second of odometry at rest, sample `k` and what comes of the estimate as they are made.
fn run(
    propagator: &mut Propagator,
    from_ms: i64,
    mut sample: impl FnMut(i64, &mut ImuSample),
) -> Vec<Odometry> {
    (1..=200)
        .filter_map(|k| {
            let stamp = Timestamp::from_nanos((from_ms + 5 * k) * 1_000_000);
            let mut reading =
                ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::new(0.0, 0.0, 9.81) };
            sample(k, &mut reading);
            propagator.tick(&reading)
        })
        .collect()
}

#[test]
fn readings_that_are_no_numbers_or_beyond_all_bounds_never_reach_the_odometry() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200, -1e300, f64::MAX] {
        for axis in 0..6 {
            let mut propagator = Propagator::new(sensor_without_noise().setup());
            propagator.correct(&estimate());
            let odometry = run(&mut propagator, 1000, |k, reading| {
                let part = if axis < 3 { &mut reading.gyro } else { &mut reading.accel };
                if k == 50 {
                    part[axis % 3] = value
                }
            });
            assert!(odometry.len() >= 49 && odometry.iter().all(is_finite), "{value} on axis {axis}");
            // An estimate from after it sets it right.
            let mut next = estimate();
            next.stamp = Timestamp::from_nanos(2_000_000_000);
            propagator.correct(&next);
            let odometry = run(&mut propagator, 2000, |_, _| {});
            assert!(odometry.len() == 200 && odometry.iter().all(is_finite), "{value} on axis {axis}");
        }
    }
}

#[test]
fn a_correction_enters_at_a_bounded_rate_and_that_of_a_reset_at_once() {
    let mut propagator = Propagator::new(sensor_without_noise().setup());
    propagator.correct(&estimate());
    let before = run(&mut propagator, 1000, |_, _| {}).pop().expect("flies");
    let at = |seconds: i64, x: f64, reset_counter: u32| Estimate {
        stamp: Timestamp::from_nanos(seconds * 1_000_000_000),
        pose_o_b: Isometry3::translation(x, 0.0, 0.0),
        reset_counter,
        ..estimate()
    };
    propagator.correct(&at(2, 0.06, 0));
    let after = run(&mut propagator, 2000, |_, _| {});
    let x = |o: &Odometry| o.pose_o_b.translation.x;
    let steps = std::iter::once(&before).chain(&after).zip(&after).map(|(a, b)| x(b) - x(a));
    let largest = steps.fold(0.0, |most: f64, step| most.max(step.abs()));
    assert!(largest <= blend::MAX_SPEED_M_S * 0.005 + 1e-6, "a step of {largest} m");
    assert!(after[0].covariance[(0, 0)].sqrt() > 0.058, "it is told what is still to come");
    assert!((x(&after[199]) - 0.06).abs() < 1e-4, "{} m in the end", x(&after[199]));
    propagator.correct(&at(3, 5.0, 1));
    let reset = run(&mut propagator, 3000, |_, _| {});
    assert!((x(&reset[0]) - 5.0).abs() < 1e-4, "a reset is told as one");
    assert!(after.iter().chain(&reset).all(|o| o.jumps == 0) && reset[0].steps() == 1);
}

#[test]
fn a_large_correction_is_taken_at_once_and_counted() {
    let mut propagator = Propagator::new(Config::preset("sim").expect("is valid").setup());
    propagator.correct(&estimate());
    run(&mut propagator, 1000, |_, _| {});
    // The first estimate after darkness, which knew nothing of the velocity, and the next, which does.
    let mut right = Estimate { stamp: Timestamp::from_nanos(2_000_000_000), ..estimate() };
    right.v_o_b = Vector3::new(1.2, 0.0, 0.0);
    propagator.correct(&right);
    let after = run(&mut propagator, 2000, |_, _| {});
    assert!((after[0].v_o_b.x - 1.2).abs() < 1e-3, "{}", after[0].v_o_b);
    assert!(after.iter().all(|o| (o.reset_counter, o.jumps, o.steps()) == (0, 1, 1)));
}

#[test]
fn odometry_that_resumes_without_a_reset_is_counted_as_a_step() {
    let mut propagator = Propagator::new(Config::preset("sim").expect("is valid").setup());
    propagator.correct(&estimate());
    assert!(run(&mut propagator, 1000, |_, _| {}).iter().all(|o| o.jumps == 0));
    propagator.correct(&Estimate { state: TrackingState::Failed, ..estimate() });
    assert!(run(&mut propagator, 2000, |_, _| {}).is_empty());
    let mut next = estimate();
    next.stamp = Timestamp::from_nanos(3_000_000_000);
    propagator.correct(&next);
    propagator.correct(&next);
    assert!(run(&mut propagator, 3000, |_, _| {}).iter().all(|o| o.jumps == 1));
}

#[test]
fn an_estimate_from_before_the_samples_that_are_kept_ends_the_odometry() {
    let mut propagator = Propagator::new(sensor_without_noise().setup());
    let _ = run(&mut propagator, 5000, |_, _| {});
    let _ = run(&mut propagator, 6000, |_, _| {});
    propagator.correct(&estimate());
    assert!(run(&mut propagator, 7000, |_, _| {}).is_empty());
}

#[test]
fn an_estimate_that_is_not_finite_ends_the_odometry_until_the_next() {
    for value in [f64::NAN, f64::INFINITY] {
        let poisons: [fn(&mut Estimate, f64); 5] = [
            |e, x| e.pose_o_b.translation.vector.y = x,
            |e, x| e.v_o_b.x = x,
            |e, x| e.bias_gyro.z = x,
            |e, x| e.bias_accel.x = x,
            |e, x| e.covariance[(3, 3)] = x,
        ];
        for (which, poison) in poisons.iter().enumerate() {
            let mut propagator = Propagator::new(sensor_without_noise().setup());
            let mut bad = estimate();
            poison(&mut bad, value);
            propagator.correct(&bad);
            assert!(run(&mut propagator, 1000, |_, _| {}).is_empty(), "{which}: {value}");
            let mut good = estimate();
            good.stamp = Timestamp::from_nanos(2_000_000_000);
            propagator.correct(&good);
            assert_eq!(run(&mut propagator, 2000, |_, _| {}).len(), 200);
        }
    }
}
