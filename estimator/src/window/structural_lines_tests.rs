use super::super::line::LineMeasurement;
use super::super::state::{FRAME_DIM, FrameTime, GLOBAL_DIM, HEADING, NavState};
use super::super::{LineTrack, TrackMeasurement, Window};
use super::*;
use crate::geometry::exp_so3;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::{Config, Timestamp};

const HEADING_RAD: f64 = 0.4;
/// Tilt as known in flight.
const KNOWN_TILT_RAD: f64 = 0.001;

/// Ends of the edges of a room, m in `O`: verticals, along and across the heading, before a camera that looks
/// along x.
fn edges() -> Vec<[Vector3<f64>; 2]> {
    let (sin, cos) = HEADING_RAD.sin_cos();
    let (along, across) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
    let mut edges = Vec::new();
    for k in 0..6 {
        let s = f64::from(k);
        let at = |z: f64| Vector3::new(3.0 + 0.3 * s, -1.0 + 0.4 * s, z);
        let z = if k % 2 == 0 { 1.0 + 0.05 * s } else { -1.0 - 0.05 * s };
        edges.push([at(-0.5), at(0.5)]);
        edges.push([at(z), at(z) + along * 0.8]);
        edges.push([at(z), at(z) + across * 0.6]);
    }
    edges
}

/// Measurement of an edge by the camera at `pose_o_c`.
fn measure(pose_o_c: &Isometry3<f64>, edge: &[Vector3<f64>; 2]) -> LineMeasurement {
    let ends_xy = edge.map(|p| {
        let q = pose_o_c.inverse() * nalgebra::Point3::from(p);
        Vector2::new(q.x / q.z, q.y / q.z)
    });
    LineMeasurement { ends_xy, rates: [0.0; 2], weights: [1000.0; 2], rows: Default::default() }
}

/// A window of four keyframes in the room, all its edges landmarks with a depth.
fn window() -> Window {
    window_of(&edges())
}

/// A window of four keyframes in the room, with these edges as landmarks.
fn window_of(edges: &[[Vector3<f64>; 2]]) -> Window {
    let mut window = Window::new(Config::preset("sim").expect("is good").setup());
    window.clear();
    let look = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0));
    let rot_o_b = UnitQuaternion::from_rotation_matrix(&look) * window.rig.pose_b_c(0).rotation.inverse();
    for k in 0..4 {
        let s = f64::from(k);
        let nav = NavState {
            p_o_b: Vector3::new(0.1 * s, 0.3 * s, 0.2 * (1.7 * s).sin()),
            rot_o_b: rot_o_b * exp_so3(&(Vector3::new(0.02, -0.03, 0.04) * s)),
            v_o_b: Vector3::new(0.5, 0.1, -0.2),
            ..NavState::default()
        };
        let stamp = Timestamp::from_nanos(i64::from(k) * 500_000_000);
        window.push_frame(FrameTime { stamp, time_offset_s: 0.0 }, nav.clone(), None, false);
        let poses = [0, 1].map(|camera| nav.pose_o_b() * window.rig.pose_b_c(camera));
        let tracks: Vec<LineTrack> = (0..)
            .zip(edges)
            .map(|(track_id, edge)| TrackMeasurement {
                track_id,
                measured: poses.map(|p| Some(measure(&p, edge))),
            })
            .collect();
        window.observe(&[], &tracks);
        window.make_keyframe(&[], &tracks);
    }
    window.triangulate(false);
    window
}

/// Everything turned about gravity, as a step of the unknowns of `window`.
fn turn_of(window: &Window) -> Vec<f64> {
    let mut turn = vec![0.0; GLOBAL_DIM + FRAME_DIM * window.frames.len()];
    turn[HEADING] = 1.0;
    for (k, frame) in window.frames.iter().enumerate() {
        let nav = frame.jacobian_state(true);
        let at = GLOBAL_DIM + FRAME_DIM * k;
        turn[at..at + 3].copy_from_slice(Vector3::z().cross(&nav.p_o_b).as_slice());
        turn[at + 3..at + 6].copy_from_slice((nav.rot_o_b.inverse() * Vector3::z()).as_slice());
        turn[at + 6..at + 9].copy_from_slice(Vector3::z().cross(&nav.v_o_b).as_slice());
    }
    turn
}

