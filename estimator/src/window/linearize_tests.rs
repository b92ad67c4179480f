use super::super::Window;
use super::super::calibration::KnownRig;
use super::super::state::{NavState, RIG_DIM, unknown_of_frame};
use super::super::test_dense::{Dense, equilibrated, full};
use super::super::test_room::{Room, by_and_by};
use super::*;
use nalgebra::{DVector, SVector};

/// The largest entry of the difference of two systems, each in units of the information of the dense one before
/// anything was eliminated.
fn difference(dense: &Dense, window: &Window) -> (f64, f64) {
    let (h, b) = dense.reduced();
    let (sparse_h, sparse_b) = full(&window.linearizer.equations);
    let (_, scale) = equilibrated(&dense.h.view((0, 0), h.shape()).into_owned());
    let mut worst = (0.0_f64, 0.0_f64);
    let size = b.component_mul(&scale).norm();
    for i in 0..h.nrows() {
        worst.1 = worst.1.max((b[i] - sparse_b[i]).abs() * scale[i] / size);
        for k in 0..h.ncols() {
            worst.0 = worst.0.max((h[(i, k)] - sparse_h[(i, k)]).abs() * scale[i] * scale[k]);
        }
    }
    worst
}

#[test]
fn the_room_puts_every_kind_of_factor_to_work() {
    let mut window = Room::default().window();
    let cost = window.linearize(0.0);
    assert!(cost.is_finite() && cost > 1.0);
    let (points, lines) = window.triangulated();
    assert!(points >= 20 && lines >= 18, "{points} points, {lines} lines");
    assert!(window.points.all().iter().any(|l| l.host > 0 && l.is_triangulated));
    assert!(window.points.all().iter().any(|l| l.host_camera == 1 && l.is_triangulated));
    let time_offset = Rig::TIME_OFFSET;
    assert!(window.linearizer.equations.get(time_offset, time_offset) > 1.0);
    assert!(window.rig.time_offset_s != 0.0);
    for k in Rig::INTRINSICS..RIG_DIM {
        assert!(window.linearizer.equations.get(k, k) > 1e6 && window.rig.intrinsics[1].x != 0.0, "{k}");
    }
}

#[test]
fn intrinsics_held_fixed_have_no_part_in_the_problem() {
    let mut window = Room { refines_intrinsics: false, ..Room::default() }.window();
    let _ = window.linearize(0.0);
    let (h, b) = difference(&Dense::of(&window, 0.0), &window);
    assert!(h < 1e-9 && b < 1e-9, "J'J differs by {h}, J'r by {b}");
    assert!(!window.optimize(3).is_not_positive_definite);
    assert!(window.rig.intrinsics.iter().all(|step| step.norm() == 0.0));
    assert!(window.rig_covariance().is_some() && window.newest_covariance().is_some());
}

#[test]
fn measurements_that_follow_the_intrinsics_leave_the_cost() {
    let mut window = Room::default().window();
    let before = window.cost();
    let seen = |window: &Window| window.points.all()[0].observations[0].measured.xy;
    let at = seen(&window);
    window.follow_lenses();
    let moved = (seen(&window) - at).norm();
    assert!(moved > 1e-4, "{moved}");
    assert!((window.cost() / before - 1.0).abs() < 1e-3);
}

#[test]
fn the_reduced_system_is_the_schur_complement_of_the_dense_one() {
    for (frames, damping) in [(5, 0.0), (5, 0.3), (2, 0.0), (9, 1e-3)] {
        let mut window = Room { frames, ..Room::default() }.window();
        window.frames[frames - 1].is_still = true;
        let _ = window.linearize(damping);
        let (h, b) = difference(&Dense::of(&window, damping), &window);
        assert!(h < 1e-9, "{frames} frames, damping {damping}: J'J differs by {h}");
        assert!(b < 1e-9, "{frames} frames, damping {damping}: J'r differs by {b}");
    }
}

#[test]
fn the_reduced_system_is_the_dense_one_with_a_prior_and_first_estimates_too() {
    let mut window = Room { frames: 7, ..Room::default() }.window();
    window.remove_frame(0);
    window.triangulate(false);
    // The states move on, the Jacobians of what the prior knows stay.
    for (k, frame) in (0..).zip(&mut window.frames) {
        frame.nav = frame.nav.plus(&(SVector::<f64, FRAME_DIM>::from_element(3e-3) * f64::from(k % 3 - 1)));
    }
    assert!(window.prior.frames() > 0 && window.frames[0].in_prior);
    let _ = window.linearize(0.0);
    let (h, b) = difference(&Dense::of(&window, 0.0), &window);
    assert!(h < 1e-9 && b < 1e-9, "J'J differs by {h}, J'r by {b}");
}

