//! Inertial samples between frames: holes, limits, stuck and distrusted sensors.

use super::*;

fn sample(nanos: i64, rate: f64) -> ImuSample {
    ImuSample {
        stamp: Timestamp::from_nanos(nanos),
        gyro: Vector3::new(0.0, 0.0, rate),
        accel: Vector3::new(0.0, 0.0, 9.81),
    }
}

/// A buffer for a sensor whose readings may repeat.
fn empty() -> ImuBuffer {
    ImuBuffer::of(&ImuConfig {
        gyro_range_rad_s: 10.0,
        accel_range_m_s2: 100.0,
        stuck_after_s: 0.0,
        ..ImuConfig::with_noise(200.0, (1e-3, 1e-5), (1e-2, 1e-4))
    })
}

fn buffer() -> ImuBuffer {
    let mut buffer = empty();
    for k in 0..100 {
        assert!(buffer.push(&sample(k * 5_000_000, k as f64 * 0.01)));
    }
    buffer
}

#[test]
fn a_sample_takes_the_place_of_those_that_are_not_earlier() {
    let mut buffer = buffer();
    assert!(buffer.push(&sample(3_600_000_000_000, 0.5)));
    assert!(buffer.push(&sample(98 * 5_000_000, 0.25)));
    let newest: Vec<_> =
        buffer.samples.iter().skip(97).map(|s| (s.sample.stamp.as_nanos(), s.sample.gyro.z)).collect();
    assert_eq!(newest, [(97 * 5_000_000, 0.97), (98 * 5_000_000, 0.25)]);
}

#[test]
fn the_ends_of_an_interval_are_interpolated() {
    let (from, to) = (Timestamp::from_nanos(12_345_678), Timestamp::from_nanos(203_456_789));
    let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, ..ImuNoise::NONE };
    let (pre, coverage) = buffer().preintegrate(from, to, &Vector3::zeros(), &Vector3::zeros(), &noise);
    assert_eq!(coverage, Coverage::default());
    assert!((pre.dt_s - to.seconds_since(from)).abs() < 1e-12);
    // The rate is 2 t: its integral is t².
    let angle = (203_456_789e-9f64).powi(2) - (12_345_678e-9f64).powi(2);
    assert!((pre.delta_rot.angle() - angle).abs() < 1e-9);
}

#[test]
fn the_mean_is_that_of_the_samples_in_the_interval() {
    let at = |k: i64| Timestamp::from_nanos(k * 5_000_000);
    let (gyro, accel) = buffer().mean(at(10), at(14)).expect("has samples");
    assert!((gyro.z - 0.12).abs() < 1e-12 && (accel.z - 9.81).abs() < 1e-12);
    // Between two samples, before the first and after the last there is none.
    assert!(buffer().mean(at(10).plus_nanos(1), at(11).plus_nanos(-1)).is_none());
    assert!(buffer().mean(at(-5), at(-1)).is_none());
    assert!(buffer().mean(at(100), at(200)).is_none());
    assert!(buffer().mean(at(14), at(10)).is_none());
}

#[test]
fn missing_samples_are_told_and_cost_certainty() {
    let mut holed = empty();
    for k in (0..20).chain(30..60) {
        holed.push(&sample(k * 5_000_000, 0.0));
    }
    let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, ..ImuNoise::NONE };
    let (from, to) = (Timestamp::from_nanos(0), Timestamp::from_nanos(250_000_000));
    let zero = Vector3::zeros();
    let (whole, _) = buffer().preintegrate(from, to, &zero, &zero, &noise);
    let (pre, coverage) = holed.preintegrate(from, to, &zero, &zero, &noise);
    assert!(coverage.has_gap);
    assert!(pre.covariance[(0, 0)] > 10.0 * whole.covariance[(0, 0)]);
}

#[test]
fn a_gap_is_as_uncertain_with_a_quiet_sensor_as_with_a_noisy_one() {
    let mut holed = empty();
    (0..20).chain(60..100).for_each(|k| _ = holed.push(&sample(k * 5_000_000, 0.0)));
    let (from, to) = (Timestamp::from_nanos(0), Timestamp::from_nanos(400_000_000));
    let zero = Vector3::zeros();
    let sigmas = [1e-5, 1e-4, 1e-3].map(|density| {
        let noise = ImuNoise { gyro_density: density, accel_density: 10.0 * density, ..ImuNoise::NONE };
        let (motion, coverage) = holed.preintegrate(from, to, &zero, &zero, &noise);
        assert!(coverage.has_gap);
        [0, 3, 6].map(|k| motion.covariance[(k, k)].sqrt())
    });
    for [position_m, turn_rad, gain_m_s] in sigmas {
        // 0.2 s in which a vehicle may turn by ten degrees and gain a metre per second.
        assert!((0.15..0.3).contains(&turn_rad), "{turn_rad} rad");
        assert!(
            (0.8..2.0).contains(&gain_m_s) && (0.1..0.5).contains(&position_m),
            "{gain_m_s} {position_m}"
        );
    }
}

