//! The gyroscope's bias from images alone, before anything else is known.
//!
//! Two views of a point and the translation between them lie in one plane, so with the right rotation the
//! normals `n = f_i x R f_j` of all points are orthogonal to one direction: the smallest eigenvalue of
//! `sum n n'` vanishes. The rotation comes from the gyroscope; its bias is what makes the sum of these
//! eigenvalues over many pairs smallest. Source: Kneip and Lynen, "Direct Optimization of Frame-to-Frame
//! Rotation" (2013); He et al., "Rotation-Translation-Decoupled Initialization" (2023), section IV.

use super::{GatheredFrame, find_track};
use crate::geometry::{exp_so3, right_jacobian, skew};
use nalgebra::{Matrix2, Matrix3, Matrix3x2, SymmetricEigen, Vector2, Vector3};
use std::ops::Range;

/// Gauss-Newton steps; a few suffice, the rest is for a bad start.
const STEPS: usize = 15;
/// A step this small ends the iteration, rad/s.
const SMALL_STEP_RAD_S: f64 = 1e-6;
/// Pairs are this long, s: long enough for parallax, short enough for many common points.
const PAIR_SPAN_S: f64 = 0.25;
/// Scale of the Cauchy kernel, in standard deviations of a bearing.
const ROBUST_SIGMAS: f64 = 3.0;
/// Fewest common points of a pair.
const MIN_POINTS: usize = 15;

/// A pair of frames, ready to be evaluated at many biases.
#[derive(Clone, Debug)]
struct Pair {
    rot_b: Matrix3<f64>,
    by_bias: Matrix3<f64>,
    /// Range of its bearings within [`BiasWorkspace::bearings`].
    bearings: Range<usize>,
}

/// A point's directions in the body frames of both frames of a pair.
type Bearings = (Vector3<f64>, Vector3<f64>);

/// The memory of an estimate, allocated once.
#[derive(Clone, Debug)]
pub struct BiasWorkspace {
    pairs: Vec<Pair>,
    bearings: Vec<Bearings>,
}

impl BiasWorkspace {
    /// Room for `frames` of `points` each.
    #[must_use]
    pub fn new(frames: usize, points: usize) -> Self {
        Self { pairs: Vec::with_capacity(frames), bearings: Vec::with_capacity(frames * points) }
    }
}

/// The gyroscope bias, rad/s, that makes the epipolar geometry of `frames` agree best, pulled towards
/// what was `known` before by the standard deviation of that, rad/s; `None` without enough common points. `rot_b_c` takes directions
/// from each camera to the body; `sigma_bearing` is the standard deviation of a bearing, rad.
#[must_use]
pub fn estimate(
    frames: &[GatheredFrame],
    rot_b_c: &[Matrix3<f64>; 2],
    (known, sigma_rad_s): (&Vector3<f64>, f64),
    sigma_bearing: f64,
    workspace: &mut BiasWorkspace,
) -> Option<Vector3<f64>> {
    workspace.find_pairs(frames, rot_b_c);
    if workspace.pairs.is_empty() {
        return None;
    }
    let mut bias = *known;
    for _ in 0..STEPS {
        let mut hessian = Matrix3::identity() / (sigma_rad_s * sigma_rad_s);
        let mut gradient = (bias - known) / (sigma_rad_s * sigma_rad_s);
        for pair in &workspace.pairs {
            let bearings = &workspace.bearings[pair.bearings.clone()];
            let (h, g) = pair.linearize(bearings, &bias, sigma_bearing);
            hessian += h;
            gradient += g;
        }
        let step = -(hessian.cholesky()?.solve(&gradient));
        bias += step;
        if step.norm() < SMALL_STEP_RAD_S {
            break;
        }
    }
    bias.iter().all(|x| x.is_finite()).then_some(bias)
}

