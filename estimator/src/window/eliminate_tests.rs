use super::super::test_dense::full;
use super::super::test_room::scatter;
use super::*;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

const FRAMES: usize = 4;
/// What an elimination before this one may have left.
const SCRATCH: Scratch = [[7.0; MAX_VISUAL]; MAX_LANDMARK_DIM];

/// A landmark that spans frames 1 to 2, and the rest of the system.
fn landmark() -> (NormalEquations, Eliminated<3>, Matrix3<f64>) {
    let dim = visual_of_frame(FRAMES);
    let mut visual = NormalEquations::new(MAX_VISUAL);
    visual.reset(dim);
    for k in 0..dim {
        visual.add(k, k, 50.0);
        visual.gradient_mut()[k] = scatter(k as u32);
    }
    let root = Matrix3::new(2.0, 0.3, -0.4, 0.0, 1.5, 0.2, 0.0, 0.0, 0.8);
    let own = root.tr_mul(&root);
    let mut entry = Eliminated::<3>::empty();
    entry.inverse = own.try_inverse().expect("is regular");
    entry.gradient = Vector3::new(0.4, -1.0, 0.7);
    entry.is_used = true;
    for (r, row) in (0..).zip(&mut entry.by_visual) {
        for k in (0..GLOBAL_DIM).chain(visual_of_frame(1)..visual_of_frame(3)) {
            row[k] = scatter(1000 + 100 * r + k as u32);
        }
    }
    (visual, entry, own)
}

fn mixed(entry: &Eliminated<3>) -> DMatrix<f64> {
    DMatrix::from_fn(3, visual_of_frame(FRAMES), |r, k| entry.by_visual[r][k])
}

#[test]
fn what_is_left_is_the_schur_complement() {
    let (mut visual, entry, own) = landmark();
    let (h, b) = full(&visual);
    let w = mixed(&entry);
    let inverse = DMatrix::from_column_slice(3, 3, entry.inverse.as_slice());
    let gradient = DVector::from_column_slice(entry.gradient.as_slice());
    eliminate(&mut visual, &entry, &own.cholesky().expect("is definite").l(), (1, 2), &mut SCRATCH.clone());
    let (left, left_b) = full(&visual);
    let expected = &h - w.transpose() * &inverse * &w;
    assert!((left - &expected).norm() < 1e-12 * expected.norm());
    assert!((left_b - (b - w.transpose() * inverse * gradient)).norm() < 1e-12);
}

#[test]
fn frames_outside_its_span_are_not_touched() {
    let (mut visual, entry, own) = landmark();
    let (h, b) = full(&visual);
    eliminate(&mut visual, &entry, &own.cholesky().expect("is definite").l(), (1, 2), &mut SCRATCH.clone());
    let (left, left_b) = full(&visual);
    for k in (visual_of_frame(0)..visual_of_frame(1)).chain(visual_of_frame(3)..visual_of_frame(4)) {
        assert_eq!(left.row(k), h.row(k));
        assert_eq!(left_b[k], b[k]);
    }
}

#[test]
fn its_step_makes_its_own_gradient_vanish() {
    let (_, entry, own) = landmark();
    let visual: Vec<f64> = (0..visual_of_frame(FRAMES) as u32).map(scatter).collect();
    let step = entry.step(&visual);
    let left = own * step + mixed(&entry) * DVector::from_vec(visual) + entry.gradient;
    assert!(left.norm() < 1e-12, "{left}");
}
