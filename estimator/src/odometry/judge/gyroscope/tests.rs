//! Gyroscope and images that agree, and those that are late, on a flight whose turns are known.

use super::*;

/// When something goes wrong, s.
const BEGIN_S: f64 = 5.0;

fn at(t: f64) -> Timestamp {
    Timestamp::from_nanos((t * 1e9).round() as i64)
}

/// Integral of the angular rate of the vehicle, rad.
fn angle(t: f64) -> Vector3<f64> {
    Vector3::new(-0.6 * libm::cos(1.3 * t), 0.4 * libm::sin(1.9 * t), -0.3 * libm::cos(2.7 * t))
}

fn rate(t: f64) -> Vector3<f64> {
    (angle(t + 1e-5) - angle(t - 1e-5)) / 2e-5
}

/// Fault of the test.
#[derive(Clone, Copy, Debug)]
struct Wrong {
    imu_late_s: f64,
    images_late_s: f64,
    /// Factor of the rate.
    scale: f64,
    /// Error of the rate about x, rad/s.
    step_rad_s: f64,
    /// Turn about y that the images see once and the vehicle does not make, rad.
    jump_rad: f64,
    /// True if the accelerometer is contradicted from half a second before on.
    is_force_wrong: bool,
    /// Standard deviation of the turns by the images, rad.
    sigma_rad: f64,
    /// Until when, s.
    until_s: f64,
}

const NOTHING: Wrong = Wrong {
    imu_late_s: 0.0,
    images_late_s: 0.0,
    scale: 1.0,
    step_rad_s: 0.0,
    jump_rad: 0.0,
    is_force_wrong: false,
    sigma_rad: 4e-4,
    until_s: f64::INFINITY,
};

/// The turn `seen` between two times, of a frame of which nothing else is to be said.
fn turn(span_s: [f64; 2], seen: Vector3<f64>) -> SeenTurn {
    SeenTurn {
        agreeing_share: 1.0,
        speed_m_s: 0.0,
        span: span_s.map(at),
        stamps: span_s.map(at),
        time_sigma_s: None,
        rot_o_b: None,
        seen,
        covariance: Matrix3::identity() * 1.6e-7,
        bias_gyro: Vector3::zeros(),
        bias_sigma_rad_s: 1e-3,
        skips_samples: false,
        is_force_contradicted: false,
        is_voted: true,
    }
}

/// Flies for twelve seconds; of each frame its time, what is said of it and the quality left of 90.
fn fly(wrong: Wrong) -> Vec<(f64, HealthBits, i8)> {
    let imu = ImuConfig::with_noise(200.0, (1.7e-4, 2e-5), (2e-3, 3e-3));
    let mut watch = RotationWatch::new(&imu);
    let is_wrong = |t: f64| (BEGIN_S..wrong.until_s).contains(&t);
    let (mut next, mut last_s, mut said) = (0u32, None, Vec::new());
    for k in 0..240 {
        let t = f64::from(k) * 0.05;
        loop {
            let true_s = f64::from(next) * 0.005;
            let late_s = if is_wrong(true_s) { wrong.imu_late_s } else { 0.0 };
            if true_s + late_s > t + 1e-9 {
                break;
            }
            let gyro = match is_wrong(true_s) {
                true => rate(true_s) * wrong.scale + Vector3::x() * wrong.step_rad_s,
                false => rate(true_s),
            };
            watch.add(&ImuSample { stamp: at(true_s + late_s), gyro, accel: Vector3::zeros() });
            next += 1;
        }
        // No image comes while those that were late already would.
        let age_s = if is_wrong(t) { wrong.images_late_s } else { 0.0 };
        if is_wrong(t) && t < BEGIN_S + age_s {
            continue;
        }
        if let Some((last_s, last_age_s)) = last_s {
            let noise = angle(f64::from(k * k)) * 2e-4;
            let jump = if last_s < BEGIN_S && t >= BEGIN_S {
                Vector3::y() * wrong.jump_rad
            } else {
                Vector3::zeros()
            };
            let hidden = Turn { from: at(last_s), to: at(t), seen: noise, rot_o_b: None, variance: 0.0 };
            let frame = SeenTurn {
                skips_samples: watch.angles.difference(&hidden, 0, &noise).is_none(),
                is_force_contradicted: wrong.is_force_wrong && t > BEGIN_S - 0.5,
                covariance: Matrix3::identity() * wrong.sigma_rad.squared(),
                ..turn([last_s, t], angle(t - age_s) - angle(last_s - last_age_s) + noise + jump)
            };
            let _ = watch.update(&frame);
        }
        last_s = Some((t, age_s));
        let mut health = HealthBits::default();
        watch.report(&mut health);
        said.push((t, health, if watch.is_contradicted() { 10 } else { 90 }));
    }
    said
}

