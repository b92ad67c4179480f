//! No false confidence: while sensors fail and after it, errors stay within what the covariance says.

use super::synthetic::{World, config, stamp};
use super::*;
use crate::geometry::{log_so3, yaw_of};
use crate::input::ResetKind;
use crate::window::state::NavState;
use nalgebra::{Isometry3, SVector, UnitQuaternion};
use plumbline_config::ImuSample;
use std::ops::Range;

/// Troubles of the sensors.
#[derive(Clone, Copy)]
pub(super) struct Trouble<'a> {
    /// Changes an inertial sample at a time; `None` if it is lost.
    pub(super) imu: &'a dyn Fn(f64, ImuSample) -> Option<ImuSample>,
    /// Which cameras see.
    pub(super) alive: &'a dyn Fn(f64) -> [bool; 2],
    /// Age of the view in the frame of a stamp, s; `None` if no frame comes.
    pub(super) age_s: &'a dyn Fn(f64) -> Option<f64>,
    /// Changes what is tracked of the world in a frame.
    pub(super) tracked: &'a dyn Fn(&mut World, f64, &mut Tracked),
    /// A soft reset that somebody asks for, s.
    pub(super) reset_s: Option<f64>,
}

pub(super) const NONE: Trouble<'_> = Trouble {
    imu: &|_, sample| Some(sample),
    alive: &|_| [true; 2],
    age_s: &|_| Some(0.0),
    tracked: &|_, _, _| {},
    reset_s: None,
};

/// One pose against the truth.
pub(super) struct Judged {
    pub(super) time_s: f64,
    nees: f64,
    pub(super) error_m: f64,
    /// Errors of position and attitude along their largest, in standard deviations.
    pub(super) sigmas: [f64; 2],
    /// Normalized squared error of the velocity in the body over its expectation.
    pub(super) velocity_nees: f64,
    pub(super) quality: i8,
    pub(super) health: HealthBits,
    resets: u32,
}

/// Flies through the world, the truth brought to the first pose by position and yaw.
pub(super) fn fly(world: &mut World, duration_s: f64, trouble: &Trouble<'_>) -> Vec<Judged> {
    let mut odometer = Odometer::new(&world.config);
    let (mut tracked, mut feedback) = (Tracked::new(&world.config), Feedback::new(&world.config));
    let mut origin: Option<Isometry3<f64>> = None;
    let mut judged = Vec::new();
    // A track that is told to be wrong ends, and its point is tracked anew.
    let points = world.points_o.len() as u32;
    let mut ended = vec![0u32; world.points_o.len()];
    let mut waiting = std::collections::VecDeque::new();
    for k in 0..(duration_s * 20.0) as u32 {
        let t = 0.2 + f64::from(k) * 0.05;
        let seconds = |sample: &ImuSample| sample.stamp.seconds_since(stamp(0.0));
        waiting.extend(world.samples_to(t).into_iter().filter_map(|s| (trouble.imu)(seconds(&s), s)));
        let Some(age_s) = (trouble.age_s)(t) else { continue };
        while let Some(sample) = waiting.pop_front_if(|s: &mut ImuSample| s.stamp <= stamp(t + 0.0051)) {
            tracked.samples.push(sample);
        }
        tracked.points = world.observe(t - age_s, (trouble.alive)(t));
        tracked.health = HealthBits::default();
        (trouble.tracked)(world, t, &mut tracked);
        feedback.wrong_points.dedup();
        feedback.wrong_points.iter().for_each(|id| ended[(id % points) as usize] = id / points + 1);
        tracked.points.iter_mut().for_each(|o| o.track_id += points * ended[o.track_id as usize]);
        tracked.points.sort_by_key(|o| o.track_id);
        tracked.sequence = u64::from(k);
        tracked.time = FrameTime { stamp: stamp(t), time_offset_s: 0.0 };
        tracked.reset = trouble.reset_s.filter(|at| (t - at).abs() < 0.02).map(|_| ResetKind::Soft);
        let estimate = odometer.process(&tracked, &mut (), &mut feedback);
        tracked.samples.clear();
        let Some(pose) = estimate.pose() else { continue };
        let truth = world.pose_o_b(t);
        let expected = *origin.get_or_insert_with(|| anchored(pose, &truth)) * truth;
        let mut error = SVector::<f64, 6>::zeros();
        let p_error = pose.translation.vector - expected.translation.vector;
        error.fixed_rows_mut::<3>(0).copy_from(&p_error);
        error.fixed_rows_mut::<3>(3).copy_from(&log_so3(&(expected.rotation.inverse() * pose.rotation)));
        let covariance = estimate.covariance.fixed_view::<6, 6>(0, 0) + nalgebra::Matrix6::identity() * 1e-10;
        let rot_b_o = pose.rotation.inverse().to_rotation_matrix();
        let off_b = world.v_b(t) - rot_b_o * estimate.v_o_b;
        let of_velocity = estimate.covariance.fixed_view::<3, 3>(NavState::V, NavState::V);
        let of_velocity = rot_b_o.matrix() * of_velocity * rot_b_o.matrix().transpose();
        judged.push(Judged {
            time_s: t,
            velocity_nees: off_b.dot(&(of_velocity.try_inverse().unwrap() * off_b)) / 3.0,
            nees: (error.transpose() * covariance.try_inverse().unwrap() * error)[0] / 6.0,
            error_m: p_error.norm(),
            sigmas: [0, 3].map(|part| {
                let error = error.fixed_rows::<3>(part).into_owned();
                let covariance = covariance.fixed_view::<3, 3>(part, part).into_owned();
                (error.transpose() * covariance.try_inverse().unwrap() * error)[0].sqrt()
            }),
            quality: estimate.quality,
            health: estimate.health,
            resets: estimate.reset_counter,
        });
    }
    judged
}

