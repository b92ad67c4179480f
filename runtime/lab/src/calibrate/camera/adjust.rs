//! Adjustment of one or two cameras together with the poses of the board, and the covariance of what comes out.
//!
//! Unknowns: the lens of each camera ([`lens`]), the pose `T_C1C0` between them, and the pose `T_C0T` of the board (frame
//! `T`) in every view. The sum of the squared distances of corners from where they are projected to is minimized by
//! Levenberg and Marquardt's method; the poses of the views are eliminated (Triggs et al. 2000, Bundle Adjustment: A Modern
//! Synthesis, 6.1). Perturbations are on the right, `R <- R Exp(dtheta)`, and `t <- t + dt`.
//!
//! [`lens`]: super::lens

use super::lens::{LENS, names, project, stepped};
use nalgebra::{
    Cholesky, Isometry3, Matrix2x3, Matrix3, Matrix6, SMatrix, SVector, Translation3, UnitQuaternion,
    Vector2, Vector3, Vector6,
};
use plumbline_config::CameraModel;

/// Unknowns that the views share: two lenses, and rotation and translation of `T_C1C0`.
pub const SHARED: usize = 2 * LENS + POSE;
/// Where `T_C1C0` stands among them.
pub const PAIR: usize = 2 * LENS;
const POSE: usize = 6;

/// A symmetric matrix over the shared unknowns.
pub type SharedMatrix = SMatrix<f64, SHARED, SHARED>;
type SharedVector = SVector<f64, SHARED>;
type Coupling = SMatrix<f64, SHARED, POSE>;

/// Most steps, and how many times a step that leads up is tried shorter.
const MAX_STEPS: usize = 200;
const MAX_TRIES: usize = 12;
/// A step that lowers the cost by less than this share is the last.
const SMALLEST_GAIN: f64 = 1e-9;
const FIRST_DAMPING: f64 = 1e-3;
/// The pose of a view is known no better than this share of its own information, so that it can always be eliminated.
const POSE_FLOOR: f64 = 1e-12;

/// A corner of the board in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Its number on the board.
    pub number: usize,
    /// Where it is seen, px.
    pub px: Vector2<f64>,
}

/// What both cameras see of the board at one time; nothing where there is no camera or no board.
pub type Sight = [Vec<Corner>; 2];

/// One or two cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Cameras {
    /// Left, and right where there are two.
    pub models: Vec<CameraModel>,
    /// `T_C1C0`: takes coordinates from the left camera to the right one.
    pub pose_c1_c0: Isometry3<f64>,
}

impl Cameras {
    /// A camera by itself.
    #[must_use]
    pub fn single(model: CameraModel) -> Self {
        Self { models: vec![model], pose_c1_c0: Isometry3::identity() }
    }

    /// The pose of camera `index` against the left one, `T_CC0`.
    #[must_use]
    pub fn pose_c_c0(&self, index: usize) -> Isometry3<f64> {
        if index == 0 { Isometry3::identity() } else { self.pose_c1_c0 }
    }

    /// Where a point of the board is in camera `index`, m.
    #[must_use]
    pub fn seen_from(&self, index: usize, pose_c0_t: &Isometry3<f64>, point: &Vector2<f64>) -> Vector3<f64> {
        let p_t = nalgebra::Point3::new(point.x, point.y, 0.0);
        (self.pose_c_c0(index) * pose_c0_t * p_t).coords
    }

    fn stepped(&self, step: &SharedVector) -> Self {
        let models = self.models.iter().enumerate();
        let models = models
            .map(|(k, model)| stepped(model, &step.fixed_rows::<LENS>(k * LENS).into_owned()))
            .collect();
        Self { models, pose_c1_c0: moved(&self.pose_c1_c0, &step.fixed_rows::<POSE>(PAIR).into_owned()) }
    }
}

/// `R Exp(dtheta)`, `t + dt` of `(dtheta, dt)`.
fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let shift = step.fixed_rows::<3>(3).into_owned();
    Isometry3::from_parts(Translation3::from(pose.translation.vector + shift), pose.rotation * turn)
}

