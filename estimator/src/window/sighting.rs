//! The pose of the newest frame by its images alone: what they say where the inertial sensor is not to be trusted.
//!
//! Landmarks stay where the window has them; position and attitude of the newest frame are solved for by Gauss-Newton steps
//! on one observation of each, with the reprojection residual of [`super::reprojection`] and a Cauchy kernel. Where the start
//! is no good, a kernel whose scale shrinks from step to step finds the majority from twenty pixels away.

use super::Window;
use super::feature::Feature;
use super::inertial_factor::InertialFactor;
use super::landmark::PointLandmark;
use super::reprojection::{InversePoint, MIN_FORWARD};
use super::state::{Mount, NavState, POSE_DIM};
use super::tracks::MIN_WITNESSES;
use crate::geometry::exp_so3;
use crate::inertial::Preintegration;
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector2, Vector3, Vector6};
use plumbline_config::Portable;

/// Observations that are looked at, at most: as many as tell the attitude to a fraction of a milliradian.
const MAX_RAYS: usize = 64;
/// Scale of the kernel in each step, in standard deviations of an observation: where the start is near, and where it may be
/// twenty pixels off. The wide one is led astray by gross outliers, and comes second.
const NARROW: [f64; 3] = [5.0, 3.0, 3.0];
const WIDE: [f64; 5] = [50.0, 15.0, 5.0, 3.0, 3.0];
/// An observation this far from its landmark does not agree, in standard deviations.
const AGREES_SIGMAS: f64 = 4.0;
/// Factor of a pose's standard deviations for errors of the landmarks, which its solution takes for exact.
const LANDMARK_SHARE: f64 = 1.5;
/// Least share of the observations that agree.
const MIN_SHARE: f64 = 0.6;
/// Landmarks are known if they were hosted this long ago, s, and seen since: what has just come into view may be a crowd.
const KNOWN_S: f64 = 0.2;
/// A sighted position is not better than this, m.
pub const LEAST_SIGHTING_M: f64 = 1e-3;

/// Where the images of a frame place it among the landmarks.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    /// Attitude: takes coordinates from `B` to `O`.
    pub rot_o_b: UnitQuaternion<f64>,
    /// Position of `B` in `O`, m.
    pub p_o_b: Vector3<f64>,
    /// Covariance of the position in `O`, m², by how well the landmarks fit.
    pub position_covariance: Matrix3<f64>,
    /// Covariance of the attitude in `B`, rad².
    pub rotation_covariance: Matrix3<f64>,
    /// True if it rests on known landmarks alone: then it is evidence against other sensors.
    pub is_witness: bool,
    /// Share of the observations that agree with it.
    pub agreeing_share: f64,
}

/// Variance along `direction`, which need not be of unit length; the trace where it is zero.
pub fn variance_along(covariance: &Matrix3<f64>, direction: &Vector3<f64>) -> f64 {
    let squared = direction.norm_squared();
    if squared > 0.0 { direction.dot(&(covariance * direction)) / squared } else { covariance.trace() }
}

/// Landmarks in the newest frame, by which of two poses of it explain where they are seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Votes {
    /// Explained by the predicted pose alone.
    pub predicted: usize,
    /// Explained by the sighted pose alone.
    pub sighted: usize,
    /// Explained by both.
    pub both: usize,
    /// Looked at.
    pub all: usize,
}

/// One landmark, and where a camera of the newest frame sees it.
#[derive(Clone, Copy, Debug)]
struct Ray {
    /// The landmark in `O`, scaled by its inverse depth.
    q_o: Vector3<f64>,
    rho: f64,
    camera: usize,
    xy: Vector2<f64>,
    /// Rows of the square root of the information.
    weight: [Vector2<f64>; 2],
}

type Rays = heapless::Vec<Ray, MAX_RAYS>;

impl Window {
    /// The pose of the newest frame by its points, found from `start`; `None` where too few of them agree.
    pub fn sight_newest(&self, start: &NavState) -> Option<Sighting> {
        self.sight(start, false)
    }

    /// The pose of the newest frame by its known points alone, which is evidence against other sensors; `None` where too few of them agree.
    pub fn sight_by_known(&self, start: &NavState) -> Option<Sighting> {
        self.sight(start, true)
    }

