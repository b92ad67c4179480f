//! The start before texture that repeats itself finely, around things of their own.

use super::scene::{HEIGHT, WIDTH, model};
use crate::points::prediction::{KnownPoint, PredictedMotion};
use crate::points::{PointObservation, PointTracker, TrackerInput};
use crate::work_budget::InTurn;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::options::PointsConfig;
use plumbline_config::{GrayImage, Random};

/// Shift from the left to the right image: a depth of 2 m.
const DISPARITY_PX: i32 = 14;
const BASELINE_M: f64 = 0.11;

/// Bright rectangles of several sizes, whose corners are the strongest, before a wall of equal cells or of noise.
fn image(shift_px: i32, has_cells: bool) -> GrayImage {
    let mut random = Random::new(5);
    let level = |x: i32, y: i32| {
        let (place, inside) = ((x.div_euclid(53), y.div_euclid(47)), (x.rem_euclid(53), y.rem_euclid(47)));
        let size =
            (9 + (7 * place.0 + 3 * place.1).rem_euclid(8), 8 + (5 * place.0 + 2 * place.1).rem_euclid(9));
        match (inside.0 < size.0 && inside.1 < size.1, x.rem_euclid(5) < 2 && y.rem_euclid(5) < 3) {
            (true, _) => 240.0,
            (false, true) if has_cells => 40.0,
            _ => 90.0,
        }
    };
    let pixel = |k: usize| level((k % WIDTH) as i32 + shift_px, (k / WIDTH) as i32);
    let pixels = (0..WIDTH * HEIGHT).map(|k| (pixel(k) + random.gaussian()) as u8).collect();
    GrayImage::from_pixels(WIDTH, HEIGHT, pixels).unwrap()
}

fn tracker() -> PointTracker {
    let options = PointsConfig { max_points: 80, cell_px: 24, ..PointsConfig::default() };
    let mut tracker = PointTracker::new(&options, &[model(), model()]);
    tracker.set_extrinsics(&[Isometry3::identity(), Isometry3::translation(BASELINE_M, 0.0, 0.0)]);
    tracker
}

fn show(tracker: &mut PointTracker, has_cells: bool) -> Vec<PointObservation> {
    show_moved(tracker, has_cells, 0)
}

/// Shows the view after the cameras moved sideways by so many pixels.
fn show_moved(tracker: &mut PointTracker, has_cells: bool, way_px: i32) -> Vec<PointObservation> {
    show_turned(tracker, has_cells, way_px, UnitQuaternion::identity())
}

/// Shows the view after the cameras moved sideways by so many pixels, and the gyroscope turned by `rot_prev_cur`.
fn show_turned(
    tracker: &mut PointTracker,
    has_cells: bool,
    way_px: i32,
    rot_prev_cur: UnitQuaternion<f64>,
) -> Vec<PointObservation> {
    let images = [image(way_px, has_cells), image(way_px + DISPARITY_PX, has_cells)];
    let images = images.each_ref().map(|image| Some(image.view()));
    let input = TrackerInput { images, rot_prev_cur };
    tracker.track(&input, &InTurn, &mut ()).to_vec()
}

fn pairs(seen: &[PointObservation]) -> usize {
    seen.iter().filter(|point| point.px.iter().all(Option::is_some)).count()
}

#[test]
fn before_fine_cells_the_start_is_that_of_one_camera_until_there_is_a_state() {
    let mut tracker = tracker();
    for _ in 0..3 {
        let seen = show(&mut tracker, true);
        assert!(
            tracker.is_repeating() && seen.len() > 20 && pairs(&seen) == 0,
            "{} of {}",
            pairs(&seen),
            seen.len()
        );
    }
    tracker.set_state_known(true);
    let paired = (0..3).map(|_| pairs(&show(&mut tracker, true))).max().unwrap();
    assert!(paired > 5, "{paired}");
    // A start after a reset.
    tracker.reset();
    assert_eq!(pairs(&show(&mut tracker, true)), 0);
}

#[test]
fn without_cells_points_are_paired_from_the_first_frame() {
    let mut tracker = tracker();
    let seen = show(&mut tracker, false);
    assert!(!tracker.is_repeating() && pairs(&seen) > 10, "{} of {}", pairs(&seen), seen.len());
}

/// Cells that come into view before the window has a state: what was paired is seen by one camera alone.
#[test]
fn pairs_of_before_end_where_cells_come_into_view_during_the_start() {
    let mut tracker = tracker();
    show(&mut tracker, false);
    let mut paired = Vec::new();
    for k in 1..80 {
        let was_told = tracker.is_repeating();
        let seen = show_moved(&mut tracker, true, 4 * k);
        if was_told {
            paired.push(pairs(&seen));
        }
    }
    assert!(paired.len() > 20 && paired.iter().all(|&count| count == 0), "{paired:?}");
}

