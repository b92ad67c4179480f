//! Pairs whose images are not of the same moment: the estimate stays right, and says so.

use super::synthetic::{World, config};
use super::trust_tests::{self, Judged, NONE, Trouble};
use super::*;
use nalgebra::Vector2;

/// Time after which a camera is late, s.
const BEGIN_S: f64 = 6.0;

/// Time at which a shifted image is back, s.
const BACK_S: f64 = 10.0;

/// A camera that is late.
#[derive(Clone, Copy)]
struct Late {
    camera: usize,
    frames: f64,
    /// True if the image that is repeated at the start of the fault is recognized.
    is_repeat_seen: bool,
}

/// A flight of 14 s.
struct Flown {
    /// Largest error of the position, m.
    largest_m: f64,
    /// When the pair was first said to be out of step, s after [`BEGIN_S`].
    named_s: Option<f64>,
    /// Times of the frames in which the cameras were said to disagree, s after it.
    disagree_s: Vec<f64>,
    /// Times of the frames in which an image was said to be frozen, s after it.
    frozen_s: Vec<f64>,
}

/// Flies with what is tracked as `spoil` leaves it.
fn fly_spoilt(spoil: impl Fn(&mut World, f64, &mut Tracked)) -> Flown {
    let trouble = Trouble { tracked: &spoil, ..NONE };
    let judged = trust_tests::fly(&mut World::new(&config(2), 5, 400), 14.0, &trouble);
    let said_s = |bits: &[HealthBits]| {
        let has = |pose: &&Judged| bits.iter().any(|bit| pose.health.contains(*bit));
        judged.iter().filter(has).map(|pose| pose.time_s - BEGIN_S).collect::<Vec<_>>()
    };
    Flown {
        largest_m: judged.iter().map(|pose| pose.error_m).fold(0.0, f64::max),
        named_s: said_s(&[HealthBits::CAMERAS_OUT_OF_STEP]).first().copied(),
        disagree_s: said_s(&[HealthBits::CAMERAS_DISAGREE]),
        frozen_s: said_s(&[HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN]),
    }
}

/// Flies with a camera that is late; returns the largest error of the position, m, and when that was said, s after it was.
fn fly(late: Late) -> (f64, Option<f64>) {
    let flown = fly_spoilt(|world, t, tracked| {
        if t <= BEGIN_S {
            return;
        }
        let before = world.observe(t - 0.05 * late.frames, [true; 2]);
        let is_repeated = late.is_repeat_seen && t < BEGIN_S + 0.05;
        if is_repeated {
            tracked.health.insert([HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN][late.camera]);
        }
        for point in &mut tracked.points {
            let seen = before.iter().find(|o| o.track_id == point.track_id).filter(|_| !is_repeated);
            point.px[late.camera] = seen.and_then(|o| o.px[late.camera]);
            point.xy[late.camera] = seen.and_then(|o| o.xy[late.camera]);
        }
        tracked.points.retain(|o| o.px.iter().any(Option::is_some));
    });
    (flown.largest_m, flown.named_s)
}

/// Flies with an image that is shifted by this much, normalized, until [`BACK_S`].
fn fly_shifted(camera: usize, by: Vector2<f64>) -> Flown {
    fly_spoilt(|_, t, tracked| {
        if (BEGIN_S..BACK_S).contains(&t) {
            for xy in tracked.points.iter_mut().filter_map(|point| point.xy[camera].as_mut()) {
                *xy += by;
            }
        }
    })
}

/// Flies with images that are those of [`BEGIN_S`], with noise of their own, for `frozen_s`.
fn fly_frozen(cameras: &[usize], frozen_s: f64) -> Flown {
    fly_spoilt(|world, t, tracked| {
        if !(BEGIN_S..BEGIN_S + frozen_s).contains(&t) {
            return;
        }
        let frozen = world.observe(BEGIN_S, [true; 2]);
        for point in &mut tracked.points {
            let seen = frozen.iter().find(|o| o.track_id == point.track_id);
            for camera in cameras {
                point.px[*camera] = seen.and_then(|o| o.px[*camera]);
                point.xy[*camera] = seen.and_then(|o| o.xy[*camera]);
            }
        }
        tracked.points.retain(|o| o.px.iter().any(Option::is_some));
    })
}

#[test]
fn a_pair_in_step_is_not_doubted() {
    let flown = fly_spoilt(|_, _, _| {});
    assert!(flown.largest_m < 0.05, "{} m", flown.largest_m);
    assert!(flown.named_s.is_none() && flown.frozen_s.is_empty() && flown.disagree_s.is_empty());
}

#[test]
fn images_that_freeze_in_flight_are_left_out_until_they_move_again() {
    let Flown { largest_m, frozen_s, .. } = fly_frozen(&[0, 1], 1.0);
    assert!(largest_m < 0.1, "{largest_m} m");
    assert!(frozen_s.first().is_some_and(|s| *s < 0.1), "{frozen_s:?}");
    assert!(frozen_s.last().is_some_and(|s| (0.9..1.1).contains(s)), "{frozen_s:?}");
}

#[test]
fn a_camera_that_freezes_in_flight_beside_one_that_does_not_disagrees_with_it() {
    for camera in [0, 1] {
        let Flown { largest_m, disagree_s, .. } = fly_frozen(&[camera], 1.0);
        assert!(largest_m < 0.05, "{camera}: {largest_m} m");
        assert!(disagree_s.first().is_some_and(|s| *s < 0.1), "{camera}: {disagree_s:?}");
        assert!(disagree_s.last().is_some_and(|s| *s < 2.5), "{camera}: {disagree_s:?}");
    }
}

#[test]
fn a_camera_that_is_late_since_it_repeated_an_image_is_left_out() {
    for camera in [0, 1] {
        let (largest_m, named_s) = fly(Late { camera, frames: 1.0, is_repeat_seen: true });
        assert!(largest_m < 0.1, "{camera}: {largest_m} m");
        assert!(named_s.is_some_and(|s| s < 2.0), "{camera}: {named_s:?}");
    }
}

#[test]
fn a_right_camera_that_is_late_unnoticed_is_named_and_left_out() {
    let (largest_m, named_s) = fly(Late { camera: 1, frames: 1.0, is_repeat_seen: false });
    assert!(largest_m < 0.3 && named_s.is_some_and(|s| s < 2.0), "{largest_m} m, {named_s:?}");
}

#[test]
fn a_camera_whose_image_is_shifted_is_left_out_from_its_first_frame_on() {
    let shifts = [(0, [0.02, 0.0]), (1, [-0.009, 0.0]), (0, [0.0, 0.012]), (1, [0.0, -0.012])];
    for (camera, [x, y]) in shifts {
        let Flown { largest_m, disagree_s, .. } = fly_shifted(camera, Vector2::new(x, y));
        let shift = format!("{camera}, ({x}, {y})");
        assert!(largest_m < 0.05, "{shift}: {largest_m} m");
        assert!(disagree_s.first().is_some_and(|s| *s < 0.1), "{shift}: {disagree_s:?}");
        let last_s = disagree_s.last().map_or(0.0, |s| s + BEGIN_S - BACK_S);
        assert!((0.0..1.0).contains(&last_s), "{shift}: used again {last_s} s after it is back");
    }
}
