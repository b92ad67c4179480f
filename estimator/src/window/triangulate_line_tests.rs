use super::super::frame::Frame;
use super::super::state::{Mount, NavState, Rig};
use super::super::test_views::with_cameras;
use super::*;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2};
use plumbline_config::{Config, Timestamp};

/// The body looks along z as its left camera does; the right camera is 0.11 m along x.
fn rig() -> Rig {
    Rig {
        pose_b_c0: Isometry3::identity(),
        pose_c0_c1: Isometry3::translation(0.11, 0.0, 0.0),
        time_offset_s: 0.0,
        intrinsics: Default::default(),
    }
}

fn frame_at(p_o_b: Vector3<f64>) -> Frame {
    let nav = NavState { p_o_b, rot_o_b: UnitQuaternion::identity(), ..NavState::default() };
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

fn options() -> Options {
    Options::of(Config::preset("sim").expect("is good").setup())
}

fn found(landmark: &mut LineLandmark, frames: &[Frame]) -> Triangulation {
    let mounts = [Mount::of(&rig(), 0), Mount::of(&rig(), 1)];
    triangulate_line(landmark, &Scene { frames, mounts: &mounts, time_offset_s: 0.0 }, &options())
}

/// A landmark of the edge from `a` to `b`, seen exactly by both cameras of every frame.
fn landmark(a: Vector3<f64>, b: Vector3<f64>, frames: &[Frame]) -> LineLandmark {
    let mut landmark = LineLandmark {
        track_id: 1,
        host: 0,
        host_camera: 0,
        is_triangulated: false,
        feature: HostedLine::UNKNOWN,
        observations: heapless::Vec::new(),
    };
    for (k, frame) in frames.iter().enumerate() {
        for camera in 0..2u8 {
            let pose = Isometry3::from_parts(Translation3::from(frame.nav.p_o_b), frame.nav.rot_o_b)
                * rig().pose_b_c(usize::from(camera));
            let see = |p: &Vector3<f64>| {
                let q = pose.inverse_transform_point(&(*p).into());
                Vector2::new(q.x / q.z, q.y / q.z)
            };
            let measured = LineMeasurement {
                ends_xy: [see(&a), see(&b)],
                rates: [0.0; 2],
                weights: [1500.0; 2],
                rows: Default::default(),
            };
            let _ = landmark.observations.push(Observation { frame: k as u8, camera, measured });
        }
    }
    landmark
}

#[test]
fn an_edge_across_the_baseline_is_found_by_one_stereo_view() {
    let frames = [frame_at(Vector3::zeros())];
    let (a, b) = (Vector3::new(0.3, -0.8, 2.5), Vector3::new(0.5, 0.9, 3.5));
    let mut seen = landmark(a, b, &frames);
    assert_eq!(found(&mut seen, &frames), Triangulation::Done);
    for p in [a, b] {
        let depth = seen.feature.depth_at(&(p.xy() / p.z));
        assert!((depth - p.z).abs() < 1e-6, "{depth} instead of {}", p.z);
    }
}

#[test]
fn an_edge_along_the_baseline_waits_for_another_motion() {
    // Parallel to the baseline it lies in one epipolar plane: both views see it in the same plane.
    let (a, b) = (Vector3::new(-0.8, 0.4, 3.0), Vector3::new(0.9, 0.4, 3.0));
    let mut frames = vec![frame_at(Vector3::zeros())];
    let mut seen = landmark(a, b, &frames);
    assert_eq!(found(&mut seen, &frames), Triangulation::Waiting);
    // Moved along the edge there is still nothing to see ...
    frames.push(frame_at(Vector3::new(0.5, 0.0, 0.0)));
    let mut seen = landmark(a, b, &frames);
    assert_eq!(found(&mut seen, &frames), Triangulation::Waiting);
    // ... moved across it there is.
    frames.push(frame_at(Vector3::new(0.0, 0.4, 0.0)));
    let mut seen = landmark(a, b, &frames);
    assert_eq!(found(&mut seen, &frames), Triangulation::Done);
    assert!((seen.feature.depth_at(&Vector2::new(0.0, 0.4 / 3.0)) - 3.0).abs() < 1e-6);
}

#[test]
fn far_and_near_and_false_edges_are_no_landmarks() {
    let frames = [frame_at(Vector3::zeros()), frame_at(Vector3::new(0.1, 0.1, 0.0))];
    // At infinity there is no parallax.
    let far = (Vector3::new(50.0, -900.0, 5000.0), Vector3::new(60.0, 900.0, 5000.0));
    let mut seen = landmark(far.0, far.1, &frames);
    assert_eq!(found(&mut seen, &frames), Triangulation::Waiting);
    // Nearer than the nearest depth that is believed.
    let near = (Vector3::new(0.02, -0.03, 0.1), Vector3::new(0.02, 0.03, 0.1));
    let mut seen = landmark(near.0, near.1, &frames);
    assert_eq!(found(&mut seen, &frames), Triangulation::Contradiction);
    // Views of different edges under one name.
    let mut seen = landmark(Vector3::new(0.3, -0.8, 2.5), Vector3::new(0.5, 0.9, 3.5), &frames);
    for end in &mut seen.observations[3].measured.ends_xy {
        end.x += 0.05;
    }
    assert_eq!(found(&mut seen, &frames), Triangulation::Contradiction);
}

#[test]
fn an_edge_seen_from_its_own_line_is_not_compared() {
    // The observer's camera lies on the edge: it sees a point, and no plane.
    let frames = [frame_at(Vector3::zeros()), frame_at(Vector3::new(0.3, 0.0, 0.0))];
    let line = HostedLine::of(
        &Vector3::new(0.3, 0.0, 0.5).cross(&Vector3::new(0.3, 0.0, 4.0)),
        &Vector3::new(0.0, 0.0, 1.0),
    )
    .expect("a line");
    let measured = LineMeasurement {
        ends_xy: [Vector2::new(0.0, -0.1), Vector2::new(0.0, 0.1)],
        rates: [0.0; 2],
        weights: [1.0; 2],
        rows: Default::default(),
    };
    let residual = with_cameras(&rig(), (&frames[0].nav, &frames[1].nav), (0, 0), |view| {
        line.residual(view, &measured, 0.0, None)
    });
    assert!(residual.is_none());
}