/// The odometry frame in the truth's, by which `pose` is where and headed as the truth is.
pub(super) fn anchored(pose: &Isometry3<f64>, truth: &Isometry3<f64>) -> Isometry3<f64> {
    let yaw = yaw_of(&(pose.rotation * truth.rotation.inverse()));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts((pose.translation.vector - turn * truth.translation.vector).into(), turn)
}

/// Mean NEES over a span of time.
fn mean_nees(judged: &[Judged], span_s: Range<f64>) -> f64 {
    let within: Vec<f64> = judged.iter().filter(|j| span_s.contains(&j.time_s)).map(|j| j.nees).collect();
    assert!(!within.is_empty(), "no pose in {span_s:?}");
    within.iter().sum::<f64>() / within.len() as f64
}

/// Asserts that the errors were consistent with the covariance, during the trouble and five seconds after it.
fn assert_honest(name: &str, judged: &[Judged], span_s: &Range<f64>) {
    let during = mean_nees(judged, span_s.start..span_s.end + 1.0);
    let after = mean_nees(judged, span_s.end + 4.5..span_s.end + 5.5);
    let worst_m = judged.iter().map(|j| j.error_m).fold(0.0, f64::max);
    let resets = judged.last().map_or(0, |j| j.resets);
    println!("{name}: NEES {during:.2} during, {after:.2} after, worst {worst_m:.3} m, {resets} resets");
    assert!(during <= 10.0 && after <= 3.0, "{name}: NEES {during:.2} during, {after:.2} after");
}

fn has(judged: &[Judged], span_s: Range<f64>, bit: HealthBits) -> bool {
    judged.iter().any(|j| span_s.contains(&j.time_s) && j.health.contains(bit))
}

fn is_in(t: f64, begins: [f64; 3], length_s: f64) -> bool {
    begins.iter().any(|begin| (*begin..begin + length_s).contains(&t))
}

#[test]
fn gaps_of_fifty_and_of_two_hundred_milliseconds() {
    let fifty: fn(f64, ImuSample) -> Option<ImuSample> =
        |t, sample| (!is_in(t, [6.0, 7.0, 8.0], 0.05)).then_some(sample);
    let two_hundred: fn(f64, ImuSample) -> Option<ImuSample> =
        |t, sample| (!is_in(t, [6.0, 7.0, 8.0], 0.2)).then_some(sample);
    for seed in [1, 2] {
        for (name, imu) in [("50 ms", fifty), ("200 ms", two_hundred)] {
            let judged = fly(&mut World::new(&config(2), seed, 500), 14.2, &Trouble { imu: &imu, ..NONE });
            assert_honest(name, &judged, &(6.0..8.2));
            assert!(has(&judged, 6.0..6.3, HealthBits::IMU_GAP));
        }
    }
}

