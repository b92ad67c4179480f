use super::test_lifts::{FRAMES, lifts};
use super::*;
use crate::window::state::FRAME_DIM;
use crate::window::test_dense::{full, full_motions};
use crate::window::test_room::scatter;
use nalgebra::DVector;

/// Equations whose entries have nothing to do with each other; the lower triangle is worth nothing.
fn equations() -> MotionEquations {
    let mut motions = MotionEquations::default();
    motions.reset(FRAMES, true);
    let dim = motions.dim;
    for (i, row) in motions.rows[..dim].iter_mut().enumerate() {
        for (k, x) in row[..dim].iter_mut().enumerate() {
            let is_padding =
                |k: usize| [RESIDUAL + 1, RESIDUAL + 2, GLOBALS - 1, GLOBALS - 1 - LENS].contains(&k);
            let is_there = k >= i && !is_padding(i) && !is_padding(k);
            *x = if is_there {
                scatter((100 * i + k) as u32)
            } else if k < i {
                9.0
            } else {
                0.0
            };
        }
    }
    motions
}

#[test]
fn the_lift_is_that_of_the_dense_matrix_of_derivatives() {
    let (lifts, by) = lifts();
    let mut motions = equations();
    let h = full_motions(&motions);
    let dim = unknown_of_frame(FRAMES);
    let mut lifted = NormalEquations::new(dim);
    lifted.reset(dim);
    motions.lift(&lifts, &mut lifted);
    let (found, found_b) = full(&lifted);
    assert!((found - by.tr_mul(&(&h * &by))).norm() < 1e-12 * h.norm());
    assert!((found_b - by.tr_mul(&h.column(RESIDUAL))).norm() < 1e-12 * h.norm());
}

#[test]
fn motions_of_a_step_are_what_the_matrix_makes_of_it() {
    let (lifts, by) = lifts();
    let step: Vec<f64> = (0..by.ncols() as u32).map(scatter).collect();
    let motions = lifts.motions_of(&step);
    let mut expected = &by * DVector::from_vec(step);
    expected[RESIDUAL] = 1.0;
    assert!((DVector::from_column_slice(&motions[..by.nrows()]) - expected).norm() < 1e-12);
}

#[test]
fn what_is_held_fixed_has_no_motion() {
    let (lifts, by) = lifts();
    assert!(lifts.cameras == 2 && RIG_DIM + FRAME_DIM < by.ncols());
    assert!(by.column(Rig::P_C0_C1).iter().all(|x| *x == 0.0));
    let mut motions = equations();
    let mut lifted = NormalEquations::new(by.ncols());
    lifted.reset(by.ncols());
    motions.lift(&lifts, &mut lifted);
    for k in 0..by.ncols() {
        assert_eq!(lifted.get(Rig::P_C0_C1, k), 0.0);
    }
}
