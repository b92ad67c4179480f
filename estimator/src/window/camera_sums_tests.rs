use super::super::eliminate::Eliminated;
use super::super::feature::{Jacobians, MotionJacobian};
use super::super::landmark_sums::{LandmarkSums, Rows};
use super::super::motions::MotionEquations;
use super::super::motions::test_lifts::{FRAMES, lifts};
use super::super::test_dense::full_motions;
use super::super::test_room::scatter;
use super::*;
use nalgebra::{DMatrix, DVector, SMatrix, Vector2};

/// Cameras of the rig, and those of a room of two frames: 0 and 1 are those of the first.
const CAMERAS: usize = 2;

fn in_o(lifts: &Lifts, camera: usize) -> SMatrix<f64, 6, 6> {
    SMatrix::from_fn(|i, k| lifts.in_o[camera][i][k])
}

/// Some Jacobians: those by motions on mounts follow from those by motions in `O`.
fn jacobians(seed: u32, lifts: &Lifts, host: usize, target: usize) -> Jacobians<3> {
    let mut next = seed * 1000;
    let mut number = || {
        next += 1;
        scatter(next)
    };
    let mut j = Jacobians::<3>::zeros();
    let camera = SMatrix::<f64, 6, 2>::from_fn(|_, _| number());
    j.time_offset.iter_mut().for_each(|x| *x = number());
    j.landmark.iter_mut().for_each(|x| *x = number());
    j.camera = rows(&camera);
    j.host = rows(&in_o(lifts, host).tr_mul(&camera));
    j.target = rows(&in_o(lifts, target).tr_mul(&camera));
    j
}

/// Jacobian rows whose fourth lane must not count.
fn rows(by: &SMatrix<f64, 6, 2>) -> MotionJacobian {
    std::array::from_fn(|d| [0, 3].map(|at| [by[(at, d)], by[(at + 1, d)], by[(at + 2, d)], 5.0]))
}

/// Jacobians of an observation, its residual, and the rows of a lens from their first unknown on.
type Observed<'a> = (&'a Jacobians<3>, &'a Vector2<f64>, (usize, &'a LensRows));

/// Whole rows, and the sum of their products.
struct Full {
    h: DMatrix<f64>,
    dim: usize,
}

impl Full {
    /// Adds both rows of an observation, by the cameras with their signs.
    fn add(&mut self, (j, r, (at, by_lens)): Observed<'_>, signed: &[(usize, f64)]) {
        for d in 0..2 {
            let mut row = DVector::zeros(self.dim + 3);
            row[TIME_OFFSET] = j.time_offset[d];
            row[RESIDUAL] = r[d];
            (0..LENS).for_each(|k| row[at + k] = by_lens[d][k]);
            for (camera, sign) in signed {
                let on_mount = if *sign > 0.0 { &j.host } else { &j.target };
                for k in 0..POSE_DIM {
                    row[motion_of_camera(camera % CAMERAS) + k] += sign * on_mount[d][k / 3][k % 3];
                    row[motion_of_frame(camera / CAMERAS) + k] += sign * j.camera[d][k / 3][k % 3];
                }
            }
            row.rows_mut(self.dim, 3).copy_from(&j.landmark.row(d).transpose());
            self.h += &row * row.transpose();
        }
    }
}

/// `J'J` of landmarks, each in a camera and observed from others, by the sums and by full rows.
fn by_sums_and_by_rows(landmarks: &[(usize, &[usize])]) -> [DMatrix<f64>; 2] {
    let (lifts, _) = lifts();
    let mut equations = MotionEquations::default();
    equations.reset(FRAMES, true);
    let dim = equations.dim;
    let mut full = Full { h: DMatrix::zeros(dim + 3, dim + 3), dim };
    let mut cameras = CameraSums::default();
    cameras.reset(FRAMES, CAMERAS);
    let mut found = DMatrix::zeros(dim + 3, dim + 3);
    for (n, (host, targets)) in (0..).zip(landmarks) {
        let mut entry = Eliminated::<3>::empty();
        entry.reset(dim);
        let mut sums = LandmarkSums::<3>::default();
        cameras.begin_host(*host, &lifts, &mut equations);
        let r = Vector2::new(0.3, -0.8);
        for (seed, &target) in (10 * n..).zip(*targets) {
            let j = jacobians(seed, &lifts, *host, target);
            let on_mounts = ((host % CAMERAS) as u8, (target % CAMERAS) as u8);
            let mut rows = Rows::ZERO;
            rows.set(&j, &r, on_mounts, *host == target);
            let by_lens =
                [0, 1].map(|d| std::array::from_fn(|k| scatter(7000 + 10 * seed + 4 * d + k as u32)));
            cameras.add(target, &rows.by_camera, Some(&by_lens));
            sums.add(&rows, target / CAMERAS, &mut entry);
            sums.add_lens(&rows, &by_lens, target % CAMERAS);
            let signed = if *host == target { &[][..] } else { &[(*host, 1.0), (target, -1.0)] };
            full.add((&j, &r, (motion_of_lens(target % CAMERAS), &by_lens)), signed);
        }
        let own = sums.finish(&mut entry, host / CAMERAS);
        let mut to = found.view_mut((dim, dim), (3, 3));
        to += own;
        for (r, row) in entry.rows.iter().enumerate() {
            for (k, value) in row[..dim].iter().enumerate() {
                found[(dim + r, k)] += value;
                found[(k, dim + r)] += value;
            }
        }
    }
    cameras.finish(&lifts, &mut equations);
    found.view_mut((0, 0), (dim, dim)).copy_from(&full_motions(&equations));
    // What the residuals are by themselves is not asked.
    found[(RESIDUAL, RESIDUAL)] = full.h[(RESIDUAL, RESIDUAL)];
    [found, full.h]
}

#[test]
fn sums_are_those_of_the_products_of_full_rows() {
    let all: [(usize, &[usize]); 5] =
        [(0, &[0, 1, 2, 3]), (2, &[0, 1, 3]), (3, &[0, 3, 2]), (1, &[1]), (1, &[2, 0])];
    for landmarks in all.iter().map(std::slice::from_ref).chain([&all[..]]) {
        let [found, expected] = by_sums_and_by_rows(landmarks);
        assert!((found - &expected).norm() < 1e-12 * expected.norm(), "{landmarks:?}");
    }
}