#[test]
fn a_sensor_at_the_ends_of_its_range_for_a_third_of_a_second() {
    let imu: fn(f64, ImuSample) -> Option<ImuSample> = |t, sample| {
        // A pattern without a mean.
        let mixed = ((t * 200.0).round() as u32).wrapping_mul(2_654_435_769);
        let sign = |k: u32| if (mixed >> (8 + k)) & 1 == 0 { 1.0 } else { -1.0 };
        let ends = |scale: f64| Vector3::new(sign(0), sign(3), sign(7)) * scale;
        let hit = ImuSample { gyro: ends(17.0), accel: ends(150.0), ..sample };
        Some(if (6.0..6.3).contains(&t) { hit } else { sample })
    };
    for seed in [1, 2] {
        let judged = fly(&mut World::new(&config(2), seed, 500), 12.2, &Trouble { imu: &imu, ..NONE });
        assert_honest("saturated", &judged, &(6.0..6.3));
        assert!(has(&judged, 6.0..6.4, HealthBits::IMU_SATURATED));
    }
}

#[test]
fn two_samples_that_lie_are_over_within_three_tenths_of_a_second() {
    let imu: fn(f64, ImuSample) -> Option<ImuSample> = |t, sample| {
        let lie = ImuSample { gyro: sample.gyro + Vector3::new(9.0, -7.0, 8.0), ..sample };
        Some(if (6.0..6.008).contains(&t) { lie } else { sample })
    };
    for seed in [1, 2] {
        let judged = fly(&mut World::new(&config(2), seed, 500), 12.2, &Trouble { imu: &imu, ..NONE });
        // Nobody knows who lies until the next frame has spoken.
        let after = mean_nees(&judged, 6.3..7.3);
        let worst_m = judged.iter().map(|j| j.error_m).fold(0.0, f64::max);
        assert!(after <= 3.0 && worst_m < 0.5, "NEES {after:.2} after, worst {worst_m:.3} m");
        assert!(has(&judged, 6.0..6.2, HealthBits::IMU_CONTRADICTED));
    }
}

/// In the frame of 6.5 s only so many points are known, all of them taken for others as far to the side.
fn mistake(known: usize, t: f64, tracked: &mut Tracked) {
    if (t - 6.5).abs() < 0.02 {
        tracked.points.truncate(known);
        for point in &mut tracked.points {
            point.px.iter_mut().flatten().for_each(|px| px.x += 60.0);
            point.xy.iter_mut().flatten().for_each(|xy| xy.x += 60.0 / 458.0);
        }
    }
}

#[test]
fn a_few_false_matches_after_a_hole_deceive_nobody() {
    let imu: fn(f64, ImuSample) -> Option<ImuSample> =
        |t, sample| (!(6.0..6.55).contains(&t)).then_some(sample);
    let alive: fn(f64) -> [bool; 2] = |t| [!(5.98..6.48).contains(&t); 2];
    for seed in [1, 2] {
        let trouble =
            Trouble { imu: &imu, alive: &alive, tracked: &|_, t, tracked| mistake(5, t, tracked), ..NONE };
        let judged = fly(&mut World::new(&config(2), seed, 500), 12.2, &trouble);
        assert_honest("false matches", &judged, &(6.0..6.55));
        assert!(judged.iter().any(|j| j.error_m > 0.1 && j.time_s < 6.6), "the matches did lead astray");
    }
}

