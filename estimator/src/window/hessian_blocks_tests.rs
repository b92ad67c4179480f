use super::super::eliminate::MAX_VISUAL;
use super::super::state::{GLOBAL_DIM, Rig};
use super::super::test_dense::full;
use super::super::test_room::scatter;
use super::*;
use nalgebra::{DMatrix, DVector, SVector};
use plumbline_config::Config;

const FRAMES: usize = 4;
const WEIGHT: f64 = 0.7;

fn jacobians(seed: u32) -> Jacobians<3> {
    let mut next = seed * 1000;
    let mut number = || {
        next += 1;
        scatter(next)
    };
    let mut j = Jacobians::<3>::zeros();
    j.host.iter_mut().for_each(|x| *x = number());
    j.target.iter_mut().for_each(|x| *x = number());
    j.rig.iter_mut().for_each(|x| *x = number());
    j.landmark.iter_mut().for_each(|x| *x = number());
    j
}

fn options() -> Options {
    let mut options = Options::of(Config::preset("sim").expect("is good").setup());
    options.rig_mask = SVector::from_element(1.0);
    options
}

/// `J'J`, `J'r` of a landmark in `host` that is observed from `targets`, by the blocks and by full rows; with the
/// heading as well, seen from the host alone.
fn by_blocks_and_by_rows(host: usize, targets: &[usize]) -> [(DMatrix<f64>, DVector<f64>); 2] {
    let dim = visual_of_frame(FRAMES);
    let mut visual = NormalEquations::new(MAX_VISUAL);
    visual.reset(dim);
    let mut entry = Eliminated::<3>::empty();
    let mut blocks = LandmarkHessian::<3>::default();
    let (mut h, mut b) = (DMatrix::zeros(dim + 3, dim + 3), DVector::zeros(dim + 3));
    let mut add =
        |j: &Jacobians<3>, r: &Vector2<f64>, host: Option<usize>, target: Option<usize>, heading: f64| {
            for d in 0..2 {
                let mut row = DVector::zeros(dim + 3);
                row.rows_mut(0, RIG_DIM).copy_from(&j.rig.row(d).transpose());
                row[HEADING] = heading * f64::from(d as u32 + 1);
                if let Some(host) = host {
                    row.rows_mut(visual_of_frame(host), POSE_DIM).copy_from(&j.host.row(d).transpose());
                }
                if let Some(target) = target {
                    row.rows_mut(visual_of_frame(target), POSE_DIM).copy_from(&j.target.row(d).transpose());
                }
                row.rows_mut(dim, 3).copy_from(&j.landmark.row(d).transpose());
                h += &row * row.transpose() * (WEIGHT * WEIGHT);
                b += row * (r[d] * WEIGHT * WEIGHT);
            }
        };
    for (seed, &target) in (1..).zip(targets) {
        let (j, r) = (jacobians(seed), Vector2::new(0.3, -0.8) * f64::from(seed));
        let rows = common_rows(&j, &r, WEIGHT, host != target, &options());
        blocks.add(&rows);
        if host != target {
            add_target(&mut visual, &mut entry, &rows, &j.target, WEIGHT, (host, target));
        }
        add(&j, &r, (host != target).then_some(host), (host != target).then_some(target), 0.0);
    }
    let (j, r) = (jacobians(50), Vector2::new(-0.2, 0.5));
    let rows = common_rows(&j, &r, WEIGHT, true, &options());
    blocks.add(&rows);
    add_heading(&mut visual, &mut entry, &rows, &(Vector2::new(0.9, 1.8) * WEIGHT), host);
    add(&j, &r, Some(host), None, 0.9);

    blocks.flush(&mut visual, &mut entry, host);
    let (visual_h, visual_b) = full(&visual);
    let (mut found, mut found_b) = (DMatrix::zeros(dim + 3, dim + 3), DVector::zeros(dim + 3));
    found.view_mut((0, 0), (dim, dim)).copy_from(&visual_h);
    found_b.rows_mut(0, dim).copy_from(&visual_b);
    found_b.rows_mut(dim, 3).copy_from(&entry.gradient);
    found.view_mut((dim, dim), (3, 3)).copy_from(&blocks.landmark());
    for r in 0..3 {
        for k in 0..dim {
            found[(dim + r, k)] = entry.by_visual[r][k];
            found[(k, dim + r)] = entry.by_visual[r][k];
        }
    }
    [(found, found_b), (h, b)]
}

#[test]
fn blocks_are_the_products_of_full_rows() {
    for (host, targets) in
        [(0, &[0, 1, 2, 3][..]), (2, &[0, 1, 3]), (3, &[0, 3, 2]), (1, &[1, 1]), (1, &[2, 2, 0])]
    {
        let [(found, found_b), (h, b)] = by_blocks_and_by_rows(host, targets);
        assert!((&found - &h).norm() < 1e-12 * h.norm(), "host {host}, seen from {targets:?}: J'J");
        assert!((&found_b - &b).norm() < 1e-12 * b.norm(), "host {host}, seen from {targets:?}: J'r");
    }
}

#[test]
fn unknowns_of_the_rig_that_are_held_fixed_are_left_out() {
    let mut options = options();
    options.rig_mask[Rig::TIME_OFFSET] = 0.0;
    let rows = common_rows(&jacobians(3), &Vector2::new(1.0, 1.0), WEIGHT, true, &options);
    assert_eq!([rows[0][Rig::TIME_OFFSET], rows[1][Rig::TIME_OFFSET]], [0.0; 2]);
    assert!(rows[0][Rig::P_B_C0] != 0.0 && GLOBAL_DIM > RIG_DIM);
}
