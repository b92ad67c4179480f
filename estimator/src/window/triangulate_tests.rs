use super::super::reprojection::PointMeasurement;
use super::super::state::{NavState, Rig};
use super::*;
use nalgebra::{Isometry3, Matrix2, UnitQuaternion, Vector2};
use plumbline_config::{Config, Timestamp};

/// The body looks along z as its left camera does; the right camera is 0.1 m along x.
fn rig() -> Rig {
    Rig {
        pose_b_c0: Isometry3::identity(),
        pose_c0_c1: Isometry3::translation(0.1, 0.0, 0.0),
        time_offset_s: 0.0,
        intrinsics: Default::default(),
    }
}

fn frame_at(p_o_b: Vector3<f64>) -> Frame {
    let nav = NavState { p_o_b, ..NavState::default() };
    Frame {
        stamp: Timestamp::from_nanos(0),
        taken: Timestamp::from_nanos(0),
        gyro_b: Vector3::zeros(),
        time_offset_s: 0.0,
        linearization: nav.clone(),
        nav,
        in_prior: false,
        is_keyframe: true,
        is_still: false,
        inertial: None,
    }
}

/// A pixel is 1/460; the standard deviation half of one.
fn measured(xy: Vector2<f64>) -> PointMeasurement {
    PointMeasurement {
        xy,
        xy_rate: Vector2::zeros(),
        weight: Matrix2::identity() * 920.0,
        row: Default::default(),
    }
}

/// A landmark at `p_o`, seen exactly by the cameras given in every frame, hosted by the first of them.
fn landmark(p_o: Vector3<f64>, frames: &[Frame], cameras: &[u8]) -> PointLandmark {
    let mut landmark = PointLandmark {
        track_id: 1,
        host: 0,
        host_camera: cameras[0],
        is_triangulated: false,
        feature: InversePoint { xy: Vector2::zeros(), rho: 0.0 },
        observations: heapless::Vec::new(),
    };
    for (k, frame) in (0..).zip(frames) {
        for &camera in cameras {
            let pose = frame.nav.pose_o_b() * rig().pose_b_c(usize::from(camera));
            let q = pose.inverse_transform_point(&p_o.into());
            let measured = measured(Vector2::new(q.x / q.z, q.y / q.z));
            let _ = landmark.observations.push(Observation { frame: k, camera, measured });
        }
    }
    landmark
}

fn found(landmark: &mut PointLandmark, frames: &[Frame], is_start: bool) -> Triangulation {
    let mounts = [Mount::of(&rig(), 0), Mount::of(&rig(), 1)];
    let options = Options::of(Config::preset("sim").expect("is good").setup());
    triangulate(landmark, &Scene { frames, mounts: &mounts, time_offset_s: 0.0 }, &options, is_start)
}

#[test]
fn one_stereo_view_gives_a_depth() {
    let frames = [frame_at(Vector3::new(0.3, -0.2, 0.5))];
    for cameras in [[0, 1], [1, 0]] {
        let mut seen = landmark(Vector3::new(0.5, 0.4, 3.5), &frames, &cameras);
        assert_eq!(found(&mut seen, &frames, false), Triangulation::Done);
        assert!(seen.is_triangulated);
        assert!((seen.feature.rho - 1.0 / 3.0).abs() < 1e-9, "{}", seen.feature.rho);
    }
}

#[test]
fn one_camera_waits_for_parallax() {
    let p_o = Vector3::new(0.5, 0.4, 4.0);
    let mut frames = vec![frame_at(Vector3::zeros())];
    let mut seen = landmark(p_o, &frames, &[0]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Waiting, "a single view");
    // Turning on the spot tells no depth.
    frames.push(frame_at(Vector3::zeros()));
    frames[1].nav.rot_o_b = UnitQuaternion::from_euler_angles(0.1, -0.05, 0.2);
    let mut seen = landmark(p_o, &frames, &[0]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Waiting, "only turned");
    // One centimetre: the parallax is 2.3 standard deviations.
    frames[1].nav.p_o_b.x = 0.01;
    let mut seen = landmark(p_o, &frames, &[0]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Waiting, "hardly moved");
    frames[1].nav.p_o_b.x = 0.2;
    let mut seen = landmark(p_o, &frames, &[0]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Done);
    assert!((seen.feature.rho - 0.25).abs() < 1e-9);
}