impl Pair {
    /// Normal equations of the residuals `t' [f_i]x R f_j` by the bias, with the direction of translation
    /// `t` (the eigenvector of the smallest eigenvalue) eliminated.
    fn linearize(
        &self,
        bearings: &[Bearings],
        bias: &Vector3<f64>,
        sigma_bearing: f64,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        let phi = self.by_bias * bias;
        let rot = self.rot_b * exp_so3(&phi).to_rotation_matrix().into_inner();
        let rot_by_bias = right_jacobian(&phi) * self.by_bias;
        let mut sum = Matrix3::zeros();
        for (f_i, f_j) in bearings {
            let n = f_i.cross(&(rot * f_j));
            sum += n * n.transpose();
        }
        let eigen = SymmetricEigen::new(sum);
        let smallest = eigen.eigenvalues.imin();
        let t = eigen.eigenvectors.column(smallest).into_owned();
        let across = [1, 2].map(|k| eigen.eigenvectors.column((smallest + k) % 3).into_owned());

        let (mut h_bb, mut g_b) = (Matrix3::zeros(), Vector3::zeros());
        let (mut h_bt, mut h_tt, mut g_t) = (Matrix3x2::zeros(), Matrix2::zeros(), Vector2::zeros());
        for (f_i, f_j) in bearings {
            let n = f_i.cross(&(rot * f_j));
            let e = t.dot(&n) / sigma_bearing;
            let weight = 1.0 / (1.0 + e * e / (ROBUST_SIGMAS * ROBUST_SIGMAS));
            let by_b =
                -(t.transpose() * skew(f_i) * rot * skew(f_j) * rot_by_bias).transpose() / sigma_bearing;
            let by_t = Vector2::new(across[0].dot(&n), across[1].dot(&n)) / sigma_bearing;
            h_bb += by_b * by_b.transpose() * weight;
            h_bt += by_b * by_t.transpose() * weight;
            h_tt += by_t * by_t.transpose() * weight;
            g_b += by_b * (e * weight);
            g_t += by_t * (e * weight);
        }
        match (h_tt + Matrix2::identity() * 1e-9).try_inverse() {
            Some(inverse) => (h_bb - h_bt * inverse * h_bt.transpose(), g_b - h_bt * (inverse * g_t)),
            None => (Matrix3::zeros(), Vector3::zeros()),
        }
    }
}

impl BiasWorkspace {
    /// Pairs every frame with the first that is [`PAIR_SPAN_S`] later.
    fn find_pairs(&mut self, frames: &[GatheredFrame], rot_b_c: &[Matrix3<f64>; 2]) {
        self.pairs.clear();
        self.bearings.clear();
        for (i, first) in frames.iter().enumerate() {
            let Some(j) = (i + 1..frames.len())
                .find(|&j| frames[j].time.stamp.seconds_since(first.time.stamp) >= PAIR_SPAN_S)
            else {
                continue;
            };
            let Some(motion) = joined_motion(frames, i, j) else { continue };
            let begin = self.bearings.len();
            self.bearings.extend(first.tracks.iter().filter_map(|t| {
                let other = find_track(&frames[j], t.track_id)?;
                (0..2).find_map(|c| {
                    let (a, b) = (t.measured[c]?, other.measured[c]?);
                    let unit = |xy: Vector2<f64>| rot_b_c[c] * Vector3::new(xy.x, xy.y, 1.0).normalize();
                    Some((unit(a.xy), unit(b.xy)))
                })
            }));
            let bearings = begin..self.bearings.len();
            if bearings.len() < MIN_POINTS {
                self.bearings.truncate(begin);
                continue;
            }
            self.pairs.push(Pair {
                rot_b: motion.delta_rot.to_rotation_matrix().into_inner(),
                by_bias: motion.by_bias.fixed_view::<3, 3>(3, 0).into_owned(),
                bearings,
            });
        }
    }
}

/// The motion from frame `from` to frame `to`; `None` where one between them is not known.
#[must_use]
pub fn joined_motion(
    frames: &[GatheredFrame],
    from: usize,
    to: usize,
) -> Option<crate::inertial::Preintegration> {
    let mut joined = frames.get(from + 1)?.motion.clone()?;
    for frame in &frames[from + 2..=to] {
        joined = joined.followed_by(frame.motion.as_ref()?);
    }
    Some(joined)
}
