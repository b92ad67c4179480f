use super::super::test_dense::{Dense, equilibrated};
use super::super::test_room::{Room, always, truth};
use super::super::{PointTrack, TrackMeasurement};
use super::*;
use crate::geometry::log_so3;
use nalgebra::{DMatrix, Vector2};

/// Rig, navigation states and landmarks as they are.
fn states(window: &Window) -> (Rig, Vec<NavState>, Vec<InversePoint>, Vec<HostedLine>) {
    (
        window.rig.clone(),
        window.frames.iter().map(|f| f.nav.clone()).collect(),
        window.points.all().iter().map(|l| l.feature).collect(),
        window.lines.all().iter().map(|l| l.feature).collect(),
    )
}

/// Makes an observation of the newest frame one that is no number.
fn poison(window: &mut Window, value: f64) {
    let newest = (window.frames.len() - 1) as u8;
    let point = window.points.all_mut().iter_mut().find(|l| l.is_triangulated).expect("there are points");
    let observation = point.observations.iter_mut().find(|o| o.frame == newest).expect("is seen");
    observation.measured.xy = Vector2::new(value, 0.1);
}

#[test]
fn exact_measurements_bring_the_states_back_to_the_truth() {
    // The tilt is known: a second's motion tells it from the bias of the accelerometer to 20 mrad.
    let mut window = Room { sees: always, disturbance: 0.0, tilt_rad: 1e-3, ..Room::default() }.window();
    for (k, frame) in (0..).zip(&mut window.frames).skip(1) {
        frame.nav = frame.nav.plus(&super::super::test_room::scatter_step(k, 5e-3));
    }
    let outcome = window.optimize(20);
    assert!(!outcome.is_not_positive_definite && outcome.cost < 0.1, "{outcome:?}");
    for (k, frame) in window.frames.iter().enumerate() {
        let expected = truth(
            &Rig::of(plumbline_config::Config::preset("sim").expect("is good").setup()),
            0.3 * k as f64,
        );
        assert!((frame.nav.p_o_b - expected.p_o_b).norm() < 2e-3, "position {k}");
        let turn = log_so3(&(expected.rot_o_b.inverse() * frame.nav.rot_o_b));
        assert!(turn.norm() < 2e-3, "attitude {k}: {turn}");
    }
}

#[test]
fn steps_lower_the_cost_until_it_is_flat() {
    let mut window = Room { disturbance: 3.0, ..Room::default() }.window();
    let before = window.cost();
    let outcome = window.optimize(10);
    assert!(outcome.cost < 0.8 * before, "{before} to {}", outcome.cost);
    assert!((window.cost() - outcome.cost).abs() < 1e-9 * outcome.cost);
    let again = window.optimize(10);
    assert!(again.iterations <= 2 && again.cost > 0.99 * outcome.cost, "{again:?} after {outcome:?}");
}

#[test]
fn a_solution_never_ends_at_a_higher_cost_than_it_began() {
    for disturbance in [5.0, 20.0, 60.0] {
        let mut window = Room { disturbance, ..Room::default() }.window();
        let before = window.cost();
        for iterations in [1, 2, 3] {
            let outcome = window.clone().optimize(iterations);
            assert!(outcome.cost <= before * (1.0 + 1e-12), "{disturbance}: {before} to {}", outcome.cost);
            assert!(outcome.iterations as usize <= iterations);
        }
    }
}

#[test]
fn a_cost_that_is_no_number_leaves_the_states_alone() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200] {
        // The backup holds the states of another solution: they must not come back.
        let mut window = Room::default().window();
        let _ = window.optimize(3);
        for frame in &mut window.frames {
            frame.nav.p_o_b.x += 0.01;
        }
        poison(&mut window, value);
        let before = states(&window);
        let outcome = window.optimize(5);
        assert!(outcome.is_not_positive_definite, "{value}");
        assert_eq!(states(&window), before, "{value}");
        assert!(window.newest_covariance().is_none(), "{value}: nothing is known of it");
        // What does not fit goes, and the next solution is as good as any.
        window.remove_outliers();
        assert_eq!(window.outliers().points.len(), 1, "{value}");
        let outcome = window.optimize(5);
        assert!(outcome.cost.is_finite() && !outcome.is_not_positive_definite, "{value}: {outcome:?}");
        assert!(window.newest_covariance().is_some());
    }
}