/// When a bit was up first, s after something went wrong.
fn first_s(said: &[(f64, HealthBits, i8)], bit: HealthBits) -> Option<f64> {
    said.iter().find(|(_, health, _)| health.contains(bit)).map(|(t, _, _)| t - BEGIN_S)
}

#[test]
fn nothing_is_said_of_sensors_that_agree() {
    assert!(
        fly(NOTHING).iter().all(|(_, health, quality)| *health == HealthBits::default() && *quality == 90)
    );
}

#[test]
fn the_stream_that_is_late_is_named_within_a_second_and_costs_the_quality() {
    let late = [HealthBits::IMU_LATE, HealthBits::IMAGES_LATE];
    let of_imu = |imu_late_s| (Wrong { imu_late_s, ..NOTHING }, late);
    let of_images = |images_late_s| (Wrong { images_late_s, ..NOTHING }, [late[1], late[0]]);
    let cases = [0.025, 0.1, 0.2, 0.5].map(of_imu).into_iter().chain([0.025, 0.1, 0.2, 0.4].map(of_images));
    for (wrong, [name, other]) in cases {
        let said = fly(wrong);
        assert!(first_s(&said, name).is_some_and(|s| (0.0..1.0).contains(&s)), "{wrong:?}");
        assert!([other, HealthBits::GYRO_CONTRADICTED].iter().all(|bit| first_s(&said, *bit).is_none()));
        assert!(said.iter().all(|(_, health, quality)| *quality < 20 || !health.contains(name)), "{wrong:?}");
    }
}

#[test]
fn a_gyroscope_that_exaggerates_is_disputed_and_believed_again_when_it_agrees() {
    let said = fly(Wrong { scale: 1.5, until_s: 8.0, ..NOTHING });
    assert!(first_s(&said, HealthBits::ROTATION_DISPUTED).is_some_and(|s| s < 2.0));
    assert!(
        first_s(&said, HealthBits::IMU_LATE).is_none() && first_s(&said, HealthBits::IMAGES_LATE).is_none()
    );
    assert_eq!(
        said.last().map(|(_, health, quality)| (*health, *quality)),
        Some((HealthBits::default(), 90))
    );
}

#[test]
fn a_gyroscope_that_turns_faster_than_any_delay_explains_is_named_after_two_frames() {
    for step_rad_s in [3.0, -6.0] {
        let said = fly(Wrong { step_rad_s, until_s: BEGIN_S + 0.2, ..NOTHING });
        let named_s = first_s(&said, HealthBits::GYRO_CONTRADICTED);
        assert!(named_s.is_some_and(|s| s < 0.2), "{step_rad_s}: {named_s:?}");
    }
}

#[test]
fn a_gyroscope_that_exaggerates_is_named_within_a_second_unless_forces_were_wrong_before() {
    let fault = Wrong { scale: 1.5, until_s: 8.0, ..NOTHING };
    assert!(first_s(&fly(fault), HealthBits::GYRO_CONTRADICTED).is_some_and(|s| (0.0..1.0).contains(&s)));
    let said = fly(Wrong { is_force_wrong: true, ..fault });
    assert_eq!(first_s(&said, HealthBits::GYRO_CONTRADICTED), None);
    assert!(first_s(&said, HealthBits::IMU_CONTRADICTED).is_some_and(|s| s < 1.0));
}

#[test]
fn an_image_that_jumps_once_is_not_the_gyroscopes_fault() {
    for jump_rad in [0.03, 0.3] {
        let said = fly(Wrong { jump_rad, ..NOTHING });
        assert_eq!(first_s(&said, HealthBits::GYRO_CONTRADICTED), None, "{jump_rad}");
        assert!(first_s(&said, HealthBits::IMU_CONTRADICTED).is_some_and(|s| s < 0.2), "{jump_rad}");
    }
}