/// What comes out of an adjustment.
#[derive(Clone, Debug)]
pub struct Adjusted {
    /// The cameras.
    pub cameras: Cameras,
    /// The pose of the board in each view.
    pub poses_c0_t: Vec<Isometry3<f64>>,
    /// Sum of the squared distances, px².
    pub cost: f64,
    /// Corners.
    pub corners: usize,
}

/// The normal equations of one view.
struct ViewSystem {
    shared: SharedMatrix,
    coupling: Coupling,
    pose: Matrix6<f64>,
    shared_gradient: SharedVector,
    pose_gradient: Vector6<f64>,
    cost: f64,
    corners: usize,
}

impl ViewSystem {
    fn new() -> Self {
        Self {
            shared: SharedMatrix::zeros(),
            coupling: Coupling::zeros(),
            pose: Matrix6::zeros(),
            shared_gradient: SharedVector::zeros(),
            pose_gradient: Vector6::zeros(),
            cost: 0.0,
            corners: 0,
        }
    }

    /// Adds a corner by its distance and the derivatives of its pixel by lens, pair and pose.
    fn add(
        &mut self,
        camera: usize,
        error: &Vector2<f64>,
        (by_lens, by_pair, by_pose): (&SMatrix<f64, 2, LENS>, &SMatrix<f64, 2, POSE>, &SMatrix<f64, 2, POSE>),
    ) {
        let lens = camera * LENS;
        add_block(&mut self.shared, (lens, lens), by_lens, by_lens);
        add_block(&mut self.coupling, (lens, 0), by_lens, by_pose);
        add_rows(&mut self.shared_gradient, lens, by_lens, error);
        if camera == 1 {
            add_block(&mut self.shared, (lens, PAIR), by_lens, by_pair);
            add_block(&mut self.shared, (PAIR, lens), by_pair, by_lens);
            add_block(&mut self.shared, (PAIR, PAIR), by_pair, by_pair);
            add_block(&mut self.coupling, (PAIR, 0), by_pair, by_pose);
            add_rows(&mut self.shared_gradient, PAIR, by_pair, error);
        }
        self.pose += by_pose.transpose() * by_pose;
        self.pose_gradient += by_pose.transpose() * error;
        self.cost += error.norm_squared();
        self.corners += 1;
    }

    /// The pose's information, damped, ready to be solved with.
    fn damped_pose(&self, damping: f64) -> Option<Cholesky<f64, nalgebra::U6>> {
        let mut pose = self.pose;
        let floor = POSE_FLOOR * self.pose.trace() + f64::MIN_POSITIVE;
        for k in 0..POSE {
            pose[(k, k)] += damping * self.pose[(k, k)] + floor;
        }
        pose.cholesky()
    }
}

fn add_block<const R: usize, const C: usize, const A: usize, const B: usize>(
    into: &mut SMatrix<f64, R, C>,
    at: (usize, usize),
    a: &SMatrix<f64, 2, A>,
    b: &SMatrix<f64, 2, B>,
) {
    let mut block = into.fixed_view_mut::<A, B>(at.0, at.1);
    block += a.transpose() * b;
}

fn add_rows<const A: usize>(
    into: &mut SharedVector,
    at: usize,
    a: &SMatrix<f64, 2, A>,
    error: &Vector2<f64>,
) {
    let mut rows = into.fixed_rows_mut::<A>(at);
    rows += a.transpose() * error;
}

/// The adjustment at hand.
struct Problem<'a> {
    points_m: &'a [Vector2<f64>],
    sights: &'a [Sight],
}

