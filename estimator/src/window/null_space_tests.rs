//! Null space of a window: its position, and its yaw about gravity. Four directions, no more and no less, before and after
//! marginalization, by the analytic directions and by the eigenvalues.

use super::Window;
use super::state::{FRAME_DIM, NavState, RIG_DIM, unknown_of_frame};
use super::test_dense::{Dense, equilibrated, full};
use super::test_room::{Room, always, gauge, scatter_step};
use nalgebra::{DMatrix, SymmetricEigen};

/// Eigenvalues of `h` over all unknowns that are not held fixed, in ascending order, each unknown in units of what is
/// known of it alone.
fn spectrum(h: &DMatrix<f64>) -> Vec<f64> {
    let free: Vec<usize> = (0..h.nrows()).filter(|k| h[(*k, *k)] > 0.0).collect();
    let (scaled, _) = equilibrated(&h.select_rows(&free).select_columns(&free));
    let mut values: Vec<f64> = SymmetricEigen::new(scaled).eigenvalues.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Information of `h` along each of the directions, as a share of what all of `whole` tells of the unknowns.
fn information_along(h: &DMatrix<f64>, directions: &DMatrix<f64>, whole: &DMatrix<f64>) -> Vec<f64> {
    let scale = equilibrated(whole).1.rows(0, h.nrows()).into_owned();
    let information = |direction: nalgebra::DVectorView<'_, f64>| {
        let size = direction.component_div(&scale).norm();
        (h * direction).component_mul(&scale).norm() / size
    };
    directions.column_iter().map(information).collect()
}

/// The unknowns of `h` see four directions and nothing else: `directions`.
fn assert_four(h: &DMatrix<f64>, directions: &DMatrix<f64>, tolerance: f64, what: &str) {
    for (k, information) in information_along(h, directions, h).into_iter().enumerate() {
        assert!(information < tolerance, "{what}: direction {k} is known to {information}");
    }
    let spectrum = spectrum(h);
    let (fourth, fifth) = (spectrum[3], spectrum[4]);
    assert!(fourth.abs() < tolerance, "{what}: the fourth eigenvalue is {fourth}");
    assert!(fifth > 100.0 * tolerance, "{what}: the fifth eigenvalue is {fifth}");
    println!(
        "{what}: {:.1e} {:.1e} {:.1e} {:.1e} | {:.1e}",
        spectrum[0], spectrum[1], spectrum[2], fourth, fifth
    );
}

fn room() -> Room {
    Room { frames: 6, is_anchored: false, ..Room::default() }
}

/// Unknowns of the landmarks are parameters in their host: moving everything leaves them.
fn with_landmarks(directions: &DMatrix<f64>, unknowns: usize) -> DMatrix<f64> {
    let mut whole = DMatrix::zeros(unknowns, directions.ncols());
    whole.rows_mut(0, directions.nrows()).copy_from(directions);
    whole
}

/// Moves the states as a further solution would; frames in the prior keep their linearization.
fn move_on(window: &mut Window) {
    for (k, frame) in (40..).zip(&mut window.frames) {
        frame.nav = frame.nav.plus(&scatter_step::<FRAME_DIM>(k, 3e-3));
    }
    let step = scatter_step::<RIG_DIM>(60, 1e-3).component_mul(&window.options.rig_mask);
    window.rig = window.rig.plus(&step);
}

#[test]
fn the_whole_problem_has_four_unknown_directions() {
    let window = room().window();
    let dense = Dense::of(&window, 0.0);
    // The regularization of the landmarks is no measurement, and far below any.
    let directions = with_landmarks(&gauge(&window), dense.h.nrows());
    assert_four(&dense.h, &directions, 1e-10, "points, lines, IMU, rig, time offset");
}

#[test]
fn the_reduced_problem_has_four_unknown_directions() {
    let mut window = room().window();
    let _ = window.linearize(0.0);
    assert_four(&full(&window.linearizer.equations).0, &gauge(&window), 1e-10, "landmarks eliminated");
}

#[test]
fn they_stay_four_after_marginalization_although_the_states_have_moved() {
    let mut window = room().window();
    for removed in 0..3 {
        window.remove_frame(0);
        window.triangulate(false);
        move_on(&mut window);
        let _ = window.linearize(0.0);
        let what = format!("{} frames gone", removed + 1);
        let (whole, _) = full(&window.linearizer.equations);
        assert_four(&whole, &gauge(&window), 1e-9, &what);
        // The prior by itself does not know them either.
        let (prior, _) = full(&window.prior.equations);
        let directions = gauge(&window).rows(0, prior.nrows()).into_owned();
        for (k, information) in information_along(&prior, &directions, &whole).into_iter().enumerate() {
            assert!(information < 1e-8, "{what}: the prior knows direction {k} to {information}");
        }
    }
}

/// The reason for first estimates: with Jacobians at the present states, a prior from other states tells yaw.
#[test]
fn without_first_estimates_yaw_would_seem_to_be_known() {
    let mut window = room().window();
    window.remove_frame(0);
    window.triangulate(false);
    move_on(&mut window);
    window.options.first_estimates = false;
    let _ = window.linearize(0.0);
    let (h, _) = full(&window.linearizer.equations);
    let yaw = information_along(&h, &gauge(&window), &h)[3];
    assert!(yaw > 1e-6, "yaw is known to {yaw}");
}

#[test]
fn an_anchor_makes_them_known() {
    let mut window = Room { frames: 6, is_anchored: true, sees: always, ..Room::default() }.window();
    let _ = window.linearize(0.0);
    let (h, _) = full(&window.linearizer.equations);
    assert!(spectrum(&h)[0] > 1e-9);
    let at = unknown_of_frame(0) + NavState::P;
    assert!(h[(at, at)] >= 1e6, "the position of the first frame is known to a millimetre");
}