#[test]
fn there_is_no_covariance_before_the_first_solution_nor_of_another_window() {
    let mut window = Room::default().window();
    assert!(window.newest_covariance().is_none());
    let _ = window.optimize(2);
    assert!(window.newest_covariance().is_some());
    window.remove_frame(0);
    assert!(window.newest_covariance().is_none(), "the factorization is that of a longer window");
}

#[test]
fn the_covariance_is_that_of_the_whole_dense_problem() {
    let mut window = Room::default().window();
    window.refresh_anchor();
    let dense = Dense::of(&window, 0.0);
    // No step, so that it is the covariance of these states.
    let _ = window.optimize(0);
    let (covariance, variance) = window.newest_covariance().expect("is known");
    let (h, scale) = equilibrated(&dense.h);
    let inverse = h.cholesky().expect("is positive definite").inverse();
    let scale = DMatrix::from_diagonal(&scale);
    let expected = &scale * inverse * &scale;
    let at = unknown_of_frame(window.frames.len() - 1);
    for i in 0..COVARIANCE_DIM {
        for k in 0..COVARIANCE_DIM {
            let unit = (expected[(at + i, at + i)] * expected[(at + k, at + k)]).sqrt();
            assert!((covariance[(i, k)] - expected[(at + i, at + k)]).abs() < 1e-6 * unit, "{i} {k}");
        }
    }
    let time_offset = expected[(Rig::TIME_OFFSET, Rig::TIME_OFFSET)];
    assert!((variance - time_offset).abs() < 1e-6 * time_offset);
}

#[test]
fn tracks_that_are_no_numbers_never_move_a_state() {
    let mut window = Room::default().window();
    let track_id = 900;
    let mut tracks: Vec<PointTrack> = Vec::new();
    let template = window.points.all()[0].observations[0].measured;
    for (k, value) in (0..).zip([f64::NAN, f64::INFINITY, -f64::INFINITY]) {
        let measured =
            super::super::reprojection::PointMeasurement { xy: Vector2::new(value, value), ..template };
        tracks.push(TrackMeasurement { track_id: track_id + k, measured: [Some(measured); 2] });
    }
    window.make_keyframe(&tracks, &[]);
    window.triangulate(false);
    assert!(window.points.all().iter().filter(|l| l.track_id >= track_id).all(|l| !l.is_triangulated));
    let outcome = window.optimize(5);
    assert!(outcome.cost.is_finite() && window.frames.iter().all(|f| f.nav.is_finite()));
}

/// Makes the normal equations indefinite by two unknowns that nothing else speaks of: damping has to reach a half before
/// they can be factored.
fn spoil(window: &mut Window) {
    let (i, k) = (Rig::P_B_C0, Rig::P_C0_C1);
    window.options.rig_mask[i] = 0.0;
    window.options.rig_mask[k] = 0.0;
    window.refresh_anchor();
    window.anchor = None;
    let equations = &mut window.prior.equations;
    for (row, column, value) in [(i, i, 1.0), (k, k, 1.0), (i, k, 1.5)] {
        let before = equations.get(row, column);
        equations.add(row, column, value - before);
    }
}

#[test]
fn equations_that_cannot_be_solved_are_damped_until_they_can() {
    let mut window = Room { disturbance: 20.0, ..Room::default() }.window();
    spoil(&mut window);
    let (before, cost) = (states(&window), window.cost());
    let outcome = window.optimize(6);
    assert!(outcome.is_not_positive_definite, "they were indefinite");
    assert!(states(&window) != before && outcome.cost < 0.9 * cost, "{cost} to {}", outcome.cost);
}

#[test]
fn there_is_no_covariance_of_equations_that_could_not_be_factored() {
    let mut window = Room::default().window();
    let _ = window.optimize(2);
    assert!(window.newest_covariance().is_some());
    spoil(&mut window);
    for iterations in [0, 2] {
        assert!(window.optimize(iterations).is_not_positive_definite);
        assert!(window.newest_covariance().is_none() && window.rig_covariance().is_none(), "{iterations}");
    }
}
