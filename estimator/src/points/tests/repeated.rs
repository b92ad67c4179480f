//! The start before texture that repeats itself finely, around things of their own.

use super::scene::{HEIGHT, WIDTH, model};
use crate::points::{PointObservation, PointTracker, TrackerInput};
use crate::work_budget::InTurn;
use nalgebra::{Isometry3, UnitQuaternion};
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
    let images = [image(way_px, has_cells), image(way_px + DISPARITY_PX, has_cells)];
    let images = images.each_ref().map(|image| Some(image.view()));
    let input = TrackerInput { images, rot_prev_cur: UnitQuaternion::identity() };
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
