//! Forces that images contradict, on a flight whose motion is known.

use super::*;
use crate::inertial::Preintegration;

const PERIOD_S: f64 = 0.05;
/// When something goes wrong, s.
const BEGIN_S: f64 = 3.0;
const GRAVITY_O: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
const NOISE: ImuNoise = ImuNoise { gyro_density: 1.7e-4, accel_density: 2e-3, ..ImuNoise::NONE };

fn position(t: f64) -> Vector3<f64> {
    Vector3::new(1.5 * libm::sin(1.1 * t), libm::cos(1.7 * t), 0.4 * libm::sin(2.3 * t))
}

fn acceleration(t: f64) -> Vector3<f64> {
    let h = 1e-4;
    (position(t + h) - 2.0 * position(t) + position(t - h)) / (h * h)
}

/// Motion from `t` on, as a sensor measures it whose forces are off by `wrong(t)`.
fn motion(t: f64, wrong: &impl Fn(f64) -> Vector3<f64>) -> Preintegration {
    let mut motion = Preintegration::new(&Vector3::zeros(), &Vector3::zeros());
    let force = |t: f64| acceleration(t) - GRAVITY_O + wrong(t);
    for k in 0..10 {
        let at = t + f64::from(k) * 0.005;
        motion.integrate(0.005, &Vector3::zeros(), &force(at), &force(at + 0.005), &NOISE);
    }
    motion
}

/// Time since something went wrong of each frame that contradicts, s, and how far off its forces may be, m/s².
fn found(wrong: impl Fn(f64) -> Vector3<f64>, stamp_sigma_s: f64) -> Vec<(f64, f64)> {
    let sighted = |k: i32| {
        let t = f64::from(k) * PERIOD_S;
        let late_s = stamp_sigma_s * libm::sin(f64::from(k * k));
        position(t + late_s) + Vector3::repeat(1e-3 * libm::sin(f64::from(3 * k * k)))
    };
    found_by(|k| sighted(k) - sighted(k - 1), 1.6e-5, wrong, stamp_sigma_s)
}

/// [`found`] where frame `k` shows the way `moved(k)`, whose end has this variance, m².
fn found_by(
    moved: impl Fn(i32) -> Vector3<f64>,
    variance: f64,
    wrong: impl Fn(f64) -> Vector3<f64>,
    stamp_sigma_s: f64,
) -> Vec<(f64, f64)> {
    let mut watch = ForceWatch::new(GRAVITY_O);
    let sigmas = ForceSigmas { noise: NOISE, bias_m_s2: 0.03, tilt_rad: 2e-3 };
    let mut frames = Vec::new();
    for k in 0..160 {
        let t = f64::from(k) * PERIOD_S;
        let motion = motion(t - PERIOD_S, &wrong);
        let seen = SeenMotion {
            stamp: Timestamp::from_nanos((t * 1e9) as i64),
            moved: moved(k),
            covariance: Matrix3::identity() * variance,
            rot_o_before: UnitQuaternion::identity(),
            motion: &motion,
            v_o_b: Vector3::new(2.0, 0.0, 0.0),
            stamp_sigma_s,
            blow_m_s2: None,
        };
        frames.extend(watch.update(&seen, &sigmas).map(|wrong| (t - BEGIN_S, wrong.sigma_m_s2)));
    }
    frames
}

/// A force along an axis from [`BEGIN_S`] on, for so long.
fn pulse(axis: usize, force_m_s2: f64, length_s: f64) -> impl Fn(f64) -> Vector3<f64> {
    move |t| Vector3::ith(axis, if (BEGIN_S..BEGIN_S + length_s).contains(&t) { force_m_s2 } else { 0.0 })
}

#[test]
fn forces_that_agree_are_not_contradicted() {
    assert_eq!(found(|_| Vector3::zeros(), 0.0), []);
    assert_eq!(found(|_| Vector3::repeat(0.1), 0.0), [], "a bias");
    assert_eq!(found(|_| Vector3::zeros(), 4e-3), [], "stamps known to be wrong");
}

#[test]
fn what_every_frame_is_sighted_off_by_is_no_force() {
    // The window knows the way, and each frame is sighted by itself.
    let off = |k: i32| Vector3::x() * 0.1 * libm::sin(f64::from(7 * k * k));
    let moved = |k: i32| position(f64::from(k) * PERIOD_S) - position(f64::from(k - 1) * PERIOD_S) + off(k);
    assert_eq!(found_by(moved, 5e-3, |_| Vector3::zeros(), 0.0), []);
}

#[test]
fn a_blow_is_found_within_two_frames_and_forgotten_within_a_second() {
    for (axis, force_m_s2, length_s) in [(0, 30.0, 0.1), (1, -60.0, 0.3), (2, 15.0, 0.3)] {
        let found = found(pulse(axis, force_m_s2, length_s), 0.0);
        let (first, last) = (found.first().expect("is found"), found.last().expect("is found"));
        assert!(first.0 <= 2.0 * PERIOD_S + 1e-9, "{axis}: {first:?}");
        assert!(last.0 < length_s + 1.0, "{axis}: {last:?}");
    }
}

#[test]
fn a_step_is_contradicted_for_as_long_as_it_lasts() {
    for force_m_s2 in [3.0, -9.81] {
        let found = found(pulse(0, force_m_s2, 100.0), 0.0);
        assert!(found[0].0 < 0.3, "{force_m_s2}: {:?}", found[0]);
        assert!(found.len() > 90 && found.iter().all(|(_, sigma)| *sigma > 0.5 * force_m_s2.abs()));
    }
}

#[test]
fn a_frame_that_was_not_sighted_ends_a_span_and_a_contradiction_that_is_over() {
    let mut watch = ForceWatch::new(GRAVITY_O);
    watch.last = Some((Timestamp::from_nanos(0), 10.0));
    let doubted = watch.pass_over(Timestamp::from_nanos(900_000_000));
    assert!(doubted.is_some() && watch.is_contradicted());
    let _ = watch.pass_over(Timestamp::from_nanos(1_100_000_000));
    assert!(!watch.is_contradicted());
}

#[test]
fn an_accelerometer_that_was_named_has_to_be_seen_to_agree() {
    let at = |s: f64| Timestamp::from_nanos((s * 1e9) as i64);
    let mut watch = ForceWatch::new(GRAVITY_O);
    (watch.last, watch.is_named, watch.named) = (Some((at(0.0), 14.0)), true, Some(at(0.0)));
    for k in 1..98 {
        assert!(watch.pass_over(at(f64::from(k) * PERIOD_S)).is_some(), "{k}");
    }
    watch.settle(at(5.8));
    assert!(watch.is_contradicted(), "seen to agree for 0.95 s");
    watch.settle(at(5.9));
    assert!(!watch.is_contradicted());
    (watch.last, watch.is_named) = (Some((at(0.0), 14.0)), true);
    (1..200).for_each(|k| _ = watch.pass_over(at(f64::from(k) * PERIOD_S)));
    assert!(!watch.is_contradicted(), "not for ever where nobody sees it");
}