#[test]
fn a_vertical_edge_alone_is_no_structure() {
    let at = |y: f64, z: f64| Vector3::new(3.5, y, z);
    let verticals = [[at(-0.4, -0.5), at(-0.4, 0.5)], [at(0.6, -0.5), at(0.6, 0.5)]];
    for (count, expected) in [(1, 0), (2, 2)] {
        let mut window = window_of(&verticals[..count]);
        window.update_manhattan(&[], KNOWN_TILT_RAD);
        assert_eq!(window.structural_lines(), expected, "of {count} vertical edges");
    }
}

#[test]
fn every_edge_of_a_room_finds_its_direction() {
    let mut window = window();
    window.manhattan.heading_rad = Some(HEADING_RAD);
    window.update_manhattan(&[], KNOWN_TILT_RAD);
    assert_eq!(window.structural_lines(), edges().len());
    for line in window.lines.all() {
        assert_eq!(line.feature.axis, Some(Axis::ALL[line.track_id as usize % 3]), "{}", line.track_id);
    }
}

#[test]
fn a_few_edges_that_fit_by_chance_are_no_structure() {
    let mut window = window();
    window.manhattan.heading_rad = Some(HEADING_RAD);
    window.lines.retain(|line| line.track_id % 3 == 0 || line.track_id < 6);
    window.update_manhattan(&[], KNOWN_TILT_RAD);
    let horizontals =
        window.lines.all().iter().filter(|l| l.feature.axis.is_some_and(|a| a != Axis::Vertical));
    assert_eq!(horizontals.count(), 0);
    assert_eq!(window.structural_lines(), 6, "verticals need no company");
}

#[test]
fn yaw_of_everything_stays_unobservable_in_window_and_prior() {
    let mut window = window();
    window.manhattan.heading_rad = Some(HEADING_RAD);
    window.update_manhattan(&[], KNOWN_TILT_RAD);
    let _ = window.linearize(0.0);
    let scale = window.linearizer.equations.get(HEADING, HEADING);
    assert!(scale > 1.0, "the heading is known relative to the frames");
    let information_along = |equations: &super::super::dense::NormalEquations, turn: &[f64]| {
        let mut product = vec![0.0; equations.dim()];
        equations.multiply(turn, &mut product);
        product.iter().fold(0.0, |most: f64, p| most.max(p.abs())) / scale
    };
    let turn = turn_of(&window);
    let leak = information_along(&window.linearizer.equations, &turn);
    assert!(leak < 1e-9, "window: {leak}");
    window.remove_frame(0);
    let turn = turn_of(&window);
    let leak = information_along(&window.prior.equations, &turn[..window.prior.equations.dim()]);
    assert!(leak < 1e-6, "prior: {leak}");
}

#[test]
fn structural_factors_never_enter_the_prior() {
    let mut structural = window();
    structural.manhattan.heading_rad = Some(HEADING_RAD);
    structural.update_manhattan(&[], KNOWN_TILT_RAD);
    let mut plain = structural.clone();
    plain.forget(|_| true);
    assert!(structural.structural_lines() > 0 && plain.structural_lines() == 0);
    for window in [&mut structural, &mut plain] {
        window.remove_frame(0);
    }
    let [a, b] = [&structural, &plain].map(|window| &window.prior.equations);
    assert!(a.dim() == b.dim() && a.dim() > GLOBAL_DIM);
    for i in 0..a.dim() {
        assert_eq!(a.row(i), b.row(i), "row {i}");
    }
    // The lines that go on are structural still.
    assert!(structural.lines.all().iter().any(|line| line.feature.axis.is_some()));
}

#[test]
fn a_wall_of_many_verticals_weighs_as_much_as_one() {
    let mut window = window();
    window.update_manhattan(&[], KNOWN_TILT_RAD);
    let count = window.manhattan.verticals;
    assert!(count >= 2, "{count}");
    let information = count as f64 / window.manhattan.sigma_rad(Axis::Vertical).powi(2);
    let of_one = 1.0 / window.manhattan.options.sigma_rad.powi(2);
    assert!((information / of_one - 1.0).abs() < 1e-12);
    assert_eq!(window.manhattan.sigma_rad(Axis::Along), window.manhattan.options.sigma_rad);
}

#[test]
fn verticals_wait_until_the_tilt_is_known_better_than_their_gate() {
    let mut window = window();
    window.update_manhattan(&[], 0.028);
    assert_eq!((window.manhattan.verticals, window.structural_lines()), (0, 0));
    window.update_manhattan(&[], KNOWN_TILT_RAD);
    assert!(window.manhattan.verticals >= 2);
}
