//! Motion of the left camera from one image to the next: points with depth from the pair, followed by flow,
//! and the pose that explains them.
//!
//! Minimized over `R, t`: `sum rho(|pi(R p + t) - xy'|)` with the points `p` in the first camera, their normalized
//! coordinates `xy'` in the second image, and the Cauchy kernel; Gauss-Newton with perturbations on the left.

use crate::agreement::Turn;
use crate::pair::PairMatch;
use nalgebra::{Isometry3, Matrix2, Matrix2x3, Matrix6, Vector2, Vector3, Vector6};
use plumbline_config::{Config, Timestamp};
use plumbline_estimator::geometry::{exp_so3, skew};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::points::flow::{FlowOptions, track_patch};
use plumbline_estimator::points::rig::RigCamera;

/// Images further apart than this are no neighbours, s.
const MAX_GAP_S: f64 = 0.25;
/// Points with depth, and of these such that agree, that a pose needs.
const MIN_POINTS: usize = 12;
/// Share of points that agree.
const MIN_AGREEING: f64 = 0.6;
/// Depths that are used, 1/m.
const INVERSE_DEPTHS: std::ops::Range<f64> = 0.01..3.0;
/// Largest epipolar error of a point that is used, px: a calibration that is off still has a motion.
const MAX_EPIPOLAR_PX: f64 = 12.0;
/// Scale of the kernel, px, and the error up to which a point agrees.
const KERNEL_PX: f64 = 0.7;
const AGREES_PX: f64 = 2.0;
const STEPS: usize = 12;
const FLOW: FlowOptions = FlowOptions { top_level: 3, max_iterations: 10 };
const MIN_ZNCC: f32 = 0.8;
const MAX_LAST_STEP_PX: f32 = 0.1;
const MAX_RETURN_PX: f32 = 0.5;

/// A point with depth, and where the next image has it (normalized coordinates).
type Followed = (Vector3<f64>, Vector2<f64>);

/// Finds how the left camera moved.
pub struct MotionFinder {
    camera: RigCamera,
    /// The image before, and what was matched in it.
    last: Option<(Timestamp, Pyramid, Vec<PairMatch>)>,
}

impl MotionFinder {
    /// Creates the finder for a rig with two cameras; `None` for one camera.
    #[must_use]
    pub fn new(config: &Config) -> Option<Self> {
        let [left, _] = config.camera.as_slice() else { return None };
        Some(Self { camera: RigCamera::new(left.model()), last: None })
    }

    /// Takes the next left image with its matches, and says how the camera moved since the one before.
    pub fn next(&mut self, stamp: Timestamp, image: &Pyramid, matches: &[PairMatch]) -> Option<Turn> {
        let last = self.last.replace((stamp, image.clone(), matches.to_vec()));
        let (from, before, matches) = last?;
        let dt_s = stamp.seconds_since(from);
        if !(dt_s > 0.0 && dt_s < MAX_GAP_S) {
            return None;
        }
        let followed: Vec<Followed> =
            matches.iter().filter_map(|found| self.follow(&before, image, found)).collect();
        let pose_now_before = self.solve(&followed)?;
        // The camera turns the other way than what it sees.
        let turned = pose_now_before.rotation.inverse().scaled_axis();
        Some(Turn {
            from,
            to: stamp,
            rate_c: turned / dt_s,
            velocity_c: pose_now_before.inverse().translation.vector / dt_s,
        })
    }

    fn follow(&self, before: &Pyramid, now: &Pyramid, found: &PairMatch) -> Option<Followed> {
        let is_used =
            INVERSE_DEPTHS.contains(&found.inverse_depth) && found.epipolar_px.abs() < MAX_EPIPOLAR_PX;
        if !is_used {
            return None;
        }
        let flow = |from: &Pyramid, at: &Vector2<f32>, to: &Pyramid, guess: &Vector2<f32>| {
            let there = track_patch((from, at), (to, guess), &Matrix2::identity(), &FLOW)?;
            (there.zncc >= MIN_ZNCC && there.last_step_px < MAX_LAST_STEP_PX).then_some(there.px)
        };
        let px = flow(before, &found.px, now, &found.px)?;
        let back = flow(now, &px, before, &found.px)?;
        ((back - found.px).norm() <= MAX_RETURN_PX).then_some(())?;
        let p_c = Vector3::new(found.xy.x, found.xy.y, 1.0) / found.inverse_depth;
        Some((p_c, self.camera.model.unproject(&px.cast())?))
    }

    /// The pose that takes points of the first camera to the second.
    fn solve(&self, followed: &[Followed]) -> Option<Isometry3<f64>> {
        if followed.len() < MIN_POINTS {
            return None;
        }
        let focal_px = self.camera.focal_px();
        let mut pose = Isometry3::identity();
        // A wide kernel first: nothing is known of the motion.
        for step in 0..STEPS {
            let kernel_px = KERNEL_PX * f64::from(1_u32 << (4_usize.saturating_sub(step)));
            let (mut h, mut b) = (Matrix6::zeros(), Vector6::zeros());
            for (p, xy) in followed {
                let Some((residual, jacobian)) = reprojection(&pose, p, xy) else { continue };
                let weight = 1.0 / (1.0 + (residual * focal_px / kernel_px).norm_squared());
                h += jacobian.transpose() * jacobian * weight;
                b += jacobian.transpose() * residual * weight;
            }
            let delta = h.cholesky()?.solve(&(-b));
            let turn = exp_so3(&delta.fixed_rows::<3>(0).into_owned());
            pose = Isometry3::from_parts(delta.fixed_rows::<3>(3).into_owned().into(), turn) * pose;
        }
        let agrees = |(p, xy): &&Followed| {
            reprojection(&pose, p, xy).is_some_and(|(r, _)| r.norm() * focal_px < AGREES_PX)
        };
        let agreeing = followed.iter().filter(agrees).count();
        let is_sound = agreeing >= MIN_POINTS && agreeing as f64 >= MIN_AGREEING * followed.len() as f64;
        is_sound.then_some(pose)
    }
}

/// `pi(R p + t) - xy` and its derivative by a rotation and a translation on the left of the pose.
fn reprojection(
    pose: &Isometry3<f64>,
    p: &Vector3<f64>,
    xy: &Vector2<f64>,
) -> Option<(Vector2<f64>, nalgebra::Matrix2x6<f64>)> {
    let q = pose * nalgebra::Point3::from(*p);
    if q.z < 0.05 {
        return None;
    }
    let seen = Vector2::new(q.x / q.z, q.y / q.z);
    let by_q = Matrix2x3::new(1.0, 0.0, -seen.x, 0.0, 1.0, -seen.y) / q.z;
    let mut jacobian = nalgebra::Matrix2x6::zeros();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&(-by_q * skew(&q.coords)));
    jacobian.fixed_columns_mut::<3>(3).copy_from(&by_q);
    Some((seen - xy, jacobian))
}
