use super::super::motions::{POSED, RESIDUAL, motion_of_frame};
use super::super::test_dense::full_motions;
use super::super::test_room::scatter;
use super::*;
use nalgebra::{DMatrix, DVector, Matrix3};

const FRAMES: usize = 4;
/// The landmark is seen from these.
const SPAN: (usize, usize) = (1, 2);

/// A landmark, its own block, and the rest of the system.
fn landmark() -> (MotionEquations, Eliminated<3>, Matrix3<f64>) {
    let mut equations = MotionEquations::default();
    equations.reset(FRAMES, true);
    for k in 0..equations.dim {
        equations.rows[k][k] = 50.0;
        equations.rows[k.min(RESIDUAL)][k.max(RESIDUAL)] += scatter(k as u32);
    }
    let root = Matrix3::new(2.0, 0.3, -0.4, 0.0, 1.5, 0.2, 0.0, 0.0, 0.8);
    let mut entry = Eliminated::<3>::empty();
    // What an elimination before this one may have left.
    entry.rows = [[7.0; MAX_MOTIONS]; 3];
    entry.reset(equations.dim);
    for (r, row) in (0..).zip(&mut entry.rows) {
        row[..GLOBALS].fill(0.0);
        for k in
            (0..=RESIDUAL).chain(POSED..GLOBALS).chain(motion_of_frame(SPAN.0)..motion_of_frame(SPAN.1 + 1))
        {
            row[k] = scatter(1000 + 100 * r + k as u32);
        }
    }
    (equations, entry, root.tr_mul(&root))
}

fn mixed(entry: &Eliminated<3>) -> DMatrix<f64> {
    DMatrix::from_fn(3, motion_of_frame(FRAMES), |r, k| entry.rows[r][k])
}

#[test]
fn what_is_left_is_the_schur_complement() {
    let (mut equations, mut entry, own) = landmark();
    let (h, w) = (full_motions(&equations), mixed(&entry));
    entry.eliminate(&mut equations, own, SPAN);
    assert!(entry.is_used);
    let inverse = own.try_inverse().expect("is regular");
    let expected = &h - w.transpose() * DMatrix::from_column_slice(3, 3, inverse.as_slice()) * &w;
    assert!((full_motions(&equations) - &expected).norm() < 1e-12 * expected.norm());
}

#[test]
fn frames_outside_its_span_are_not_touched() {
    let (mut equations, mut entry, own) = landmark();
    let before = full_motions(&equations);
    entry.eliminate(&mut equations, own, SPAN);
    let left = full_motions(&equations);
    for k in (motion_of_frame(0)..motion_of_frame(1)).chain(motion_of_frame(3)..motion_of_frame(4)) {
        assert_eq!(left.row(k), before.row(k));
    }
}

#[test]
fn its_step_makes_its_own_gradient_vanish() {
    let (mut equations, mut entry, own) = landmark();
    let w = mixed(&entry);
    entry.eliminate(&mut equations, own, SPAN);
    let mut motions: MotionRow = std::array::from_fn(|k| scatter(k as u32));
    motions[RESIDUAL] = 1.0;
    let left = own * entry.step(&motions) + &w * DVector::from_column_slice(&motions[..w.ncols()]);
    assert!(left.norm() < 1e-12, "{left}");
}

#[test]
fn a_block_that_is_not_positive_definite_is_left_alone() {
    let (mut equations, mut entry, own) = landmark();
    let before = full_motions(&equations);
    entry.eliminate(&mut equations, -own, SPAN);
    assert!(!entry.is_used);
    assert_eq!(full_motions(&equations), before);
}

#[test]
fn without_intrinsics_their_columns_are_not_touched() {
    let (mut equations, mut entry, own) = landmark();
    for row in &mut entry.rows {
        row[POSED..GLOBALS].fill(0.0);
    }
    let mut whole = (equations.clone(), entry.clone());
    whole.1.eliminate(&mut whole.0, own, SPAN);
    equations.reset(FRAMES, false);
    equations.rows.clone_from(&landmark().0.rows);
    entry.eliminate(&mut equations, own, SPAN);
    assert_eq!(full_motions(&equations), full_motions(&whole.0));
    let motions: MotionRow = std::array::from_fn(|k| scatter(k as u32));
    assert_eq!(entry.step(&motions), whole.1.step(&motions));
}
