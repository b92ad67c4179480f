use super::super::Window;
use super::super::state::RIG_DIM;
use super::super::test_dense::{equilibrated, full};
use super::super::test_room::{Room, always, scatter_step};
use super::*;
use nalgebra::{DMatrix, DVector};

/// Half of the tracks end before the newest frame, the others begin after the first: what the first frame hosts is
/// marginalized with all of its observations.
fn first_half_or_second(track_id: u32, frame: usize) -> [bool; 2] {
    let is_early = track_id.is_multiple_of(2);
    [if is_early { frame < 4 } else { frame > 0 }; 2]
}

/// The step that solves the window's normal equations, and the covariance, all unknowns of the rig and the frames
/// from `first` on. Unknowns without information are held.
fn solved(window: &mut Window, first: usize) -> (DVector<f64>, DMatrix<f64>) {
    let _ = window.linearize(0.0);
    let (h, b) = full(&window.linearizer.equations);
    let (scaled, scale) = equilibrated(&h);
    let cholesky = scaled.cholesky().expect("is positive definite");
    let step = -cholesky.solve(&b.component_mul(&scale)).component_mul(&scale);
    let covariance = DMatrix::from_diagonal(&scale) * cholesky.inverse() * DMatrix::from_diagonal(&scale);
    let kept: Vec<usize> = (0..RIG_DIM).chain(unknown_of_frame(first)..h.nrows()).collect();
    (step.select_rows(&kept), covariance.select_rows(&kept).select_columns(&kept))
}

#[test]
fn what_remains_is_solved_as_if_nothing_had_left() {
    let mut window = Room { frames: 5, sees: first_half_or_second, ..Room::default() }.window();
    window.frames[0].is_still = true;
    window.refresh_anchor();
    let (step, covariance) = solved(&mut window, 1);
    let landmarks = window.triangulated();
    window.remove_frame(0);
    assert!(window.triangulated().0 < landmarks.0 && window.triangulated().1 < landmarks.1);
    assert_eq!(window.frames.len(), 4);
    let (step_after, covariance_after) = solved(&mut window, 0);
    assert_eq!(step.len(), step_after.len());
    let sigma = covariance.diagonal().map(f64::sqrt);
    for k in 0..step.len() {
        let off = (step_after[k] - step[k]).abs() / sigma[k];
        assert!(off < 1e-6, "unknown {k}: {} instead of {}", step_after[k], step[k]);
        for i in 0..step.len() {
            let off = (covariance_after[(i, k)] - covariance[(i, k)]).abs() / (sigma[i] * sigma[k]);
            assert!(off < 1e-6, "covariance {i} {k} is off by {off} of its sigmas");
        }
    }
}

#[test]
fn several_frames_leave_one_after_the_other_as_they_would_at_once() {
    /// Tracks of one frame and the next, so that nothing is handed on.
    fn pairs(track_id: u32, frame: usize) -> [bool; 2] {
        let begins = track_id as usize % 4;
        [frame == begins || frame == begins + 1; 2]
    }
    let mut window = Room { frames: 6, sees: pairs, ..Room::default() }.window();
    window.refresh_anchor();
    let (step, covariance) = solved(&mut window, 3);
    for _ in 0..3 {
        window.remove_frame(0);
    }
    let (step_after, covariance_after) = solved(&mut window, 0);
    for k in 0..step.len() {
        let sigma = covariance[(k, k)].sqrt();
        assert!((step_after[k] - step[k]).abs() < 1e-5 * sigma, "{k}: {} for {}", step_after[k], step[k]);
        assert!((covariance_after[(k, k)].sqrt() - sigma).abs() < 1e-5 * sigma, "{k}");
    }
}

#[test]
fn a_frame_of_which_nothing_is_known_goes_without_a_trace() {
    let mut window = Room { frames: 6, sees: always, ..Room::default() }.window();
    window.frames[3].is_keyframe = false;
    let (before, _) = full(&window.prior.equations);
    let dt_s: Vec<f64> =
        window.frames.iter().map(|f| f.inertial.as_ref().map_or(0.0, |i| i.motion.dt_s)).collect();
    let stamp = window.frames[4].stamp;
    window.remove_frame(3);
    assert_eq!(full(&window.prior.equations).0, before, "the prior is as it was");
    assert_eq!(window.frames[3].stamp, stamp);
    let joined = window.frames[3].inertial.as_ref().expect("is joined");
    assert!((joined.motion.dt_s - dt_s[3] - dt_s[4]).abs() < 1e-12);
    assert!(joined.information().is_some());
    for landmark in window.points.all() {
        assert_eq!(landmark.host, 0);
        let frames: Vec<u8> = landmark.observations.iter().map(|o| o.frame).collect();
        assert_eq!(frames, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4], "renumbered, those of the frame gone");
    }
    assert!(window.anchor.is_some(), "the origin is still linearized anew for every solution");
}