#[test]
fn what_lies_within_a_hole_is_as_uncertain_as_the_hole_is_long_however_short_it_is() {
    let mut holed = empty();
    (0..20).chain(200..240).for_each(|k| _ = holed.push(&sample(k * 5_000_000, 0.0)));
    let noise = ImuNoise { gyro_density: 1e-4, accel_density: 1e-3, ..ImuNoise::NONE };
    let zero = Vector3::zeros();
    let between = |from_ms: i64, to_ms: i64| {
        let at = |ms: i64| Timestamp::from_nanos(ms * 1_000_000);
        holed.preintegrate(at(from_ms), at(to_ms), &zero, &zero, &noise)
    };
    // 0.9 s long: the rate may be off by 2 rad/s anywhere in it, the force by 8 m/s².
    for (from_ms, to_ms) in [(400, 450), (500, 510), (98, 148), (950, 1000)] {
        let (motion, coverage) = between(from_ms, to_ms);
        let dt_s = (to_ms - from_ms) as f64 * 1e-3;
        let [turn_rad, gain_m_s] = [3, 6].map(|k: usize| motion.covariance[(k, k)].sqrt());
        assert!(coverage.has_gap && turn_rad > 1.9 * dt_s, "{from_ms} ms: {turn_rad} rad");
        assert!(gain_m_s > 7.5 * dt_s, "{from_ms} ms: {gain_m_s} m/s");
    }
    assert!(!between(0, 95).1.has_gap && !between(1000, 1100).1.has_gap);
}

#[test]
fn readings_that_were_distrusted_count_again_if_they_prove_right_and_not_if_they_were_wrong() {
    let at = |nanos| Timestamp::from_nanos(nanos);
    let motion = |buffer: &ImuBuffer| {
        let zero = Vector3::zeros();
        buffer.preintegrate(at(0), at(490_000_000), &zero, &zero, &ImuNoise::NONE)
    };
    let (before, _) = motion(&buffer());
    for is_wrong in [false, true] {
        let mut buffer = buffer();
        buffer.distrust(at(200_000_000));
        let (doubted, coverage) = motion(&buffer);
        assert!(coverage.unmeasured == Unmeasured::BOTH && doubted.delta_rot != before.delta_rot);
        buffer.distrust(at(100_000_000));
        if is_wrong {
            buffer.convict();
        }
        let _ = buffer.take_revision();
        buffer.acquit();
        let (after, coverage) = motion(&buffer);
        assert_eq!(coverage.unmeasured.is_any(), is_wrong);
        assert_eq!(after.delta_rot == before.delta_rot, !is_wrong);
        assert_eq!(buffer.take_revision(), (!is_wrong).then_some(at(100_000_000)));
        // What comes is believed either way.
        assert!(buffer.push(&sample(500_000_000, 1.0)));
        let newest = buffer.samples.back().map(|believed| believed.unmeasured);
        assert_eq!(newest, Some(Unmeasured::default()));
    }
}

#[test]
fn saturated_readings_cost_certainty_and_do_not_count() {
    let at_an_end = |k: i64| if k % 2 == 0 { 10.0 } else { -10.0 };
    let fill = |is_hit: fn(i64) -> bool| {
        let mut buffer = empty();
        for k in 0..100 {
            buffer.push(&sample(k * 5_000_000, if is_hit(k) { at_an_end(k / 3) } else { 0.1 }));
        }
        buffer
    };
    let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, ..ImuNoise::NONE };
    let zero = Vector3::zeros();
    let between = |buffer: &ImuBuffer, from: i64, to: i64| {
        let stamp = |nanos| Timestamp::from_nanos(nanos);
        buffer.preintegrate(stamp(from), stamp(to), &zero, &zero, &noise)
    };
    let (hit, whole) = (fill(|k| (40..60).contains(&k)), fill(|_| false));
    let (motion, coverage) = between(&hit, 100_000_000, 400_000_000);
    let (sound, _) = between(&whole, 100_000_000, 400_000_000);
    assert!(coverage.is_saturated);
    assert!(motion.delta_rot.angle_to(&sound.delta_rot) < 1e-9, "the last good reading stands in");
    assert!(motion.covariance[(5, 5)].sqrt() > 0.05, "{}", motion.covariance[(5, 5)].sqrt());
    // An interval between two samples of which one is saturated, and one that is not concerned.
    assert!(between(&hit, 196_000_000, 199_000_000).1.is_saturated);
    assert_eq!(between(&hit, 100_000_000, 190_000_000), between(&whole, 100_000_000, 190_000_000));
}

#[test]
fn a_sample_that_is_no_number_is_refused_and_harms_nothing() {
    let mut poisoned = empty();
    let mut refused = 0;
    for k in 0..100 {
        let mut bad = sample(k * 5_000_000 + 1_000_000, 0.0);
        let value = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][k as usize % 3];
        if k % 2 == 0 {
            bad.gyro[k as usize % 3] = value
        } else {
            bad.accel[k as usize % 3] = value
        }
        assert!(poisoned.push(&sample(k * 5_000_000, k as f64 * 0.01)));
        refused += u32::from(!poisoned.push(&bad));
    }
    assert_eq!(refused, 100);
    let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, ..ImuNoise::NONE };
    let (from, to) = (Timestamp::from_nanos(7_000_000), Timestamp::from_nanos(400_000_000));
    let zero = Vector3::zeros();
    let motions = [poisoned, buffer()].map(|b| b.preintegrate(from, to, &zero, &zero, &noise));
    assert_eq!(motions[0], motions[1]);
}

#[test]
fn stamps_at_the_ends_of_time_give_a_motion_of_finite_numbers() {
    let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, ..ImuNoise::NONE };
    let zero = Vector3::zeros();
    let stamps =
        [Timestamp::MIN, Timestamp::from_nanos(0), Timestamp::from_nanos(250_000_000), Timestamp::MAX];
    for from in stamps {
        for to in stamps {
            let (motion, _) = buffer().preintegrate(from, to, &zero, &zero, &noise);
            let parts = motion.delta_p.iter().chain(&motion.delta_v).chain(motion.delta_rot.coords.iter());
            assert!(parts.chain(&motion.covariance).all(|x| x.is_finite()), "{from} to {to}");
        }
    }
}