#[test]
fn a_few_false_matches_after_missing_frames_are_not_believed_against_the_samples() {
    let age_s: fn(f64) -> Option<f64> = |t| (!(6.0..6.5).contains(&t)).then_some(0.0);
    for seed in [1, 2] {
        let trouble = Trouble { age_s: &age_s, tracked: &|_, t, tracked| mistake(8, t, tracked), ..NONE };
        let judged = fly(&mut World::new(&config(2), seed, 500), 8.2, &trouble);
        let worst_m = judged.iter().map(|j| j.error_m).fold(0.0, f64::max);
        assert!(worst_m < 0.1, "{seed}: {worst_m} m");
    }
}

#[test]
fn blind_for_longer_than_an_estimate_lives_and_then_started_anew() {
    let alive: fn(f64) -> [bool; 2] = |t| [!(5.0..11.0).contains(&t); 2];
    for seed in [1, 2] {
        let judged = fly(&mut World::new(&config(2), seed, 500), 17.0, &Trouble { alive: &alive, ..NONE });
        assert!(judged.last().unwrap().resets > 0);
        // Blind, and the second in which it starts anew where nobody saw it go.
        let during = mean_nees(&judged, 5.0..12.0);
        assert!(during <= 3.0, "NEES {during:.2}");
    }
}

#[test]
fn a_soft_reset_in_flight_forgets_nothing_of_what_is_not_known() {
    for seed in [1, 2] {
        let trouble = Trouble { reset_s: Some(6.2), ..NONE };
        let judged = fly(&mut World::new(&config(2), seed, 500), 12.2, &trouble);
        assert_eq!(judged.last().unwrap().resets, 1);
        assert_honest("reset", &judged, &(6.2..6.3));
    }
}

#[test]
fn cameras_that_are_knocked_are_a_reset_after_which_their_mounting_is_found_anew() {
    for (seed, turned_rad) in [(1, [0.03, 0.02, 0.0]), (2, [0.0, -0.1, 0.1])] {
        let knock = |world: &mut World, t: f64, _: &mut Tracked| {
            if (t - 6.0).abs() < 0.02 {
                let turn = crate::geometry::exp_so3(&turned_rad.into());
                world.pose_b_c.iter_mut().for_each(|pose| pose.rotation = turn * pose.rotation);
            }
        };
        let trouble = Trouble { tracked: &knock, ..NONE };
        let judged = fly(&mut World::new(&config(2), seed, 500), 14.0, &trouble);
        assert_eq!(judged.last().unwrap().resets, 1);
        assert!(judged.iter().all(|j| j.quality < 20 || j.sigmas.iter().all(|sigmas| *sigmas < 5.0)));
        assert!(judged.last().unwrap().quality > 50);
    }
}

#[test]
fn a_slow_drift_far_from_everything_is_no_rest() {
    for seed in [1, 2] {
        let mut world = World::new(&config(2), seed, 500);
        world.points_o.iter_mut().for_each(|p| *p *= 3.0);
        world.is_at_rest = true;
        world.drift_m_s = Vector3::new(0.008, 0.04, 0.0);
        world.sigma_px = 0.1;
        let judged = fly(&mut world, 20.0, &NONE);
        assert!(!has(&judged, 6.0..20.0, HealthBits::STATIONARY));
        assert_honest("drift", &judged, &(6.0..14.0));
    }
}

#[test]
fn a_start_in_full_flight_that_sees_only_far_things_finds_its_scale_and_knows_how_well() {
    // The scale of a flight is drawn once, by its start: NEES scatters from flight to flight, and its mean has to hold.
    let seeds = [2, 3, 4, 5, 6, 7];
    let mut nees = 0.0;
    for seed in seeds {
        let mut world = World::new(&config(2), seed, 500);
        world.points_o.iter_mut().for_each(|p| *p *= 8.0);
        world.sigma_px = 0.2;
        let judged = fly(&mut world, 10.2, &NONE);
        assert!(mean_nees(&judged, 0.3..5.7) <= 10.0, "seed {seed}");
        nees += mean_nees(&judged, 9.2..10.2) / seeds.len() as f64;
        let worst_m = judged.iter().map(|j| j.error_m).fold(0.0, f64::max);
        assert!(worst_m < 0.5, "{worst_m} m; everything is 40 m away or more");
    }
    assert!(nees <= 2.0, "NEES {nees:.2}");
}