#[test]
fn a_step_that_single_frames_hardly_show_is_contradicted_for_as_long_as_it_lasts() {
    // 3 mrad in a frame, of which stamps and sightings admit several.
    let said = fly(Wrong { step_rad_s: 0.06, until_s: 9.0, ..NOTHING });
    let is_disputed = |bits: &HealthBits| bits.0 != 0;
    let disputed: Vec<f64> = said.iter().filter(|(_, bits, _)| is_disputed(bits)).map(|(t, ..)| *t).collect();
    let (first, last) = (disputed.first().expect("adds up"), disputed.last().expect("adds up"));
    assert!(*first < BEGIN_S + 0.5 && (9.0..11.0).contains(last), "{first} to {last}");
    let held = said.iter().filter(|(t, ..)| (*first..9.0).contains(t)).all(|(_, bits, _)| is_disputed(bits));
    assert!(held, "is believed again while it is wrong");
}

#[test]
fn errors_of_landmarks_add_up_over_frames_where_none_votes_for_the_images() {
    let is_contradicted = |sigmas: f64, frames: u32, is_voted: bool| {
        let imu = ImuConfig::with_noise(200.0, (1.7e-4, 2e-5), (2e-3, 3e-3));
        let mut watch = RotationWatch::new(&imu);
        (0..400).for_each(|k| {
            let t = 0.005 * f64::from(k);
            watch.add(&ImuSample { stamp: at(t), gyro: rate(t), accel: Vector3::zeros() });
        });
        (1..40).map(f64::from).any(|k| {
            let [from, to] = [k - 1.0, k].map(|k| 0.05 * k);
            let is_off = (20.0..20.0 + f64::from(frames)).contains(&k);
            let off = Vector3::y() * if is_off { 2e-3 * sigmas } else { 0.0 };
            let covariance = Matrix3::identity() * 2e-3f64.squared();
            let seen = angle(to) - angle(from) + off;
            watch.update(&SeenTurn { covariance, is_voted, ..turn([from, to], seen) }).is_some()
        })
    };
    assert!(!is_contradicted(3.5, 10, false), "landmarks that are off turn every frame alike");
    assert!(is_contradicted(3.5, 10, true));
    assert!(is_contradicted(7.0, 3, false));
}

#[test]
fn landmarks_that_are_off_more_and_more_are_told_from_a_gyroscope_that_is() {
    // Sightings that are off by 1.5 mrad more in each of five frames, or a gyroscope that turns 10 mrad too far in each.
    let is_contradicted = |is_sighting_off: bool| {
        let imu = ImuConfig::with_noise(200.0, (1.7e-4, 2e-5), (2e-3, 3e-3));
        let mut watch = RotationWatch::new(&imu);
        let extra = Vector3::y() * if is_sighting_off { 0.0 } else { 0.2 };
        (0..400).for_each(|k| {
            let t = 0.005 * f64::from(k);
            let gyro = rate(t) + if (1.0..1.5).contains(&t) { extra } else { Vector3::zeros() };
            watch.add(&ImuSample { stamp: at(t), gyro, accel: Vector3::zeros() });
        });
        let mut rot_o_b = UnitQuaternion::identity();
        (1..40).map(f64::from).any(|k| {
            let [from, to] = [k - 1.0, k].map(|k| 0.05 * k);
            let off = Vector3::y() * if is_sighting_off { 1.5e-3 * (k - 20.0).clamp(0.0, 5.0) } else { 0.0 };
            let turned = angle(to) - angle(from);
            rot_o_b *= crate::geometry::exp_so3(&turned);
            let sighted = Some(rot_o_b * crate::geometry::exp_so3(&off));
            let covariance = Matrix3::identity() * 1.2e-3f64.squared();
            let frame =
                SeenTurn { covariance, rot_o_b: sighted, is_voted: false, ..turn([from, to], turned + off) };
            watch.update(&frame).is_some()
        })
    };
    assert!(!is_contradicted(true) && is_contradicted(false));
}

#[test]
fn a_dispute_that_is_over_leaves_the_yaw_alone_uncertain() {
    let imu = ImuConfig::with_noise(200.0, (1e-4, 1e-5), (1e-3, 1e-4));
    let mut watch = RotationWatch::new(&imu);
    watch.left_rad = 0.2;
    let nav =
        NavState { rot_o_b: crate::geometry::exp_so3(&Vector3::new(0.4, -0.3, 0.2)), ..NavState::default() };
    let up_b = nav.rot_o_b.inverse() * Vector3::z();
    let added = watch.added_covariance(&nav, &Vector3::zeros()).expect("something is left");
    let of_rotation = added.fixed_view::<3, 3>(NavState::ROT, NavState::ROT).into_owned();
    assert!((of_rotation - up_b * up_b.transpose() * 0.04).norm() < 1e-12, "{of_rotation}");
    let from = Timestamp::from_nanos(0);
    let mut disputed = Contradiction::begin(from, Vector3::zeros(), true);
    disputed.culprit = Culprit::Disputed;
    watch.contradiction = Some(disputed);
    let added = watch.added_covariance(&nav, &Vector3::zeros()).expect("something is left");
    let of_rotation = added.fixed_view::<3, 3>(NavState::ROT, NavState::ROT).into_owned();
    assert!((of_rotation - Matrix3::identity() * 0.04).norm() < 1e-12, "{of_rotation}");
}

