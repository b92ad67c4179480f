//! The pose of a rig from its matches with the map, by robust least squares, and the covariance of that pose.
//!
//! A stereo pair measures a feature as `(x, y, rho)`: direction and inverse depth in the left camera, the latter being
//! what the right camera adds. With the map's point `X` (covariance `S_X`) and the pose `(p, R)` of the body:
//!
//! `b = R^T (X - p)`, `q = T_CB b`, residual `e = (q_x / q_z, q_y / q_z, 1 / q_z) - (x, y, rho)`,
//! covariance `S = diag(s_xy², s_xy², s_rho²) + D R_CM S_X R_CM^T D^T` with `D = de/dq`.
//!
//! So a point that the map knows badly counts little, along the direction in which it is known badly. A seventh unknown
//! `beta` is the share that all inverse depths of a rig have in common, because its calibration is out: in units of
//! the standard deviation, with a prior of `COMMON_SHARE`. It is what makes distant scenes as uncertain as they are:
//! their depths are not wrong at random. Perturbation:
//! position in `M`, attitude on the right (`R Exp(dtheta)`); `de/dp = -D R_CM`, `de/dtheta = D R_CB [b]x`.
//! Gravity measures `R^T e_z`. Kernel: Cauchy on the Mahalanobis distance.

use super::feature::Feature;
use super::matching::{MapPoint, Match};
use crate::geometry::{exp_so3, skew};
use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_config::Portable;

/// Steps of a refinement.
const MAX_STEPS: usize = 8;
/// A step shorter than this ends it: 0.01 mm, and 0.0006 degrees.
const TOLERANCE: f64 = 1e-5;
/// Square of the Mahalanobis distance at which the kernel halves a weight.
const KERNEL: f64 = 6.0;
/// Square of the Mahalanobis distance of an inlier: 99 % of three, and of two, Gaussian components.
pub const GATE: [f64; 2] = [11.34, 9.21];
/// Variance of an inverse depth that was not measured, 1/m².
const UNKNOWN_DEPTH: f64 = 1e6;
/// Standard deviation of what the errors of all inverse depths have in common, in standard deviations of one: a
/// calibration out by a third of a pixel of disparity.
const COMMON_SHARE: f64 = 1.0;
/// Unknowns: position, attitude, common share.
const UNKNOWNS: usize = 7;
/// Least cosine of the angle between the directions in which two cameras see a point: 75 degrees. Beyond, its patches do
/// not look alike, and a mirrored wall would be the wall seen from behind.
const MIN_COSINE: f64 = 0.26;
/// Points nearer than this to the camera's plane are not seen, m.
pub(super) const MIN_DEPTH_M: f64 = 0.05;

/// Prior of the attitude by gravity.
#[derive(Clone, Copy, Debug)]
pub struct Gravity {
    /// Direction of up in the body.
    pub up_b: Vector3<f64>,
    /// Standard deviation, rad.
    pub sigma_rad: f64,
}

/// Input of the refinement.
#[derive(Clone, Copy)]
pub struct PoseProblem<'a> {
    /// Features of the frame.
    pub query: &'a [Feature],
    /// Points of the map.
    pub points: &'a [MapPoint],
    /// Pose of the left camera in the body.
    pub pose_b_c: Isometry3<f64>,
    /// The vertical.
    pub gravity: Gravity,
}

/// A pose and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Pose of the body in the map.
    pub pose_m_b: Isometry3<f64>,
    /// Covariance of position (0..3, in `M`) and attitude (3..6, right perturbation, rad).
    pub covariance: Matrix6<f64>,
    /// Mean square of the whitened residuals of the inliers, 1 when the noise is what it is said to be.
    pub variance: f64,
}

/// Information about all unknowns.
type Information = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Residual of a match and what belongs to it.
struct Residual {
    error: Vector3<f64>,
    /// Square of its Mahalanobis distance.
    distance2: f64,
    information: Matrix3<f64>,
    by_unknowns: SMatrix<f64, 3, UNKNOWNS>,
}

/// A pose at which residuals are computed, with what all of them share.
pub(super) struct Viewpoint<'a> {
    problem: &'a PoseProblem<'a>,
    p_m_b: Vector3<f64>,
    p_m_c: Vector3<f64>,
    rot_b_m: UnitQuaternion<f64>,
    rot_c_b: UnitQuaternion<f64>,
    matrix_b_m: Matrix3<f64>,
    matrix_c_b: Matrix3<f64>,
}

/// The part of a residual that tells an inlier.
struct Whitened {
    error: Vector3<f64>,
    distance2: f64,
    information: Matrix3<f64>,
    /// The point in the body.
    b: Vector3<f64>,
    by_b: Matrix3<f64>,
    by_m: Matrix3<f64>,
}