    fn sight(&self, start: &NavState, of_known: bool) -> Option<Sighting> {
        let mounts = [Mount::of(&self.rig, 0), Mount::of(&self.rig, 1)];
        let rays = self.rays(&mounts, of_known);
        if rays.len() < MIN_WITNESSES {
            return None;
        }
        let start = (start.rot_o_b, start.p_o_b);
        let found = solve(&rays, &mounts, start, &NARROW).or_else(|| solve(&rays, &mounts, start, &WIDE))?;
        Some(Sighting { is_witness: of_known, ..found })
    }

    /// Counts which of the landmarks that `sighted` rests on the poses `predicted` and `sighted` of the newest frame explain.
    pub fn votes(&self, predicted: &NavState, sighted: &Sighting) -> Votes {
        let mounts = [Mount::of(&self.rig, 0), Mount::of(&self.rig, 1)];
        let gate = InversePoint::outlier_sigmas(&self.options);
        let fits = |ray: &Ray, pose: (&UnitQuaternion<f64>, &Vector3<f64>)| {
            residual(ray, &mounts, pose).is_some_and(|(r, _, _)| r.norm_squared() < gate * gate)
        };
        let mut votes = Votes::default();
        for ray in &self.rays(&mounts, sighted.is_witness) {
            let by_prediction = fits(ray, (&predicted.rot_o_b, &predicted.p_o_b));
            let by_sighting = fits(ray, (&sighted.rot_o_b, &sighted.p_o_b));
            votes.predicted += usize::from(by_prediction && !by_sighting);
            votes.sighted += usize::from(by_sighting && !by_prediction);
            votes.both += usize::from(by_sighting && by_prediction);
            votes.all += 1;
        }
        votes
    }

    /// Puts the newest frame where its images place it, at the velocity of the frame before.
    pub fn place_newest(&mut self, sighting: &Sighting) {
        if let [.., before, newest] = &mut self.frames[..] {
            (newest.nav.rot_o_b, newest.nav.p_o_b) = (sighting.rot_o_b, sighting.p_o_b);
            newest.nav.v_o_b = before.nav.v_o_b;
        }
    }

    /// Puts the newest frame at `nav`.
    pub fn place_newest_at(&mut self, nav: NavState) {
        if let Some(newest) = self.frames.last_mut() {
            newest.nav = nav;
        }
    }

    /// Gives the motion that leads to frame `index` another integration.
    pub fn replace_motion(&mut self, index: usize, motion: Preintegration) {
        let Self { frames, imu_noise, .. } = self;
        let inertial = &mut frames[index].inertial;
        *inertial = Some(match inertial {
            Some(before) => before.integrated_anew(motion, imu_noise),
            None => InertialFactor::new(motion, imu_noise),
        });
    }

    /// Observations of landmarks with a depth by the newest frame, one of each, evenly chosen among them, or among the known ones.
    fn rays(&self, mounts: &[Mount; 2], of_known: bool) -> Rays {
        let mut rays = Rays::new();
        let Some(newest) = self.frames.len().checked_sub(1) else { return rays };
        let is_seen = |l: &&PointLandmark| {
            let last = l.observations.last();
            l.is_triangulated
                && usize::from(l.host) != newest
                && last.is_some_and(|o| usize::from(o.frame) == newest)
                && (!of_known || self.is_known(l))
        };
        let seen = || self.points.all().iter().filter(is_seen);
        let stride = seen().count().div_ceil(MAX_RAYS).max(1);
        for landmark in seen().step_by(stride) {
            let mut observations = landmark.observations.iter();
            let Some(observation) = observations.find(|o| usize::from(o.frame) == newest) else { continue };
            let host = &self.frames[usize::from(landmark.host)].nav;
            let mount = &mounts[usize::from(landmark.host_camera)];
            let point = &landmark.feature;
            let q_b = mount.rot_b_c * Vector3::new(point.xy.x, point.xy.y, 1.0) + mount.p_b_c * point.rho;
            let weight = &observation.measured.weight;
            let _ = rays.push(Ray {
                q_o: host.rot_o_b * q_b + host.p_o_b * point.rho,
                rho: point.rho,
                camera: usize::from(observation.camera),
                xy: observation.measured.xy,
                weight: [0, 1].map(|row| Vector2::new(weight[(row, 0)], weight[(row, 1)])),
            });
        }
        rays
    }

    /// True if a landmark was hosted long enough ago, and seen between then and the newest frame.
    fn is_known(&self, landmark: &PointLandmark) -> bool {
        let Some(newest) = self.frames.last() else { return false };
        let (host, last) = (usize::from(landmark.host), self.frames.len() - 1);
        let was_seen = |frame: u8| usize::from(frame) != host && usize::from(frame) != last;
        newest.stamp.seconds_since(self.frames[host].stamp) > KNOWN_S
            && landmark.observations.iter().rev().any(|o| was_seen(o.frame))
    }
}