/// Standard deviations of position, m, and heading, rad, after images have contradicted the gyroscope for half a second while this share of
/// the landmarks agreed with them.
fn left_after(agreeing_share: f64, is_force_wrong: bool) -> [f64; 2] {
    let imu = ImuConfig::with_noise(200.0, (1.7e-4, 2e-5), (2e-3, 3e-3));
    let mut watch = RotationWatch::new(&imu);
    for k in 0..160 {
        let t = f64::from(k) * 0.05;
        for sample in 0..10 {
            let t = t + f64::from(sample) * 0.005;
            watch.add(&ImuSample { stamp: at(t), gyro: rate(t), accel: Vector3::zeros() });
        }
        let slip = if (5.0..5.5).contains(&t) { Vector3::y() * 0.03 } else { Vector3::zeros() };
        let frame = SeenTurn {
            agreeing_share,
            speed_m_s: 1.0,
            is_force_contradicted: is_force_wrong && (4.5..5.5).contains(&t),
            ..turn([t - 0.05, t], angle(t) - angle(t - 0.05) + slip)
        };
        let _ = watch.update(&frame);
    }
    assert!(!watch.is_distrusting());
    let added = watch.added_covariance(&NavState::default(), &Vector3::zeros());
    let of = |part: usize| added.map_or(0.0, |added| added[(part, part)].sqrt());
    [of(NavState::P), of(NavState::ROT + 2)]
}

#[test]
fn images_that_a_crowd_may_carry_leave_position_and_heading_uncertain() {
    let alone = left_after(0.95, false);
    assert!(alone[0] < 0.15, "a dispute of 0.2 s: {alone:?}");
    for carried in [left_after(0.7, false), left_after(0.95, true)] {
        assert!(carried[0] > 4.0 * alone[0] && carried[1] > 2.0 * alone[1], "{carried:?}, {alone:?}");
    }
}

#[test]
fn turns_tell_cameras_that_were_turned_on_the_body_from_a_gyroscope_that_is_wrong() {
    type Change<'a> = &'a dyn Fn(Vector3<f64>) -> Vector3<f64>;
    let as_is = |v: Vector3<f64>| v;
    let turned = Vector3::new(0.1, -0.2, 0.15);
    let jump = |to_seen: Change<'_>, to_read: Change<'_>| {
        let mut watch = RotationWatch::new(&ImuConfig::with_noise(200.0, (1.7e-4, 2e-5), (2e-3, 3e-3)));
        (1..240).find_map(|k| {
            let [last_s, t] = [k - 1, k].map(|k| f64::from(k) * 0.05);
            let is_wrong = t > BEGIN_S;
            for n in 1..=10 {
                let t = last_s + f64::from(n) * 0.005;
                let gyro = if is_wrong { to_read(rate(t)) } else { rate(t) };
                watch.add(&ImuSample { stamp: at(t), gyro, accel: Vector3::zeros() });
            }
            if is_wrong && t < BEGIN_S + 0.2 {
                return None;
            }
            let turned = angle(t) - angle(last_s);
            let noise = angle(f64::from(k * k)) * 2e-4;
            watch.update(&turn([last_s, t], if is_wrong { to_seen(turned) } else { turned } + noise));
            watch.take_jump().map(|jump| (t, jump))
        })
    };
    let rotation = crate::geometry::exp_so3(&turned);
    let (t, found): (f64, Vector3<f64>) = jump(&|seen| rotation * seen, &as_is).unwrap();
    assert!(t < BEGIN_S + 1.0 && (found - turned).norm() < 0.02, "{t} {found:?}");
    let wrong: [Change<'_>; 4] =
        [&|v| Vector3::new(-v.x, v.y, v.z), &|v| Vector3::new(v.y, v.x, v.z), &|v| v * 1.2, &|v| {
            v + Vector3::x() * 0.3
        }];
    for (k, wrong) in wrong.into_iter().enumerate() {
        assert!(jump(&as_is, wrong).is_none(), "{k}");
    }
}
