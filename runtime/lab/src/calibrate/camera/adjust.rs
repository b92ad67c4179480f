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

/// Corners that both cameras see of the board at one time; nothing where there is no camera or no board.
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
    pub fn single(model: CameraModel) -> Self {
        Self { models: vec![model], pose_c1_c0: Isometry3::identity() }
    }

    /// The pose of camera `index` against the left one, `T_CC0`.
    pub fn pose_c_c0(&self, index: usize) -> Isometry3<f64> {
        if index == 0 { Isometry3::identity() } else { self.pose_c1_c0 }
    }

    /// Where a point of the board is in camera `index`, m.
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

/// Outcome of an adjustment.
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
mod tests;