/// Solves for the pose from `start`, with a kernel of each of `scales` in turn; `None` where too few rays agree.
fn solve(
    rays: &Rays,
    mounts: &[Mount; 2],
    (mut rot, mut p): (UnitQuaternion<f64>, Vector3<f64>),
    scales: &[f64],
) -> Option<Sighting> {
    let mut hessian = Matrix6::zeros();
    for scale in scales {
        let (of_step, gradient) = normal_equations(rays, mounts, (&rot, &p), *scale);
        let step = of_step.cholesky()?.solve(&-gradient);
        hessian = of_step;
        p += rot * step.fixed_rows::<3>(0);
        rot = UnitQuaternion::new_normalize((rot * exp_so3(&step.fixed_rows::<3>(3).into())).into_inner());
    }
    let (mut agreeing, mut squares) = (0, 0.0);
    for ray in rays {
        let seen = residual(ray, mounts, (&rot, &p)).map(|(r, _, _)| r.norm_squared());
        if let Some(squared) = seen.filter(|squared| *squared < AGREES_SIGMAS.squared()) {
            agreeing += 1;
            squares += squared;
        }
    }
    if agreeing < MIN_WITNESSES || (agreeing as f64) < MIN_SHARE * rays.len() as f64 {
        return None;
    }
    let covariance = hessian.cholesky()?.inverse();
    let fit = (squares / (2 * agreeing - POSE_DIM) as f64).sqrt();
    let scale = (LANDMARK_SHARE * fit).at_most(1.0);
    let block = |from: usize| covariance.fixed_view::<3, 3>(from, from) * scale.squared();
    let to_o = rot.to_rotation_matrix();
    Some(Sighting {
        rot_o_b: rot,
        p_o_b: p,
        position_covariance: to_o * block(0) * to_o.transpose(),
        rotation_covariance: block(3),
        is_witness: false,
        agreeing_share: agreeing as f64 / rays.len() as f64,
    })
}

/// Residual of a ray, its derivatives by the point in the body, and that point.
type Residual = (Vector2<f64>, [Vector3<f64>; 2], Vector3<f64>);

/// Residual of a ray from a pose, in standard deviations, its derivatives by the point in the body, and that point; `None`
/// where the landmark is not in front of the camera.
fn residual(
    ray: &Ray,
    mounts: &[Mount; 2],
    (rot, p): (&UnitQuaternion<f64>, &Vector3<f64>),
) -> Option<Residual> {
    let mount = &mounts[ray.camera];
    let q_b = rot.inverse_transform_vector(&(ray.q_o - p * ray.rho));
    let q_c = mount.rot_b_c.tr_mul(&(q_b - mount.p_b_c * ray.rho));
    if q_c.z < MIN_FORWARD {
        return None;
    }
    let seen = q_c.xy() / q_c.z;
    let off = seen - ray.xy;
    let r = Vector2::new(ray.weight[0].dot(&off), ray.weight[1].dot(&off));
    let by_point = ray.weight.map(|w| mount.rot_b_c * (Vector3::new(w.x, w.y, -w.dot(&seen)) / q_c.z));
    Some((r, by_point, q_b))
}

/// Hessian and gradient by position and attitude, both in the body, with a Cauchy kernel of `scale`.
fn normal_equations(
    rays: &Rays,
    mounts: &[Mount; 2],
    pose: (&UnitQuaternion<f64>, &Vector3<f64>),
    scale: f64,
) -> (Matrix6<f64>, Vector6<f64>) {
    let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    for ray in rays {
        let Some((r, by_point, q_b)) = residual(ray, mounts, pose) else { continue };
        let weight = 1.0 / (1.0 + r.norm_squared() / (scale * scale));
        for (residual, by_point) in [r.x, r.y].into_iter().zip(by_point) {
            let (by_p, by_rot) = (by_point * -ray.rho, by_point.cross(&q_b));
            let row = Vector6::new(by_p.x, by_p.y, by_p.z, by_rot.x, by_rot.y, by_rot.z);
            hessian += row * row.transpose() * weight;
            gradient += row * (residual * weight);
        }
    }
    (hessian, gradient)
}

#[cfg(test)]
#[path = "sighting_tests.rs"]
mod tests;