#[test]
fn steps_of_frames_and_landmarks_are_those_that_solve_the_dense_system() {
    let mut window = Room::default().window();
    let _ = window.linearize(0.0);
    let dense = Dense::of(&window, 0.0);
    let expected = dense.step();
    assert!(window.factor.compute(&window.linearizer.equations, 0.0));
    let mut step: Vec<f64> = window.linearizer.equations.gradient().iter().map(|b| -b).collect();
    window.factor.solve(&mut step);
    let (_, scale) = equilibrated(&dense.h);
    let size = expected.component_div(&scale).norm();
    let off = |at: usize, value: f64| (value - expected[at]).abs() / scale[at] / size;
    for (k, value) in step.iter().enumerate() {
        assert!(off(k, *value) < 1e-7, "unknown {k}: {value} instead of {}", expected[k]);
    }
    let motions = window.linearizer.lifts.motions_of(&step);
    let mut landmarks = 0;
    for (at, entry) in dense.points.iter().zip(&window.linearizer.points).filter(|(_, e)| e.is_used) {
        landmarks += 1;
        entry.step(&motions).iter().enumerate().for_each(|(k, d)| assert!(off(at + k, *d) < 1e-7, "point"));
    }
    for (at, entry) in dense.lines.iter().zip(&window.linearizer.lines).filter(|(_, e)| e.is_used) {
        landmarks += 1;
        entry.step(&motions).iter().enumerate().for_each(|(k, d)| assert!(off(at + k, *d) < 1e-7, "line"));
    }
    let (points, lines) = window.triangulated();
    assert_eq!(landmarks, points + lines, "all of them take part");
}

/// The cost of `window` after a step of its states.
fn cost_after(window: &Window, step: &DVector<f64>, dense: &Dense) -> f64 {
    let mut moved = window.clone();
    let part = |at: usize| SVector::<f64, FRAME_DIM>::from_column_slice(&step.as_slice()[at..at + FRAME_DIM]);
    moved.rig = moved.rig.plus(&SVector::from_column_slice(&step.as_slice()[..RIG_DIM]));
    for (k, frame) in moved.frames.iter_mut().enumerate() {
        frame.nav = frame.nav.plus(&part(unknown_of_frame(k)));
    }
    for (landmark, at) in moved.points.all_mut().iter_mut().zip(&dense.points) {
        if landmark.is_triangulated {
            landmark.feature = landmark.feature.plus(&step.fixed_rows::<3>(*at).into_owned());
        }
    }
    for (landmark, at) in moved.lines.all_mut().iter_mut().zip(&dense.lines) {
        if landmark.is_triangulated {
            landmark.feature = landmark.feature.plus(&step.fixed_rows::<4>(*at).into_owned());
        }
    }
    moved.cost()
}

#[test]
fn the_gradient_is_the_derivative_of_the_cost() {
    let window = Room { frames: 4, ..Room::default() }.window();
    let dense = Dense::of(&window, 0.0);
    // What is held fixed has neither.
    let free: Vec<usize> = (0..dense.h.nrows()).filter(|k| dense.h[(*k, *k)] > 0.0).collect();
    assert!(free.len() > 150, "{} unknowns", free.len());
    for k in free {
        // A thousandth of what the measurements tell.
        let h = 1e-3 / dense.h[(k, k)].sqrt();
        let mut step = DVector::zeros(dense.h.nrows());
        step[k] = h;
        let numeric = (cost_after(&window, &step, &dense) - cost_after(&window, &-step, &dense)) / (2.0 * h);
        let (error, scale) = ((numeric - dense.b[k]).abs(), dense.h[(k, k)].sqrt());
        assert!(
            error < 1e-3 * (scale + dense.b[k].abs()),
            "unknown {k}: {numeric} instead of {}",
            dense.b[k]
        );
    }
}

#[test]
fn the_cost_is_the_same_with_and_without_linearizing() {
    let mut window = Room::default().window();
    window.frames[4].is_still = true;
    let with = window.linearize(0.0);
    let without = window.cost();
    assert!((with - without).abs() < 1e-9 * with, "{with} and {without}");
}

#[test]
fn what_is_held_fixed_does_not_move_and_tells_nothing() {
    let mut window = Room { refines_intrinsics: false, ..Room::default() }.window();
    window.options.rig_mask.fill(0.0);
    window.options.rig_sigmas.fill(0.0);
    window.known_rig = KnownRig::within(&window.options.rig_sigmas);
    window.refresh_anchor();
    let _ = window.linearize(0.0);
    for k in 0..RIG_DIM {
        assert!(window.linearizer.equations.row(k).iter().all(|h| *h == 0.0), "{k}");
        assert_eq!(window.linearizer.equations.gradient()[k], 0.0);
    }
    let rig = window.rig.clone();
    let _ = window.optimize(3);
    assert!(window.rig.minus(&rig).norm() < 1e-12);
}

#[test]
fn a_landmark_without_a_depth_takes_no_part() {
    let mut window = Room { sees: by_and_by, ..Room::default() }.window();
    window.points.all_mut().iter_mut().for_each(|l| l.is_triangulated = false);
    let _ = window.linearize(0.0);
    assert!(window.linearizer.points[..window.points.all().len()].iter().all(|e| !e.is_used));
    assert!(window.linearizer.lines[..window.lines.all().len()].iter().any(|e| e.is_used));
    assert!(unknown_of_frame(1) + NavState::P < window.linearizer.equations.dim());
}
