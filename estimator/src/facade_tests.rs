//! Front-end, window and propagation together when clocks jump: what is refused, and how soon there is a pose again.

use super::*;
use crate::estimate::HealthBits;
use crate::odometry::synthetic::{World, config, stamp};

const HOUR_S: f64 = 3600.0;
/// Beginning of the first fault, s.
const FAULT_S: f64 = 3.0;
/// In how long everything is well again after the last, s.
const RECOVERY_S: f64 = 1.0;
const END_S: f64 = 6.0;

/// By how much the stamps of samples and of frames are wrong at time `t`, s.
type Clocks = fn(t: f64) -> (f64, f64);

/// Counts of a flight.
#[derive(Debug, Default)]
struct Flown {
    samples_refused: u32,
    frames_refused: u32,
    resets: u32,
    /// Time of the last frame without a pose, s.
    last_without_pose: f64,
    /// Time of the last sample without odometry, s.
    last_without_odometry: f64,
    /// Position against the truth at the end, relative to where it was before the fault, m.
    error_m: f64,
}

/// A flight whose samples and frames come when they come, stamped as `clocks` says.
fn fly(clocks: Clocks) -> Flown {
    let setup = config(2);
    let mut world = World::new(&setup, 7, 300);
    let (mut front_end, mut odometer) = (FrontEnd::new(&setup), Odometer::new(&setup));
    let (mut tracked, mut feedback) = (Tracked::new(&setup), Feedback::new(&setup));
    let mut propagator = Propagator::new(&setup);
    let mut flown = Flown::default();
    let mut before = None;
    for k in 1..(END_S * 200.0) as u32 {
        let t = f64::from(k) * 0.005;
        let mut sample = world.imu(t, true);
        sample.stamp = sample.stamp.plus_seconds(clocks(t).0);
        flown.samples_refused += u32::from(!front_end.add_imu(&sample).is_accepted());
        match propagator.tick(&sample) {
            Some(odometry) => assert!(odometry.pose_o_b.translation.vector.norm() < 100.0, "{odometry:?}"),
            None => flown.last_without_odometry = t,
        }
        if k % 10 != 0 {
            continue;
        }
        // A frame of 5 ms ago: its samples are there.
        let t = t - 0.005;
        let frame = FrameInput::new(stamp(t).plus_seconds(clocks(t).1), [None, None]);
        let parts = [&mut (), &mut ()];
        front_end.track(&frame, &WorkBudget::FULL, &InTurn, parts, &mut tracked);
        if !tracked.health.contains(HealthBits::BAD_STAMP) {
            tracked.points = world.observe(t, [true; 2]);
        }
        front_end.apply_feedback(&feedback);
        let estimate = odometer.process(&tracked, &mut (), &mut feedback);
        propagator.correct(&estimate);
        flown.frames_refused += u32::from(estimate.is_refused());
        flown.resets = estimate.reset_counter;
        let Some(pose_o_b) = estimate.pose().copied() else {
            flown.last_without_pose = t;
            continue;
        };
        let truth = world.pose_o_b(t);
        if t < FAULT_S {
            before = Some(pose_o_b * truth.inverse());
        }
        let expected = before.expect("has started") * truth;
        flown.error_m = (pose_o_b.translation.vector - expected.translation.vector).norm();
    }
    flown
}

#[test]
fn one_stamp_an_hour_ahead_costs_the_sample_or_the_frame_and_nothing_else() {
    let sample = fly(|t| (if (t - FAULT_S).abs() < 1e-6 { HOUR_S } else { 0.0 }, 0.0));
    assert_eq!((sample.samples_refused, sample.frames_refused, sample.resets), (1, 0, 0), "{sample:?}");
    assert!(sample.last_without_odometry <= FAULT_S + 1e-6 && sample.error_m < 0.05, "{sample:?}");
    let frame = fly(|t| (0.0, if (t + 0.005 - FAULT_S).abs() < 1e-6 { HOUR_S } else { 0.0 }));
    assert_eq!((frame.samples_refused, frame.frames_refused, frame.resets), (0, 1, 0), "{frame:?}");
    assert!(frame.last_without_odometry < FAULT_S - 1.0 && frame.error_m < 0.05, "{frame:?}");
}