impl<'a> Viewpoint<'a> {
    pub(super) fn new(problem: &'a PoseProblem<'a>, pose_m_b: &Isometry3<f64>) -> Self {
        let (rot_b_m, rot_c_b) = (pose_m_b.rotation.inverse(), problem.pose_b_c.rotation.inverse());
        Self {
            problem,
            p_m_b: pose_m_b.translation.vector,
            p_m_c: (pose_m_b * problem.pose_b_c).translation.vector,
            rot_b_m,
            rot_c_b,
            matrix_b_m: *rot_b_m.to_rotation_matrix().matrix(),
            matrix_c_b: *rot_c_b.to_rotation_matrix().matrix(),
        }
    }

    /// Square of the Mahalanobis distance of a match over the gate of its number of components: an inlier has at most
    /// one; `None` behind the camera, and where the point would be seen from too different a side.
    pub(super) fn gated_distance(&self, item: &Match) -> Option<f64> {
        let point = &self.problem.points[item.point as usize];
        let ray = point.position_m - self.p_m_c;
        if ray.dot(&point.ray_m) < MIN_COSINE * ray.norm() {
            return None;
        }
        let gate = GATE[usize::from(!self.problem.query[item.query as usize].has_depth())];
        self.whitened(item).map(|r| r.distance2 / gate)
    }

    #[inline(always)]
    fn whitened(&self, item: &Match) -> Option<Whitened> {
        let problem = self.problem;
        let (seen, point) = (&problem.query[item.query as usize], &problem.points[item.point as usize]);
        let b = self.rot_b_m * (point.position_m - self.p_m_b);
        let q = self.rot_c_b * (b - problem.pose_b_c.translation.vector);
        // Written so that a NaN fails.
        let is_ahead = q.z > MIN_DEPTH_M;
        if !is_ahead {
            return None;
        }
        let w = 1.0 / q.z;
        let seen_depth = if seen.has_depth() { f64::from(seen.inverse_depth) } else { w };
        let error = Vector3::new(q.x * w, q.y * w, w)
            - Vector3::new(f64::from(seen.xy.x), f64::from(seen.xy.y), seen_depth);
        let by_q = Matrix3::new(w, 0.0, -q.x * w * w, 0.0, w, -q.y * w * w, 0.0, 0.0, -w * w);
        let by_b = by_q * self.matrix_c_b;
        let by_m = by_b * self.matrix_b_m;
        let across = f64::from(seen.sigma_xy).squared();
        let along =
            if seen.has_depth() { f64::from(seen.sigma_inverse_depth).squared() } else { UNKNOWN_DEPTH };
        let covariance = Matrix3::from_diagonal(&Vector3::new(across, across, along))
            + by_m * point.covariance_m * by_m.transpose();
        let information = covariance.try_inverse()?;
        let distance2 = error.dot(&(information * error));
        Some(Whitened { error, distance2, information, b, by_b, by_m })
    }

    fn residual(&self, item: &Match) -> Option<Residual> {
        let Whitened { error, distance2, information, b, by_b, by_m } = self.whitened(item)?;
        let (seen, point) =
            (&self.problem.query[item.query as usize], &self.problem.points[item.point as usize]);
        let mut by_unknowns = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        by_unknowns.fixed_columns_mut::<3>(0).copy_from(&-by_m);
        by_unknowns.fixed_columns_mut::<3>(3).copy_from(&(by_b * skew(&b)));
        let of_seen = if seen.has_depth() { f64::from(seen.sigma_inverse_depth) } else { 0.0 };
        by_unknowns.set_column(6, &(by_m * point.by_depth_m + Vector3::new(0.0, 0.0, of_seen)));
        Some(Residual { error, distance2, information, by_unknowns })
    }
}

