//! Finds of a calibration, and how sure it is of them.

use super::adjust::{Adjusted, Cameras, PAIR, SharedMatrix, Sight};
use super::lens::{LENS, project};
use super::target::Target;
use nalgebra::{Isometry3, Matrix3, Vector2, Vector3};
use plumbline_config::CameraModel;

/// Cells of the image in which corners are counted, across and down.
const CELLS: [usize; 2] = [8, 6];

/// Where a corner was seen, and how far from where it is projected to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Its number on the board.
    pub number: usize,
    /// Where it was seen, px.
    pub px: Vector2<f64>,
    /// Projected less seen, px.
    pub error_px: Vector2<f64>,
}

/// A camera.
#[derive(Clone, Debug)]
pub struct CameraResult {
    /// Its calibration.
    pub model: CameraModel,
    /// Standard deviations of focal lengths, principal point (px) and the coefficients; 0 for unknowns that the lens
    /// lacks.
    pub sigmas: [f64; LENS],
    /// Root of the mean squared distance of its corners, px.
    pub rms_px: f64,
    /// Views that it has.
    pub views: usize,
    /// Share of the [`CELLS`] of its image in which corners were seen.
    pub coverage: f64,
    /// Its corners, view after view.
    pub residuals: Vec<Residual>,
}

/// The right camera against the left one.
#[derive(Clone, Copy, Debug)]
pub struct PairResult {
    /// `T_C0C1`: takes coordinates from the right camera to the left one.
    pub pose_c0_c1: Isometry3<f64>,
    /// Distance of the cameras, m.
    pub baseline_m: f64,
    /// Its standard deviation by the images, m; the error of the board's measured size comes on top.
    pub baseline_sigma_m: f64,
    /// Standard deviations of the rotation about the axes of the left camera, rad.
    pub rotation_sigma_rad: Vector3<f64>,
    /// Standard deviations of the right camera's place along the axes of the left camera, m.
    pub translation_sigma_m: Vector3<f64>,
}

/// A view of the board.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewResult {
    /// Name of the images.
    pub name: String,
    /// Corners seen by each camera.
    pub corners: [usize; 2],
    /// Root of their mean squared distance, px.
    pub rms_px: [Option<f64>; 2],
    /// Distance of the board's middle from the left camera, m.
    pub distance_m: f64,
    /// Angle of the board from facing the left camera, degrees.
    pub tilt_deg: f64,
}

/// A calibration.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The board.
    pub target: Target,
    /// One or two.
    pub cameras: Vec<CameraResult>,
    /// Right against left, of two.
    pub pair: Option<PairResult>,
    /// The views that were used.
    pub views: Vec<ViewResult>,
    /// Names of the images that show no board, or too little of it.
    pub unused: Vec<String>,
    /// Root of the mean squared distance of all corners, px.
    pub rms_px: f64,
    /// All corners.
    pub corners: usize,
}

impl Calibration {
    pub(super) fn sum_up(
        target: &Target,
        points: &[Vector2<f64>],
        sights: &[Sight],
        adjusted: &Adjusted,
        covariance: &SharedMatrix,
        (names, unused): (Vec<String>, Vec<String>),
    ) -> Self {
        let residuals = residuals(points, sights, adjusted);
        let camera = |(index, model): (usize, &CameraModel)| {
            let sigmas = std::array::from_fn(|k| sigma(covariance, index * LENS + k));
            camera_result(model, sigmas, residuals.iter().map(|view| view[index].as_slice()))
        };
        let cameras = &adjusted.cameras;
        let views = names.into_iter().zip(&residuals).zip(&adjusted.poses_c0_t);
        Self {
            target: *target,
            cameras: cameras.models.iter().enumerate().map(camera).collect(),
            pair: (cameras.models.len() == 2).then(|| pair_result(cameras, covariance)),
            views: views.map(|((name, view), pose)| view_result(name, view, pose, points)).collect(),
            unused,
            rms_px: (adjusted.cost / adjusted.corners.max(1) as f64).sqrt(),
            corners: adjusted.corners,
        }
    }
}

fn sigma(covariance: &SharedMatrix, k: usize) -> f64 {
    covariance[(k, k)].max(0.0).sqrt()
}

type ViewResiduals = [Vec<Residual>; 2];