impl Problem<'_> {
    /// Linearizes a view; `None` when a corner lies behind a camera.
    fn linearize(&self, cameras: &Cameras, pose_c0_t: &Isometry3<f64>, sight: &Sight) -> Option<ViewSystem> {
        let mut system = ViewSystem::new();
        let rot_c0_t: Matrix3<f64> = pose_c0_t.rotation.to_rotation_matrix().into_inner();
        for (camera, model) in cameras.models.iter().enumerate() {
            let pose_c_c0 = cameras.pose_c_c0(camera);
            let rot_c_c0: Matrix3<f64> = pose_c_c0.rotation.to_rotation_matrix().into_inner();
            for corner in &sight[camera] {
                let p_t = self.points_m[corner.number].push(0.0);
                let p_c0 = rot_c0_t * p_t + pose_c0_t.translation.vector;
                let p_c = rot_c_c0 * p_c0 + pose_c_c0.translation.vector;
                let at = project(model, &p_c)?;
                let by_p_c0 = at.by_point * rot_c_c0;
                let by_pair = pose_derivative(&by_p_c0, &at.by_point, &p_c0);
                let by_pose = pose_derivative(&(by_p_c0 * rot_c0_t), &by_p_c0, &p_t);
                system.add(camera, &(at.px - corner.px), (&at.by_lens, &by_pair, &by_pose));
            }
        }
        Some(system)
    }

    fn linearize_all(&self, cameras: &Cameras, poses: &[Isometry3<f64>]) -> Option<Vec<ViewSystem>> {
        self.sights.iter().zip(poses).map(|(sight, pose)| self.linearize(cameras, pose, sight)).collect()
    }
}

/// The derivative of a pixel by a pose `(R, t)` of `R p + t`, given those by `p` turned (`J R`) and by `t` (`J`).
fn pose_derivative(
    by_turned: &Matrix2x3<f64>,
    by_shift: &Matrix2x3<f64>,
    p: &Vector3<f64>,
) -> SMatrix<f64, 2, POSE> {
    let mut all = SMatrix::<f64, 2, POSE>::zeros();
    all.fixed_columns_mut::<3>(0).copy_from(&(-by_turned * p.cross_matrix()));
    all.fixed_columns_mut::<3>(3).copy_from(by_shift);
    all
}

/// The equations of the shared unknowns after the poses are eliminated, and their gradient.
fn reduce(systems: &[ViewSystem], damping: f64) -> Option<(SharedMatrix, SharedVector)> {
    let (mut matrix, mut gradient) = (SharedMatrix::zeros(), SharedVector::zeros());
    for system in systems {
        let pose = system.damped_pose(damping)?;
        let mut shared = system.shared;
        for k in 0..SHARED {
            shared[(k, k)] *= 1.0 + damping;
        }
        matrix += shared - system.coupling * pose.solve(&system.coupling.transpose());
        gradient += system.shared_gradient - system.coupling * pose.solve(&system.pose_gradient);
    }
    // Unknowns that nothing depends on, as those of a camera that is not there, stay as they are.
    for k in 0..SHARED {
        if systems.iter().all(|system| system.shared[(k, k)] == 0.0) {
            matrix[(k, k)] = 1.0;
        }
    }
    Some((matrix, gradient))
}

/// Adjusts cameras and poses to what is seen of the board's points; `None` when what is given is so far off that a point
/// lies behind a camera, or determines nothing.
#[must_use]
pub fn adjust(
    points_m: &[Vector2<f64>],
    sights: &[Sight],
    cameras: &Cameras,
    poses_c0_t: &[Isometry3<f64>],
) -> Option<Adjusted> {
    let problem = Problem { points_m, sights };
    let (mut cameras, mut poses) = (cameras.clone(), poses_c0_t.to_vec());
    let mut systems = problem.linearize_all(&cameras, &poses)?;
    let mut damping = FIRST_DAMPING;
    'steps: for _ in 0..MAX_STEPS {
        let cost = total(&systems);
        for tried in 0..=MAX_TRIES {
            if let Some((next, next_poses)) = step(&systems, damping, &cameras, &poses)
                && let Some(better) = problem.linearize_all(&next, &next_poses).filter(|s| total(s) <= cost)
            {
                (cameras, poses, systems) = (next, next_poses, better);
                damping = (damping * 0.1).max(1e-12);
                break;
            }
            if tried == MAX_TRIES {
                break 'steps;
            }
            damping = (damping * 10.0).min(1e12);
        }
        if cost - total(&systems) <= SMALLEST_GAIN * cost {
            break;
        }
    }
    let (cost, corners) = (total(&systems), systems.iter().map(|s| s.corners).sum());
    cost.is_finite().then_some(Adjusted { cameras, poses_c0_t: poses, cost, corners })
}