#[test]
fn a_stamp_that_could_be_right_is_put_right_by_those_that_follow() {
    let flown = fly(|t| (if (t - FAULT_S).abs() < 1e-6 { 0.3 } else { 0.0 }, 0.0));
    assert!(flown.samples_refused > 0 && flown.resets == 0, "{flown:?}");
    assert!(flown.last_without_odometry < FAULT_S + 0.5 && flown.error_m < 0.1, "{flown:?}");
}

#[test]
fn the_first_sample_may_be_stamped_an_hour_ahead() {
    let flown = fly(|t| (if t < 0.007 { HOUR_S } else { 0.0 }, 0.0));
    assert!(flown.last_without_pose < 1.0 && flown.last_without_odometry < 1.0, "{flown:?}");
}

/// Clocks that are set, and a second later at the latest there are poses and odometry, where the vehicle is.
fn recovers(clocks: Clocks, sane_s: f64) {
    let flown = fly(clocks);
    println!("{flown:?}");
    let deadline_s = sane_s + RECOVERY_S;
    assert!(flown.samples_refused + flown.frames_refused > 0, "{flown:?}");
    assert!(flown.last_without_pose < deadline_s && flown.last_without_odometry < deadline_s, "{flown:?}");
    assert!(flown.resets <= 2, "{flown:?}");
    // A start anew keeps the pose of the last frame before it, at up to 2 m/s.
    assert!(flown.error_m < 0.1 + 2.0 * f64::from(flown.resets), "{flown:?}");
}

#[test]
fn clocks_that_are_set_back_or_forward_for_good_cost_less_than_a_second() {
    recovers(|t| if t < FAULT_S { (0.0, 0.0) } else { (-HOUR_S, -HOUR_S) }, FAULT_S);
    recovers(|t| if t < FAULT_S { (0.0, 0.0) } else { (HOUR_S, HOUR_S) }, FAULT_S);
    recovers(|t| if t < FAULT_S { (0.0, 0.0) } else { (-2.0, -2.0) }, FAULT_S);
}

/// Half a second of stamps that are wrong by `offset_s`.
fn for_a_while(t: f64, offset_s: f64) -> f64 {
    if (FAULT_S..FAULT_S + 0.5).contains(&t) { offset_s } else { 0.0 }
}

#[test]
fn clocks_that_are_wrong_for_a_while_are_well_a_second_after_they_are_set_right() {
    let sane_s = FAULT_S + 0.5;
    recovers(|t| (for_a_while(t, -HOUR_S), for_a_while(t, -HOUR_S)), sane_s);
    recovers(|t| (for_a_while(t, HOUR_S), for_a_while(t, HOUR_S)), sane_s);
    recovers(|t| (for_a_while(t, -HOUR_S), 0.0), sane_s);
    recovers(|t| (for_a_while(t, HOUR_S), 0.0), sane_s);
    recovers(|t| (0.0, for_a_while(t, HOUR_S)), sane_s);
    recovers(|t| (0.0, for_a_while(t, -HOUR_S)), sane_s);
    recovers(|t| (for_a_while(t, 1.5), for_a_while(t, 1.5)), sane_s);
}

#[test]
fn a_hard_reset_forgets_every_stamp() {
    let setup = config(2);
    let mut world = World::new(&setup, 7, 300);
    let mut front_end = FrontEnd::new(&setup);
    let frame = |seconds: f64| FrameInput::new(stamp(seconds), [None, None]);
    let mut tracked = Tracked::new(&setup);
    let mut is_refused = |front_end: &mut FrontEnd, seconds: f64| {
        front_end.track(&frame(seconds), &WorkBudget::FULL, &InTurn, [&mut (), &mut ()], &mut tracked);
        tracked.health.contains(HealthBits::BAD_STAMP)
    };
    assert_eq!(front_end.add_imu(&world.imu(HOUR_S, true)), ImuAdmission::Accepted);
    assert!(!is_refused(&mut front_end, HOUR_S));
    assert_eq!(front_end.add_imu(&world.imu(1.0, true)), ImuAdmission::NotLater);
    assert!(is_refused(&mut front_end, 1.0));
    front_end.reset(ResetKind::Hard);
    assert_eq!(front_end.add_imu(&world.imu(1.005, true)), ImuAdmission::Accepted);
    assert!(!is_refused(&mut front_end, 1.0));
}