#[test]
fn a_point_beyond_the_largest_depth_is_held_there_while_its_parallax_is_within_noise() {
    // Over 0.2 m: an inverse depth of 1/500 m, known to 1/184 m.
    let frames = [frame_at(Vector3::zeros()), frame_at(Vector3::new(0.2, 0.0, 0.0))];
    let p_o = Vector3::new(10.0, -4.0, 500.0);
    let mut seen = landmark(p_o, &frames, &[0]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Done);
    let options = Options::of(Config::preset("sim").expect("is good").setup());
    assert_eq!(seen.feature.rho, options.min_rho);
}

/// Held at the largest depth (60 m) a point at 500 m would be seen 27 standard deviations from where it is: over long
/// baselines far points count as wrong tracks.
#[test]
fn over_a_long_baseline_a_point_beyond_the_largest_depth_is_taken_for_a_wrong_track() {
    let frames = [frame_at(Vector3::zeros()), frame_at(Vector3::new(2.0, 0.0, 0.0))];
    let mut seen = landmark(Vector3::new(10.0, -4.0, 500.0), &frames, &[0]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Contradiction);
}

#[test]
fn views_that_contradict_each_other_are_no_point_unless_the_poses_are_guessed() {
    let frames = [frame_at(Vector3::zeros()), frame_at(Vector3::new(0.3, 0.0, 0.0))];
    let spoil = || {
        let mut seen = landmark(Vector3::new(0.2, 0.1, 3.0), &frames, &[0, 1]);
        seen.observations[3].measured.xy.y += 0.03;
        seen
    };
    let mut seen = spoil();
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Contradiction);
    assert!(!seen.is_triangulated);
    let mut seen = spoil();
    assert_eq!(found(&mut seen, &frames, true), Triangulation::Done);
}

#[test]
fn a_point_behind_or_before_the_nearest_depth_is_a_wrong_track() {
    let frames = [frame_at(Vector3::zeros())];
    // Disparity of the wrong sign.
    let mut seen = landmark(Vector3::new(0.0, 0.0, 3.0), &frames, &[0, 1]);
    seen.observations[1].measured.xy.x = 0.03;
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Contradiction);
    let mut seen = landmark(Vector3::new(0.0, 0.0, 0.02), &frames, &[0, 1]);
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Contradiction);
}

#[test]
fn a_landmark_that_its_host_has_not_seen_is_none() {
    let frames = [frame_at(Vector3::zeros())];
    let mut seen = landmark(Vector3::new(0.0, 0.0, 3.0), &frames, &[0, 1]);
    seen.host_camera = 1;
    seen.observations.pop();
    assert_eq!(found(&mut seen, &frames, false), Triangulation::Contradiction);
}

#[test]
fn views_that_are_no_numbers_give_no_depth() {
    let frames = [frame_at(Vector3::zeros()), frame_at(Vector3::new(0.3, 0.0, 0.0))];
    for value in [f64::NAN, f64::INFINITY] {
        for k in 0..4 {
            let mut seen = landmark(Vector3::new(0.2, 0.1, 3.0), &frames, &[0, 1]);
            seen.observations[k].measured.xy.x = value;
            assert_ne!(found(&mut seen, &frames, false), Triangulation::Done, "{value} in view {k}");
            assert!(!seen.is_triangulated);
        }
    }
}

#[test]
fn a_moved_landmark_begins_anew_from_what_its_heir_has_seen() {
    let frames: Vec<Frame> = (0..4).map(|k| frame_at(Vector3::new(0.1 * f64::from(k), 0.0, 0.0))).collect();
    let seen = landmark(Vector3::new(0.2, 0.1, 3.0), &frames, &[0, 1]);
    let moved = moved_to(&seen, 2).expect("the heir has seen it");
    assert_eq!((moved.host, moved.host_camera, moved.is_triangulated), (2, 0, false));
    assert!(moved.observations.iter().all(|o| o.frame >= 2) && moved.observations.len() == 4);
    assert!(moved_to(&seen, 9).is_none() && moved_to(&seen, 300).is_none());
}