fn residuals(points: &[Vector2<f64>], sights: &[Sight], adjusted: &Adjusted) -> Vec<ViewResiduals> {
    let cameras = &adjusted.cameras;
    let of = |camera: usize, sight: &Sight, pose: &Isometry3<f64>| -> Vec<Residual> {
        let residual = |corner: &super::Corner| {
            let at = project(
                cameras.models.get(camera)?,
                &cameras.seen_from(camera, pose, &points[corner.number]),
            )?;
            Some(Residual { number: corner.number, px: corner.px, error_px: at.px - corner.px })
        };
        sight[camera].iter().filter_map(residual).collect()
    };
    sights.iter().zip(&adjusted.poses_c0_t).map(|(s, pose)| [of(0, s, pose), of(1, s, pose)]).collect()
}

fn rms(residuals: &[Residual]) -> Option<f64> {
    let sum: f64 = residuals.iter().map(|r| r.error_px.norm_squared()).sum();
    (!residuals.is_empty()).then(|| (sum / residuals.len() as f64).sqrt())
}

fn camera_result<'a>(
    model: &CameraModel,
    sigmas: [f64; LENS],
    views: impl Iterator<Item = &'a [Residual]> + Clone,
) -> CameraResult {
    let residuals: Vec<Residual> = views.clone().flatten().copied().collect();
    CameraResult {
        model: *model,
        sigmas,
        rms_px: rms(&residuals).unwrap_or(0.0),
        views: views.filter(|view| !view.is_empty()).count(),
        coverage: coverage(model, &residuals),
        residuals,
    }
}

/// Share of the [`CELLS`] of an image in which corners were seen.
fn coverage(model: &CameraModel, residuals: &[Residual]) -> f64 {
    let [across, down] = CELLS;
    let mut is_seen = vec![false; across * down];
    // A float to usize saturates, at 0 too.
    let cell = |at: f64, size: usize, cells: usize| {
        (((at + 0.5) / size as f64 * cells as f64) as usize).min(cells - 1)
    };
    for Residual { px, .. } in residuals {
        is_seen[cell(px.y, model.height_px, down) * across + cell(px.x, model.width_px, across)] = true;
    }
    is_seen.iter().filter(|seen| **seen).count() as f64 / is_seen.len() as f64
}

fn pair_result(cameras: &Cameras, covariance: &SharedMatrix) -> PairResult {
    let shift = cameras.pose_c1_c0.translation.vector;
    let block = |at: usize| covariance.fixed_view::<3, 3>(PAIR + at, PAIR + at).into_owned();
    let (turn, of_shift): (Matrix3<f64>, Matrix3<f64>) = (block(0), block(3));
    let baseline_m = shift.norm();
    let along = shift / baseline_m.max(f64::MIN_POSITIVE);
    // The place of the right camera in the left one is -Rᵀ t.
    let rot_c0_c1 = cameras.pose_c1_c0.rotation.inverse().to_rotation_matrix();
    let cross: Matrix3<f64> = covariance.fixed_view::<3, 3>(PAIR + 3, PAIR).into_owned();
    let p_c0 = -(rot_c0_c1 * shift);
    // R <- R Exp(dtheta) moves it by p x dtheta.
    let (by_turn, by_shift) = (p_c0.cross_matrix(), -rot_c0_c1.into_inner());
    let mixed = by_shift * cross * by_turn.transpose();
    let place = by_turn * turn * by_turn.transpose()
        + by_shift * of_shift * by_shift.transpose()
        + mixed
        + mixed.transpose();
    PairResult {
        pose_c0_c1: cameras.pose_c1_c0.inverse(),
        baseline_m,
        baseline_sigma_m: (along.transpose() * of_shift * along).x.max(0.0).sqrt(),
        rotation_sigma_rad: turn.diagonal().map(|v| v.max(0.0).sqrt()),
        translation_sigma_m: place.diagonal().map(|v| v.max(0.0).sqrt()),
    }
}

fn view_result(
    name: String,
    [left, right]: &ViewResiduals,
    pose_c0_t: &Isometry3<f64>,
    points: &[Vector2<f64>],
) -> ViewResult {
    let middle = points.iter().sum::<Vector2<f64>>() / points.len().max(1) as f64;
    let middle = pose_c0_t * nalgebra::Point3::new(middle.x, middle.y, 0.0);
    let normal = pose_c0_t.rotation * Vector3::z();
    ViewResult {
        name,
        corners: [left.len(), right.len()],
        rms_px: [rms(left), rms(right)],
        distance_m: middle.coords.norm(),
        tilt_deg: normal.z.abs().clamp(0.0, 1.0).acos().to_degrees(),
    }
}
