//! The pose of a frame by its images alone, in a room whose truth is known.

use super::super::test_room::Room;
use super::*;
use crate::geometry::log_so3;

/// A room without disturbance, and its newest state.
fn room() -> (Window, NavState) {
    let window = Room { disturbance: 0.0, ..Room::default() }.window();
    let newest = window.frames.last().expect("has frames").nav.clone();
    (window, newest)
}

/// State some centimetres and degrees away.
fn displaced(nav: &NavState) -> NavState {
    let mut displaced = nav.clone();
    displaced.p_o_b += Vector3::new(0.04, -0.03, 0.02);
    displaced.rot_o_b *= exp_so3(&Vector3::new(0.03, -0.02, 0.04));
    displaced
}

#[test]
fn a_frame_is_found_from_twenty_pixels_away_whatever_the_inertial_sensor_says() {
    let (window, newest) = room();
    let found = window.sight_newest(&displaced(&newest)).expect("enough points agree");
    assert!((found.p_o_b - newest.p_o_b).norm() < 1e-5, "{:?}", found.p_o_b - newest.p_o_b);
    assert!(log_so3(&(newest.rot_o_b.inverse() * found.rot_o_b)).norm() < 1e-5);
    let sigma_rad = found.rotation_covariance.trace().sqrt();
    assert!(sigma_rad < 5e-3, "{sigma_rad}");
}

#[test]
fn a_few_points_that_are_elsewhere_change_little_and_many_leave_no_pose() {
    let (window, newest) = room();
    let moved = |share: usize| {
        let mut window = window.clone();
        let last = window.frames.len() - 1;
        for (k, landmark) in window.points.all_mut().iter_mut().enumerate() {
            for observation in landmark.observations.iter_mut().filter(|o| usize::from(o.frame) == last) {
                observation.measured.xy += Vector2::new(0.1, 0.05) * f64::from(u8::from(k % 10 < share));
            }
        }
        window.sight_newest(&displaced(&newest))
    };
    let found = moved(2).expect("most points agree");
    assert!(log_so3(&(newest.rot_o_b.inverse() * found.rot_o_b)).norm() < 2e-3);
    assert!(moved(5).is_none());
}

#[test]
fn a_frame_that_sees_no_landmark_has_no_pose() {
    let (mut window, newest) = room();
    window.points.clear();
    assert!(window.sight_newest(&newest).is_none());
}
