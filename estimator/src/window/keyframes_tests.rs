use super::super::frame::Frame;
use super::super::landmark::{Landmark, Observation};
use super::super::reprojection::{InversePoint, PointMeasurement};
use super::super::state::{FrameTime, NavState};
use nalgebra::{Matrix2, Vector2, Vector3};
use plumbline_config::{Config, Timestamp};

use super::*;

/// A frame: when it was taken (s), where along x (m), and whether it is a keyframe.
type At = (f64, f64, bool);

fn window(frames: &[At]) -> Window {
    let mut window = Window::new(Config::preset("sim").expect("is good").setup());
    window.clear();
    window.options.keyframes = 3;
    window.options.recent_frames = 2;
    for &(t, x, is_keyframe) in frames {
        push(&mut window, (t, x, is_keyframe));
    }
    window
}

fn push(window: &mut Window, (t, x, is_keyframe): At) {
    let nav = NavState { p_o_b: Vector3::new(x, 0.0, 0.0), ..NavState::default() };
    let time = FrameTime { stamp: Timestamp::from_nanos(0).plus_seconds(t), time_offset_s: 0.0 };
    window.push_frame(time, nav, None, false);
    window.frames.last_mut().expect("was pushed").is_keyframe = is_keyframe;
}

/// A landmark of frame `host` that is seen there and in `others`.
fn landmark(track_id: u32, host: u8, others: &[u8]) -> Landmark<InversePoint> {
    let measured = PointMeasurement {
        xy: Vector2::zeros(),
        xy_rate: Vector2::zeros(),
        weight: Matrix2::identity(),
        row: Default::default(),
    };
    let seen = std::iter::once(host).chain(others.iter().copied());
    Landmark {
        track_id,
        host,
        host_camera: 0,
        is_triangulated: true,
        feature: InversePoint { xy: Vector2::zeros(), rho: 0.2 },
        observations: seen.map(|frame| Observation { frame, camera: 0, measured }).collect(),
    }
}

/// When the frames were taken, ms.
fn times(window: &Window) -> Vec<i64> {
    window.frames.iter().map(|f: &Frame| f.stamp.as_nanos() / 1_000_000).collect()
}

#[test]
fn a_new_keyframe_is_needed_when_tracks_have_gone_or_time_has_passed() {
    let mut window = window(&[(0.0, 0.0, false)]);
    assert!(window.needs_keyframe(0, 0), "there is none yet");
    window.frames[0].is_keyframe = true;
    push(&mut window, (0.1, 0.0, false));
    window.options.min_connected_ratio = 0.7;
    window.options.max_keyframe_interval_s = 2.0;
    assert!(!window.needs_keyframe(70, 100));
    assert!(window.needs_keyframe(69, 100), "too few are linked to landmarks");
    assert!(!window.needs_keyframe(0, 0), "a blind frame hosts nothing");
    push(&mut window, (2.2, 0.0, false));
    assert!(window.needs_keyframe(100, 100), "the last one is too old");
    assert!(!window.needs_keyframe(0, 0));
}

#[test]
fn a_frame_that_is_no_keyframe_goes_when_it_is_no_longer_recent() {
    let mut window = window(&[
        (0.0, 0.0, true),
        (0.1, 0.1, false),
        (0.2, 0.2, true),
        (0.3, 0.3, false),
        (0.4, 0.4, false),
    ]);
    window.make_room();
    assert_eq!(times(&window), [0, 200, 300, 400]);
}

#[test]
fn of_too_many_keyframes_one_whose_landmarks_are_out_of_sight_goes_first() {
    let frames: Vec<At> = (0..4).map(|k| (0.1 * f64::from(k), f64::from(k), true)).collect();
    let mut window = window(&frames);
    // The first is still seen by the newest, the second no more.
    window.points.insert(landmark(1, 0, &[3]));
    window.points.insert(landmark(2, 1, &[2]));
    window.make_room();
    assert_eq!(times(&window), [0, 200, 300]);
    assert!(window.points.of_track(2).is_none(), "its landmark is part of the prior");
}

#[test]
fn a_keyframe_whose_landmarks_are_still_seen_stays_if_a_tenth_of_them_is() {
    let frames: Vec<At> = (0..4).map(|k| (0.1 * f64::from(k), f64::from(k), true)).collect();
    let mut window = window(&frames);
    for k in 0..10 {
        window.points.insert(landmark(k, 0, if k == 0 { &[1, 3] } else { &[1] }));
        window.points.insert(landmark(100 + k, 1, &[3]));
    }
    assert_eq!(window.forgotten_keyframe(), None, "one of ten is enough");
    window.points.retain(|l| l.track_id != 0);
    assert_eq!(window.forgotten_keyframe(), Some(0));
}

#[test]
fn among_keyframes_in_sight_the_one_in_a_crowd_far_behind_goes() {
    // Three close together a long way back, and the two newest.
    let places = [0.0, 5.0, 5.1, 9.0, 10.0];
    let frames: Vec<At> = (0..).zip(places).map(|(k, x)| (0.1 * f64::from(k), x, true)).collect();
    let mut window = window(&frames);
    for host in 0..3 {
        window.points.insert(landmark(u32::from(host), host, &[4]));
    }
    assert_eq!(window.forgotten_keyframe(), None);
    // Both of the pair are crowded; the one farther from the newest goes.
    assert_eq!(window.crowded_keyframe(), Some(1));
    let removable: Vec<usize> = window.removable().collect();
    assert_eq!(removable, [0, 1, 2], "the two newest never go");
}

#[test]
fn keyframes_at_one_place_are_told_apart_without_dividing_by_zero() {
    let frames: Vec<At> = (0..5).map(|k| (0.1 * f64::from(k), 0.0, true)).collect();
    let mut window = window(&frames);
    for host in 0..3 {
        window.points.insert(landmark(u32::from(host), host, &[4]));
    }
    assert_eq!(window.crowded_keyframe(), Some(0), "ties go to the oldest");
    window.make_room();
    assert_eq!(window.frames.len(), 3);
}