/// Cells that come into view during a flight: what was matched before they were noticed is not followed any further.
#[test]
fn tracks_of_before_end_where_cells_come_into_view_in_flight() {
    let mut tracker = tracker();
    let newest = |seen: &[PointObservation]| seen.iter().map(|point| point.track_id).max().unwrap();
    let mut newest_before = newest(&show(&mut tracker, false));
    tracker.set_state_known(true);
    for k in 1..80 {
        let was_told = tracker.is_repeating();
        let seen = show_moved(&mut tracker, true, 4 * k);
        if was_told {
            assert!(seen.len() > 5 && seen.iter().all(|point| point.track_id > newest_before), "{k}");
            return;
        }
        if !tracker.is_repeating() {
            newest_before = newest(&seen);
        }
    }
    panic!("is not noticed");
}

/// Shows the view of cameras at rest, for which the inertial samples predict `turn`, rad; returns how many tracks went on.
fn show_predicted(tracker: &mut PointTracker, turn: Vector3<f64>) -> usize {
    let motion = PredictedMotion {
        pose_prev_cur_b: Isometry3::new(Vector3::new(0.0, 0.0, 1e-3), turn),
        pose_prev_known_b: Isometry3::identity(),
        sigma_m: 1e-3,
    };
    tracker.set_prediction(Some(&motion), &[]);
    let seen = show_turned(tracker, true, 0, UnitQuaternion::from_scaled_axis(turn));
    seen.iter().filter(|point| point.age > 1).count()
}

#[test]
fn before_cells_a_gyroscope_that_turns_while_the_view_rests_is_told_by_corners_of_their_own() {
    let mut tracker = tracker();
    tracker.set_state_known(true);
    (0..8).for_each(|_| {
        show_predicted(&mut tracker, Vector3::zeros());
    });
    let followed = show_predicted(&mut tracker, Vector3::zeros());
    assert!(followed > 20 && tracker.turn().is_some_and(|turn| !turn.is_other), "{:?}", tracker.turn());
    // Half a cell in the image, and more than one.
    for turn in [Vector3::new(0.0, 0.01, 0.0), Vector3::new(-0.022, 0.0, 0.0)] {
        let left = show_predicted(&mut tracker, turn);
        let seen = tracker.turn().expect("corners agree");
        assert!(seen.is_other && seen.rot_prev_cur_b.angle() < 2e-3, "{turn:?}: {seen:?}");
        assert!(10 * left > 9 * followed, "{turn:?}: {left} of {followed}");
    }
}

/// A wall of equal cells 10 px apart, and nothing else.
fn wall() -> GrayImage {
    let mut random = Random::new(6);
    let level = |x: usize, y: usize| if x % 10 < 4 && y % 10 < 5 { 40.0 } else { 90.0 };
    let pixels =
        (0..WIDTH * HEIGHT).map(|k| (level(k % WIDTH, k / WIDTH) + random.gaussian()) as u8).collect();
    GrayImage::from_pixels(WIDTH, HEIGHT, pixels).unwrap()
}

#[test]
fn before_wide_cells_points_that_most_missed_are_found_where_most_agree_about_it() {
    let (mut tracker, image) = (tracker(), wall());
    tracker.set_state_known(true);
    let mut known: Vec<KnownPoint> = Vec::new();
    let mut followed = Vec::new();
    for turn in [0.0, 0.0, 0.0, 0.01, 0.0] {
        let pose_prev_cur_b = Isometry3::new(Vector3::zeros(), Vector3::new(0.0, turn, 0.0));
        let motion =
            PredictedMotion { pose_prev_cur_b, pose_prev_known_b: Isometry3::identity(), sigma_m: 1e-3 };
        tracker.set_prediction(Some(&motion), &known);
        let input = TrackerInput {
            images: [Some(image.view()), Some(image.view())],
            rot_prev_cur: UnitQuaternion::identity(),
        };
        let seen = tracker.track(&input, &InTurn, &mut ());
        followed.push(seen.iter().filter(|point| point.age > 1).count());
        let far = |point: &PointObservation| {
            Some(KnownPoint { track_id: point.track_id, xy: point.xy[0]?, rho: 0.1, rho_sigma: 1e-3 })
        };
        known = seen.iter().filter_map(far).collect();
    }
    assert!(tracker.is_repeating() && followed[2] > 20, "{followed:?}");
    assert!(followed[3] > 20 && followed[4] > 20, "a turn of 2.6 px: {followed:?}");
}