#[test]
fn frames_before_the_origin_go_without_a_trace_and_the_first_keyframe_fixes_where_it_is_linearized() {
    // As after a start with two cameras: the newest frame is the origin, those in between are no keyframes.
    let mut window = Room { frames: 5, sees: always, is_anchored: false, ..Room::default() }.window();
    let sigmas = super::super::prior::AnchorSigmas {
        position_m: 1e-3,
        yaw_rad: 1e-3,
        tilt_rad: 0.1,
        velocity_m_s: 1.0,
        bias_gyro_rad_s: 0.02,
        bias_accel_m_s2: 0.1,
    };
    window.anchor_newest(&super::super::prior::AnchorState::default(), &sigmas);
    for frame in [1, 1] {
        window.frames[frame].is_keyframe = false;
        window.remove_frame(frame);
    }
    let anchor = window.anchor.as_ref().expect("the origin is still linearized anew for every solution");
    assert_eq!((anchor.frame, window.prior.frames(), window.frames.len()), (2, 3, 3));
    assert!(window.frames.iter().all(|f| !f.in_prior));
    let outcome = window.optimize(5);
    assert!(outcome.cost.is_finite() && !outcome.is_not_positive_definite, "{outcome:?}");
    window.remove_frame(0);
    assert!(window.anchor.is_none(), "until something is marginalized");
}

#[test]
fn a_living_track_gets_a_new_landmark_in_the_newest_keyframe() {
    let mut window = Room { frames: 5, sees: always, ..Room::default() }.window();
    let tracks = window.points.all().len();
    window.remove_frame(0);
    assert!(window.anchor.is_none());
    assert_eq!(window.points.all().len(), tracks);
    for landmark in window.points.all() {
        assert_eq!((landmark.host, landmark.is_triangulated), (3, false));
        assert!(landmark.observations.iter().all(|o| o.frame == 3), "those before are in the prior");
    }
    window.triangulate(false);
    assert_eq!(window.triangulated().0, tracks, "the baseline gives them a depth at once");
}

#[test]
fn with_one_camera_a_living_landmark_stays_with_another_host() {
    fn left(_: u32, _: usize) -> [bool; 2] {
        [true, false]
    }
    let mut window = Room { frames: 5, sees: left, disturbance: 0.0, ..Room::default() }.window();
    window.options.begin_with(1);
    let (points, lines) = window.triangulated();
    assert!(points > 10 && lines > 5);
    let cost = window.cost();
    window.remove_frame(0);
    assert_eq!(window.triangulated(), (points, lines));
    assert!(window.points.all().iter().filter(|l| l.is_triangulated).all(|l| l.host == 0));
    assert!(window.cost() < cost + 1e-3, "they are where they were");
}

#[test]
fn the_prior_speaks_of_no_frame_beyond_those_that_it_touched() {
    let mut window = Room { frames: 5, sees: first_half_or_second, ..Room::default() }.window();
    window.remove_frame(0);
    assert_eq!(window.prior.frames(), 3, "the early tracks were seen up to the last but one frame");
    let in_prior: Vec<bool> = window.frames.iter().map(|f| f.in_prior).collect();
    assert_eq!(in_prior, [true, true, true, false]);
    assert!(window.frames[0].inertial.is_none() && window.frames[1].inertial.is_some());
}

#[test]
fn the_sigma_of_points_follows_their_errors_but_not_at_rest() {
    let learned = |error_sigmas: f64, is_still: bool| {
        let mut window =
            Room { frames: 5, sees: first_half_or_second, disturbance: 0.0, ..Room::default() }.window();
        window.frames[0].is_still = is_still;
        for landmark in window.points.all_mut() {
            for o in &mut landmark.observations {
                let error = scatter_step::<2>(50 * landmark.track_id + u32::from(o.frame), error_sigmas);
                o.measured.xy += o.measured.weight.try_inverse().expect("is regular") * error;
            }
        }
        window.remove_frame(0);
        window.options.point_sigma
    };
    assert!(learned(0.1, false) < 1.0 && learned(10.0, false) > 1.0);
    assert!(learned(0.1, true) == 1.0);
}
