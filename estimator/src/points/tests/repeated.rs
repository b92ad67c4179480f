//! Points among equal cells, which move by more than half a cell from frame to frame.

use crate::points::prediction::PredictedMotion;
use crate::points::{PointObservation, PointTracker, TrackerInput};
use crate::work_budget::InTurn;
use nalgebra::{Isometry3, UnitQuaternion, Vector2};
use plumbline_config::camera::Distortion;
use plumbline_config::options::PointsConfig;
use plumbline_config::{CameraModel, GrayImage};
use std::collections::BTreeMap;

const SIZE: (usize, usize) = (320, 240);
const FOCAL_PX: f64 = 260.0;
const BASELINE_M: f64 = 0.11;
const DEPTH_M: f64 = 3.0;
/// Period of the cells, px.
const CELL_PX: f64 = 8.0;
/// Way of a point from frame to frame, px.
const STEP_PX: f64 = 5.2;

/// A wall of equal cells with a spot of its own here and there, shifted by `shift` px.
fn image(shift: Vector2<f64>) -> GrayImage {
    let wave = |x: f64| (x * std::f64::consts::TAU / CELL_PX).sin();
    let cell = |x: f64, y: f64| 128.0 + 50.0 * wave(x).clamp(-0.6, 0.6) * (1.0 + wave(y).clamp(-0.6, 0.6));
    let spot = |x: f64, y: f64| {
        let place = |v: f64| (v / 34.0).floor();
        let (column, row) = (place(x), place(y));
        let draw =
            |k: f64| (((column * 12.9898 + row * 78.233 + k).sin() * 43_758.545_3).fract() - 0.5) * 14.0;
        let (dx, dy) = (x - 34.0 * (column + 0.5) - draw(1.0), y - 34.0 * (row + 0.5) - draw(2.0));
        let far = (dx / (2.5 + draw(3.0).abs() * 0.2)).powi(2) + (dy / (2.5 + draw(4.0).abs() * 0.2)).powi(2);
        -90.0 * (-0.5 * far).exp()
    };
    let pixels = (0..SIZE.0 * SIZE.1).map(|k| {
        let (x, y) = ((k % SIZE.0) as f64 + shift.x, (k / SIZE.0) as f64 + shift.y);
        (cell(x, y) + spot(x, y)).clamp(0.0, 255.0) as u8
    });
    GrayImage::from_pixels(SIZE.0, SIZE.1, pixels.collect()).expect("an image of this size")
}

/// A flight along the wall: what is seen in each frame, where the way is told to be `told` times the true one.
fn fly(frames: usize, told: impl Fn(usize) -> Option<f64>) -> Vec<Vec<PointObservation>> {
    let camera = CameraModel {
        width_px: SIZE.0,
        height_px: SIZE.1,
        focal_px: Vector2::repeat(FOCAL_PX),
        centre_px: Vector2::new(159.5, 119.5),
        distortion: Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
    };
    let options = PointsConfig { max_points: 100, cell_px: 24, ..PointsConfig::default() };
    let mut tracker = PointTracker::new(&options, &[camera, camera]);
    let right = Isometry3::translation(BASELINE_M, 0.0, 0.0);
    tracker.set_extrinsics(&[Isometry3::identity(), right]);
    let frame = |k: usize| {
        let shift = Vector2::new(STEP_PX * k as f64, 0.0);
        let images = [image(shift), image(shift + Vector2::x() * (BASELINE_M * FOCAL_PX / DEPTH_M))];
        if let Some(share) = told(k) {
            let way = Isometry3::translation(share * STEP_PX * DEPTH_M / FOCAL_PX, 0.0, 0.0);
            let motion = PredictedMotion { pose_prev_cur_b: way, pose_prev_known_b: way, sigma_m: 5e-4 };
            tracker.set_prediction(Some(&motion), &[]);
        } else {
            tracker.set_prediction(None, &[]);
        }
        let images = [Some(images[0].view()), Some(images[1].view())];
        tracker
            .track(&TrackerInput { images, rot_prev_cur: UnitQuaternion::identity() }, &InTurn, &mut ())
            .to_vec()
    };
    (0..frames).map(frame).collect()
}

/// Steps of all tracks over the last frames, and how many of them are off by more than a pixel.
fn steps(frames: &[Vec<PointObservation>]) -> (usize, usize) {
    let (mut all, mut wrong) = (0, 0);
    for pair in frames.windows(2) {
        let before: BTreeMap<u32, _> = pair[0].iter().map(|o| (o.track_id, o.px[0])).collect();
        for (then, now) in pair[1].iter().filter_map(|o| Some(((*before.get(&o.track_id)?)?, o.px[0]?))) {
            all += 1;
            wrong += usize::from((now - then + Vector2::x() * STEP_PX).norm() > 1.0);
        }
    }
    (all, wrong)
}

#[test]
fn points_among_equal_cells_are_followed_where_they_are_predicted() {
    let predicted = fly(14, |k| (k >= 4).then_some(1.0));
    let alone = fly(14, |_| None);
    let ((all, wrong), (few, _)) = (steps(&predicted[8..]), steps(&alone[8..]));
    assert!(all > few * 3 / 2 && wrong * 50 <= all, "{wrong} of {all} wrong; {few} without a prediction");
}

#[test]
fn a_wrong_prediction_is_refused_and_ends_the_points_that_hang_on_it() {
    let right = fly(12, |k| (k >= 4).then_some(1.0));
    let wrong = fly(12, |k| (k >= 4).then_some(if k < 9 { 1.0 } else { 0.6 }));
    assert!(
        2 * wrong[10].len() < 2 * right[10].len() - right[10].len() / 2,
        "{} {}",
        wrong[10].len(),
        right[10].len()
    );
    let (all, off) = steps(&wrong[9..]);
    assert!(off * 10 <= all, "{off} of {all} follow it");
}
