use super::super::camera_poses::{Lift, MAX_CAMERA};
use super::super::state::BodyPose;
use super::super::state::{MAX_VISUAL, Mount, NavState, Rig, visual_of_frame};
use super::super::test_dense::full;
use super::super::test_room::scatter;
use super::*;
use nalgebra::{DMatrix, DVector, SVector, Vector3};
use plumbline_config::Config;

const FRAMES: usize = 2;
const CAMERAS: usize = 2 * FRAMES;
const WEIGHT: f64 = 0.7;

fn jacobians(seed: u32) -> Jacobians<3> {
    let mut next = seed * 1000;
    let mut number = || {
        next += 1;
        scatter(next)
    };
    let mut j = Jacobians::<3>::zeros();
    j.camera.iter_mut().for_each(|x| *x = number());
    j.time_offset.iter_mut().for_each(|x| *x = number());
    j.landmark.iter_mut().for_each(|x| *x = number());
    j
}

/// Two frames of a stereo rig, all of whose unknowns are free: what their cameras do, and the same as one matrix.
fn lifts() -> (Lifts, DMatrix<f64>) {
    let rig = Rig::of(Config::preset("sim").expect("is good").setup());
    let mounts = [Mount::of(&rig, 0), Mount::of(&rig, 1)];
    let all = SVector::from_element(1.0);
    let pivot_o = Vector3::new(0.2, 0.3, -0.1);
    let mut step = SVector::<f64, 15>::zeros();
    let bodies: Vec<_> = (0..FRAMES as u32)
        .map(|k| {
            step.iter_mut().zip(100 * k..).for_each(|(x, seed)| *x = scatter(seed));
            BodyPose::of(&NavState::default().plus(&step))
        })
        .collect();
    let mut lifts = Lifts::default();
    lifts.refresh(&bodies, &mounts, &pivot_o, &all);
    let mut l = DMatrix::zeros(unknown_of_camera(CAMERAS), visual_of_frame(FRAMES));
    l[(CAMERA_TIME_OFFSET, Rig::TIME_OFFSET)] = 1.0;
    l[(CAMERA_HEADING, HEADING)] = 1.0;
    for camera in 0..CAMERAS {
        let lift = Lift::of(&bodies[camera / 2], &mounts[camera % 2], &pivot_o, &all);
        let at = unknown_of_camera(camera);
        l.view_mut((at, 0), (POSE_DIM, 12)).copy_from(&lift.by_rig());
        l.view_mut((at, visual_of_frame(camera / 2)), (POSE_DIM, POSE_DIM)).copy_from(&lift.by_frame());
    }
    (lifts, l)
}

/// `J'J`, `J'r` of a landmark in camera `host` that is observed from `targets`, lifted, by the blocks and by full rows;
/// with the heading as well, seen from the host alone.
fn by_blocks_and_by_rows(host: usize, targets: &[usize]) -> [(DMatrix<f64>, DVector<f64>); 2] {
    let (mut lifts, l) = lifts();
    let (camera_dim, dim) = (unknown_of_camera(CAMERAS), visual_of_frame(FRAMES));
    let mut cameras = NormalEquations::new(MAX_CAMERA);
    cameras.reset(camera_dim);
    let mut entry = Eliminated::<3>::empty();
    let mut sums = Blocks::<3>::default();
    let (mut h, mut b) = (DMatrix::zeros(dim + 3, dim + 3), DVector::zeros(dim + 3));
    let mut add = |j: &Jacobians<3>, r: &Vector2<f64>, signed: &[(usize, f64)], heading: f64| {
        for d in 0..2 {
            let mut by_cameras = DVector::zeros(camera_dim);
            by_cameras[CAMERA_TIME_OFFSET] = j.time_offset[d];
            by_cameras[CAMERA_HEADING] = heading * f64::from(d as u32 + 1);
            for (camera, sign) in signed {
                let mut to = by_cameras.rows_mut(unknown_of_camera(*camera), POSE_DIM);
                to += j.camera.row(d).transpose() * *sign;
            }
            let mut row = DVector::zeros(dim + 3);
            row.rows_mut(0, dim).copy_from(&l.tr_mul(&by_cameras));
            row.rows_mut(dim, 3).copy_from(&j.landmark.row(d).transpose());
            h += &row * row.transpose() * (WEIGHT * WEIGHT);
            b += row * (r[d] * WEIGHT * WEIGHT);
        }
    };
    for (seed, &target) in (1..).zip(targets) {
        let (j, r) = (jacobians(seed), Vector2::new(0.3, -0.8) * f64::from(seed));
        let blocks = Blocks::of(&rows(&j, &r, WEIGHT, host != target));
        sums.add(&blocks);
        if host == target {
            add(&j, &r, &[], 0.0);
        } else {
            blocks.add_target(&mut cameras, (&mut entry, &lifts), (host, target));
            add(&j, &r, &[(host, 1.0), (target, -1.0)], 0.0);
        }
    }
    let (mut j, r) = (jacobians(50), Vector2::new(-0.2, 0.5));
    // A direction is compared with no image: the time offset takes no part.
    j.time_offset.fill(0.0);
    let rows = rows(&j, &r, WEIGHT, true);
    sums.add(&Blocks::of(&rows));
    add_heading(&mut cameras, &mut entry, &rows, &(Vector2::new(0.9, 1.8) * WEIGHT), host);
    add(&j, &r, &[(host, 1.0)], 0.9);

    sums.flush(&mut cameras, (&mut entry, &lifts), host);
    let mut visual = NormalEquations::new(MAX_VISUAL);
    visual.reset(dim);
    lifts.lift(&cameras, &mut visual);
    let (visual_h, visual_b) = full(&visual);
    let (mut found, mut found_b) = (DMatrix::zeros(dim + 3, dim + 3), DVector::zeros(dim + 3));
    found.view_mut((0, 0), (dim, dim)).copy_from(&visual_h);
    found_b.rows_mut(0, dim).copy_from(&visual_b);
    found_b.rows_mut(dim, 3).copy_from(&entry.gradient);
    found.view_mut((dim, dim), (3, 3)).copy_from(&sums.landmark());
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
    for (host, targets) in [(0, &[0, 1, 2, 3][..]), (2, &[0, 1, 3]), (3, &[0, 3, 2]), (1, &[1]), (1, &[2, 0])]
    {
        let [(found, found_b), (h, b)] = by_blocks_and_by_rows(host, targets);
        assert!((&found - &h).norm() < 1e-12 * h.norm(), "host {host}, seen from {targets:?}: J'J");
        assert!((&found_b - &b).norm() < 1e-12 * b.norm(), "host {host}, seen from {targets:?}: J'r");
    }
}
