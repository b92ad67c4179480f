//! Trials of predictions in a room whose truth is known.

use super::super::test_room::{Room, always};
use super::*;
use crate::geometry::exp_so3;
use nalgebra::Vector2;

const EXPECTED: Expected = Expected { velocity_sigma_m_s: 0.01, stamp_sigma_s: 0.0 };

/// A window without disturbance, whose newest frame is predicted somewhere else.
fn predicted_off(off_m: Vector3<f64>, turn_rad: Vector3<f64>) -> Window {
    let mut window = Room { disturbance: 0.0, sees: always, ..Room::default() }.window();
    if let Some(newest) = window.frames.last_mut() {
        newest.nav.p_o_b += off_m;
        newest.nav.rot_o_b *= exp_so3(&turn_rad);
    }
    window
}

fn trial(window: &Window, expected: &Expected) -> Trial {
    window.try_prediction(expected, None).expect("enough landmarks are known")
}

/// Moves what the newest frame sees of one landmark in `one_in` by a tenth of the focal length.
fn with_movers(mut window: Window, one_in: usize) -> Window {
    let last = window.frames.len() - 1;
    for landmark in window.points.all_mut().iter_mut().step_by(one_in) {
        for observation in landmark.observations.iter_mut().filter(|o| usize::from(o.frame) == last) {
            observation.measured.xy += Vector2::new(0.1, 0.0);
        }
    }
    window
}

#[test]
fn a_right_prediction_is_backed_and_not_in_doubt() {
    let trial = trial(&predicted_off(Vector3::zeros(), Vector3::zeros()), &EXPECTED);
    assert!(trial.is_backed() && !trial.is_doubtful() && !trial.is_contradicted());
}

#[test]
fn a_way_that_nothing_seen_backs_is_a_blow_along_each_axis() {
    for axis in 0..3 {
        for off_m in [0.05, -0.05, 0.2] {
            let trial = trial(&predicted_off(Vector3::ith(axis, off_m), Vector3::zeros()), &EXPECTED);
            assert!(trial.is_contradicted() && trial.is_doubtful(), "{axis} {off_m}: {trial:?}");
            assert!((trial.force_m_s2() - 2.0 * off_m.abs() / 0.09).abs() < 0.01, "{}", trial.force_m_s2());
        }
    }
}

#[test]
fn a_way_within_its_deviation_or_with_another_turn_is_none() {
    let short = predicted_off(Vector3::new(0.006, 0.0, 0.0), Vector3::zeros());
    assert!(!trial(&short, &EXPECTED).is_doubtful());
    let long = predicted_off(Vector3::new(0.05, 0.0, 0.0), Vector3::zeros());
    assert!(!trial(&long, &Expected { velocity_sigma_m_s: 0.1, ..EXPECTED }).is_doubtful());
    let turned = predicted_off(Vector3::new(0.05, 0.0, 0.0), Vector3::new(0.0, 0.01, 0.0));
    assert!(!trial(&turned, &EXPECTED).is_doubtful());
}

#[test]
fn a_stamp_moves_a_frame_along_its_way_alone() {
    let mut window = predicted_off(Vector3::zeros(), Vector3::zeros());
    let Some(newest) = window.frames.last_mut() else { return };
    newest.nav.v_o_b = Vector3::new(0.0, 5.0, 0.0);
    newest.nav.p_o_b.y += 0.05;
    let late = Expected { stamp_sigma_s: 4e-3, ..EXPECTED };
    assert!(trial(&window, &EXPECTED).is_contradicted() && !trial(&window, &late).is_doubtful());
    window
        .frames
        .iter_mut()
        .last()
        .into_iter()
        .for_each(|newest| newest.nav.v_o_b = Vector3::new(5.0, 0.0, 0.0));
    assert!(trial(&window, &late).is_contradicted(), "across its way it does not");
}

#[test]
fn a_few_that_move_leave_a_right_prediction_backed() {
    let window = with_movers(predicted_off(Vector3::zeros(), Vector3::zeros()), 5);
    let trial = trial(&window, &EXPECTED);
    assert!(trial.is_backed() && !trial.is_contradicted(), "{trial:?}");
}

#[test]
fn landmarks_on_the_side_of_the_prediction_forbid_a_blow() {
    let mut trial = trial(&predicted_off(Vector3::new(0.05, 0.0, 0.0), Vector3::zeros()), &EXPECTED);
    trial.votes = Votes { predicted: 6, sighted: 40, both: 18, all: 64 };
    assert!(trial.is_contradicted());
    trial.votes = Votes { predicted: 8, sighted: 38, both: 18, all: 64 };
    assert!(!trial.is_contradicted(), "one in eight stands still");
    trial.votes = Votes { predicted: 0, sighted: 20, both: 20, all: 64 };
    assert!(!trial.is_contradicted(), "no motion explains what is seen");
}

#[test]
fn what_has_just_come_into_view_is_not_tried() {
    let mut window = predicted_off(Vector3::new(0.05, 0.0, 0.0), Vector3::zeros());
    let last = window.frames.len() - 1;
    for landmark in window.points.all_mut() {
        let host = landmark.host;
        landmark.observations.retain(|o| o.frame == host || usize::from(o.frame) == last);
    }
    assert!(window.try_prediction(&EXPECTED, None).is_none());
}