impl PoseProblem<'_> {
    /// Information and gradient of the matches and of gravity at a pose.
    ///
    /// The common share stays at zero in the residuals: its gradient is solved for with the others, and what it would
    /// move is small beside their noise.
    fn linearize(
        &self,
        pose_m_b: &Isometry3<f64>,
        matches: &[Match],
    ) -> (Information, SVector<f64, UNKNOWNS>) {
        let (mut h, mut g) = (Information::zeros(), SVector::<f64, UNKNOWNS>::zeros());
        h[(6, 6)] = 1.0 / (COMMON_SHARE * COMMON_SHARE);
        let here = Viewpoint::new(self, pose_m_b);
        for residual in matches.iter().filter_map(|m| here.residual(m)) {
            let weight = 1.0 / (1.0 + residual.distance2 / KERNEL);
            let weighted = residual.by_unknowns.transpose() * residual.information * weight;
            h += weighted * residual.by_unknowns;
            g += weighted * residual.error;
        }
        let up = pose_m_b.rotation.inverse() * Vector3::z();
        let (error, by_theta) = (up - self.gravity.up_b, skew(&up));
        let weighted = by_theta.transpose() / self.gravity.sigma_rad.squared();
        let mut corner = h.fixed_view_mut::<3, 3>(3, 3);
        corner += weighted * by_theta;
        let mut lower = g.fixed_rows_mut::<3>(3);
        lower += weighted * error;
        (h, g)
    }

    /// Refines a pose over matches that are inliers, or nearly; `None` when they do not determine it.
    #[must_use]
    pub fn refine(&self, start: &Isometry3<f64>, matches: &[Match]) -> Option<Refined> {
        let mut pose_m_b = *start;
        for _ in 0..MAX_STEPS {
            let (h, g) = self.linearize(&pose_m_b, matches);
            let step = -h.cholesky()?.solve(&g);
            if !step.iter().all(|x| x.is_finite()) {
                return None;
            }
            pose_m_b.translation.vector += step.fixed_rows::<3>(0);
            pose_m_b.rotation *= exp_so3(&step.fixed_rows::<3>(3).into_owned());
            if step.fixed_rows::<6>(0).norm() < TOLERANCE {
                break;
            }
        }
        let (h, _) = self.linearize(&pose_m_b, matches);
        let covariance = h.cholesky()?.inverse().fixed_view::<6, 6>(0, 0).into_owned();
        Some(Refined { pose_m_b, covariance, variance: self.variance(&pose_m_b, matches) })
    }

    /// Mean square of the whitened residuals, by degrees of freedom.
    fn variance(&self, pose_m_b: &Isometry3<f64>, matches: &[Match]) -> f64 {
        let (mut sum, mut components) = (0.0, 0.0);
        let here = Viewpoint::new(self, pose_m_b);
        for item in matches {
            if let Some(residual) = here.whitened(item) {
                sum += residual.distance2;
                components += if self.query[item.query as usize].has_depth() { 3.0 } else { 2.0 };
            }
        }
        if components > 6.0 { sum / (components - 6.0) } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::Descriptor;
    use nalgebra::Vector2;

    /// The residual's derivative by position, attitude and common share, by differences.
    #[test]
    fn the_jacobian_agrees_with_differences() {
        let query = [Feature {
            descriptor: Descriptor::default(),
            xy: Vector2::new(0.1, -0.2),
            sigma_xy: 0.002,
            inverse_depth: 0.4,
            sigma_inverse_depth: 0.007,
        }];
        let point = |share: f64| {
            let by_depth_m = Vector3::new(0.02, -0.05, 0.01);
            MapPoint {
                sigma_xy: 0.002,
                position_m: Vector3::new(0.7, 0.3, 2.9) + by_depth_m * share,
                covariance_m: Matrix3::identity() * 1e-4,
                by_depth_m,
                range_m: 3.0,
                ray_m: Vector3::z(),
            }
        };
        let pose_b_c = Isometry3::new(Vector3::new(0.1, 0.02, -0.05), Vector3::new(0.1, -0.2, 0.05));
        let pose = Isometry3::new(Vector3::new(0.3, 0.1, -0.2), Vector3::new(-0.1, 0.15, 0.3));
        let item = Match { query: 0, point: 0, ratio: 0.0 };
        let residual = |pose: &Isometry3<f64>, share: f64| {
            let points = [point(share)];
            let gravity = Gravity { up_b: Vector3::z(), sigma_rad: 1.0 };
            let problem = PoseProblem { query: &query, points: &points, pose_b_c, gravity };
            let mut found = Viewpoint::new(&problem, pose).residual(&item).unwrap();
            found.error.z += share * f64::from(query[0].sigma_inverse_depth);
            found
        };
        let analytic = residual(&pose, 0.0).by_unknowns;
        for i in 0..UNKNOWNS {
            let moved = |step: f64| {
                let mut pose = pose;
                let mut unit = Vector3::zeros();
                unit[i % 3] = step;
                match i / 3 {
                    0 => pose.translation.vector += unit,
                    1 => pose.rotation *= exp_so3(&unit),
                    _ => return residual(&pose, step).error,
                }
                residual(&pose, 0.0).error
            };
            let numeric = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            let difference = (numeric - analytic.column(i)).norm();
            assert!(
                difference < 1e-7 * (1.0 + numeric.norm()),
                "unknown {i}: {numeric} against {}",
                analytic.column(i)
            );
        }
    }
}