fn total(systems: &[ViewSystem]) -> f64 {
    systems.iter().map(|system| system.cost).sum()
}

/// Cameras and poses after a step.
fn step(
    systems: &[ViewSystem],
    damping: f64,
    cameras: &Cameras,
    poses: &[Isometry3<f64>],
) -> Option<(Cameras, Vec<Isometry3<f64>>)> {
    let (matrix, gradient) = reduce(systems, damping)?;
    let shared = -matrix.cholesky()?.solve(&gradient);
    let moved_pose = |(system, pose): (&ViewSystem, &Isometry3<f64>)| {
        let rest = system.pose_gradient + system.coupling.transpose() * shared;
        Some(moved(pose, &-system.damped_pose(damping)?.solve(&rest)))
    };
    let poses = systems.iter().zip(poses).map(moved_pose).collect::<Option<_>>()?;
    Some((cameras.stepped(&shared), poses))
}

/// The covariance of the shared unknowns; rotations in rad about the axes of the left camera, the rest in px, m and the
/// coefficients' own units. `None` where the views do not determine them.
///
/// Computes two estimates and returns the larger variances. One uses the noise of the corners alone. The other uses how
/// far each view pulls by itself (the cluster-robust sandwich of Liang and Zeger 1986, with a view as a cluster); it is
/// larger where errors of a view have a common cause, such as a bent board, motion blur or a lens model that does not
/// fit.
#[must_use]
pub fn covariance(points_m: &[Vector2<f64>], sights: &[Sight], adjusted: &Adjusted) -> Option<SharedMatrix> {
    let problem = Problem { points_m, sights };
    let systems = problem.linearize_all(&adjusted.cameras, &adjusted.poses_c0_t)?;
    let (matrix, _) = reduce(&systems, 0.0)?;
    let inverse = matrix.cholesky()?.inverse();
    let models = &adjusted.cameras.models;
    let of_lenses: usize = models.iter().map(|model| names(model).len()).sum();
    let unknowns = of_lenses + if models.len() > 1 { POSE } else { 0 };
    let measured = 2 * adjusted.corners;
    let free = measured.checked_sub(unknowns + POSE * systems.len()).filter(|free| *free > 0)?;
    let by_noise = inverse * (adjusted.cost / free as f64);
    let mut pulls = SharedMatrix::zeros();
    for system in &systems {
        let pose = system.damped_pose(0.0)?;
        let pull = system.shared_gradient - system.coupling * pose.solve(&system.pose_gradient);
        pulls += pull * pull.transpose();
    }
    let views = systems.len() as f64;
    let by_views = inverse * pulls * inverse * (views / (views - 1.0).max(1.0));
    // The correlations of the noise, with the larger of the two variances.
    let scale = SharedVector::from_fn(|k, _| {
        let (noise, views) = (by_noise[(k, k)], by_views[(k, k)]);
        if noise > 0.0 { (views.max(noise) / noise).sqrt() } else { 1.0 }
    });
    Some(SharedMatrix::from_fn(|i, j| by_noise[(i, j)] * scale[i] * scale[j]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::camera::lens::LensKind;

    fn rig() -> Cameras {
        let model = |f: f64, c: [f64; 2], k: [f64; 4]| CameraModel {
            width_px: 752,
            height_px: 480,
            focal_px: Vector2::new(f, f - 1.0),
            centre_px: Vector2::from(c),
            distortion: LensKind::RadialTangential.distortion(k),
        };
        Cameras {
            models: vec![
                model(458.0, [367.0, 248.0], [-0.28, 0.07, 2e-4, 2e-5]),
                model(457.0, [380.0, 255.0], [-0.28, 0.07, -1e-4, -4e-5]),
            ],
            pose_c1_c0: Isometry3::new(Vector3::new(-0.11, 4e-4, -8e-4), Vector3::new(0.01, -0.002, 0.003)),
        }
    }

    fn points() -> Vec<Vector2<f64>> {
        (0..48).map(|k| Vector2::new(f64::from(k % 8) * 0.08, f64::from(k / 8) * 0.08)).collect()
    }

    /// Poses of the board all over the image, tilted by turns.
    fn poses() -> Vec<Isometry3<f64>> {
        let pose = |k: i32| {
            let (a, b) = (f64::from(k % 4), f64::from(k / 4));
            let shift = Vector3::new(-0.75 + 0.3 * a, -0.5 + 0.2 * b, 0.8 + 0.1 * ((a + b) % 3.0));
            Isometry3::new(shift, Vector3::new(0.5 * (a - 1.5), 0.4 * (b - 1.0), 0.2 * (a - b)))
        };
        (0..12).map(pose).collect()
    }

    /// What the rig sees, each coordinate off by up to `noise_px`.
    fn sights(rig: &Cameras, noise_px: f64) -> Vec<Sight> {
        let mut draw = 1_u64;
        let mut noise = || {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((draw >> 33) as f64 / f64::from(1_u32 << 31) * 2.0 - 1.0) * noise_px
        };
        let mut corners = |camera: usize, pose: &Isometry3<f64>| {
            let seen = points().into_iter().enumerate().filter_map(|(number, point)| {
                let px = rig.models[camera].project(&rig.seen_from(camera, pose, &point))?;
                rig.models[camera].contains(&px, 4.0).then_some(Corner { number, px })
            });
            let seen: Vec<Corner> = seen.collect();
            seen.into_iter().map(|c| Corner { px: c.px + Vector2::new(noise(), noise()), ..c }).collect()
        };
        poses().iter().map(|pose| [corners(0, pose), corners(1, pose)]).collect()
    }

    /// The rig and the poses, put out of place.
    fn disturbed() -> (Cameras, Vec<Isometry3<f64>>) {
        let mut rig = rig();
        for model in &mut rig.models {
            model.focal_px *= 1.06;
            model.centre_px = Vector2::new(375.5, 239.5);
            model.distortion = LensKind::RadialTangential.distortion([0.0; 4]);
        }
        rig.pose_c1_c0.translation.vector *= 0.9;
        let off = Isometry3::new(Vector3::new(0.02, -0.01, 0.05), Vector3::new(0.05, 0.02, -0.03));
        (rig, poses().iter().map(|pose| pose * off).collect())
    }

    #[test]
    fn exact_corners_give_the_rig_back() {
        let (start, poses) = disturbed();
        let sights = sights(&rig(), 0.0);
        let adjusted = adjust(&points(), &sights, &start, &poses).unwrap();
        assert!(adjusted.cost < 1e-12, "{}", adjusted.cost);
        for (found, true_model) in adjusted.cameras.models.iter().zip(rig().models) {
            assert!((found.focal_px - true_model.focal_px).norm() < 1e-6);
            assert!((found.centre_px - true_model.centre_px).norm() < 1e-6);
        }
        let error = adjusted.cameras.pose_c1_c0.inverse() * rig().pose_c1_c0;
        assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9, "{error}");
    }

    #[test]
    fn errors_are_within_three_standard_deviations() {
        let (start, poses) = disturbed();
        let sights = sights(&rig(), 0.4);
        let adjusted = adjust(&points(), &sights, &start, &poses).unwrap();
        let covariance = covariance(&points(), &sights, &adjusted).unwrap();
        for camera in 0..2 {
            let unknowns = |rig: &Cameras| super::super::lens::unknowns(&rig.models[camera]);
            let error = unknowns(&adjusted.cameras) - unknowns(&rig());
            for k in 0..names(&rig().models[camera]).len() {
                let sigma = covariance[(camera * LENS + k, camera * LENS + k)].sqrt();
                assert!(sigma > 0.0 && error[k].abs() < 3.0 * sigma, "{camera} {k}: {} of {sigma}", error[k]);
            }
        }
        let shift = adjusted.cameras.pose_c1_c0.translation.vector - rig().pose_c1_c0.translation.vector;
        for axis in 0..3 {
            let sigma = covariance[(PAIR + 3 + axis, PAIR + 3 + axis)].sqrt();
            assert!(sigma < 1e-3 && shift[axis].abs() < 3.0 * sigma, "{axis}: {} of {sigma}", shift[axis]);
        }
    }

    #[test]
    fn every_lens_is_found_again_from_the_one_it_begins_with() {
        let lenses: [(LensKind, f64, &[f64]); 6] = [
            (LensKind::RadialTangential, 458.0, &[-0.28, 0.07, 2e-4, 2e-5]),
            (LensKind::Equidistant, 300.0, &[-0.01, 0.02, -0.01, 0.002]),
            (LensKind::Rational, 400.0, &[0.4, -0.05, 2e-4, 2e-5, 0.01, 0.7, 0.05, 0.02]),
            (LensKind::Omni, 290.0 * 2.4, &[1.4, -0.2, 0.03, 2e-4, 2e-5]),
            (LensKind::Eucm, 290.0, &[0.6, 1.1]),
            (LensKind::DoubleSphere, 290.0 * 0.8, &[-0.2, 0.6]),
        ];
        for (kind, focal_px, k) in lenses {
            let mut model = rig().models[0];
            (model.distortion, model.focal_px) = (kind.distortion(k), Vector2::repeat(focal_px));
            let sights: Vec<Sight> = sights(&Cameras { models: vec![model, model], ..rig() }, 0.02)
                .into_iter()
                .map(|[left, _]| [left, Vec::new()])
                .collect();
            let mut start = model;
            start.distortion = kind.initial();
            let near_axis = |lens: &CameraModel| lens.distortion.distort(&Vector2::zeros()).1.m11;
            start.focal_px *= 1.05 * near_axis(&model) / near_axis(&start);
            let adjusted = adjust(&points(), &sights, &Cameras::single(start), &poses()).expect("fits");
            // Uniform errors of up to 0.02 px have a root mean square of 0.0163 px for both coordinates.
            let rms_px = (adjusted.cost / adjusted.corners as f64).sqrt();
            assert!(rms_px < 0.018, "{kind:?}: {rms_px} px");
            let covariance = covariance(&points(), &sights, &adjusted);
            assert!(covariance.is_some(), "{kind:?}: not determined");
            let found = &adjusted.cameras.models[0];
            for (x, y) in [(120.0, 100.0), (640.0, 100.0), (376.0, 240.0), (120.0, 400.0), (640.0, 400.0)] {
                let px = Vector2::new(x, y);
                let ray = model.unproject(&px).expect("a pixel of the image").push(1.0);
                let off_px = (found.project(&ray).expect("seen") - px).norm();
                assert!(off_px < 0.3, "{kind:?}: {off_px} px off at {px}");
            }
        }
    }

    #[test]
    fn one_camera_is_adjusted_by_itself() {
        let (start, poses) = disturbed();
        let left: Vec<Sight> = sights(&rig(), 0.0).into_iter().map(|[left, _]| [left, Vec::new()]).collect();
        let adjusted = adjust(&points(), &left, &Cameras::single(start.models[0]), &poses).unwrap();
        assert!((adjusted.cameras.models[0].focal_px - rig().models[0].focal_px).norm() < 1e-6);
        assert!(covariance(&points(), &left, &adjusted).is_some());
    }

    #[test]
    fn a_single_view_of_a_board_before_the_camera_determines_no_lens() {
        let sight = sights(&rig(), 0.3).remove(1);
        let pose = [Isometry3::new(Vector3::new(-0.3, -0.2, 0.7), Vector3::zeros())];
        let sights = [[sight[0].clone(), Vec::new()]];
        let adjusted = adjust(&points(), &sights, &Cameras::single(rig().models[0]), &pose);
        let sigma = adjusted.and_then(|a| covariance(&points(), &sights, &a)).map(|c| c[(0, 0)].sqrt());
        assert!(sigma.is_none_or(|sigma| sigma > 0.2), "{sigma:?}");
    }
}
