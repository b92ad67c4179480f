//! Inverse depth of a landmark from two or more views, and the change of its host.

use super::camera_poses::{CameraPose, CameraView};
use super::feature::Feature;
use super::frame::Frame;
use super::landmark::{Landmark, Observation, PointLandmark};
use super::options::Options;
use super::reprojection::InversePoint;
use super::state::{BodyPose, Mount};
use nalgebra::{Matrix3, Vector3};

/// Where a triangulated landmark must be found again in its observations, in standard deviations.
const MAX_RESIDUAL_SIGMAS: f64 = 8.0;

/// Smallest forward component of the host's bearing `(x, y, 1)` turned into a view. Below it the bearing lies more
/// than 84 degrees from the optical axis, where no camera here sees anything, and dividing by it scales up noise.
const MIN_FORWARD: f64 = 0.1;
/// A point of negative inverse depth is noise of a far one within this many standard deviations, and beyond them
/// (less than 1 in 700 by chance) a wrong track.
const MAX_BEHIND_SIGMAS: f64 = 3.0;

/// Depth known to a sixth of itself: within that, the reprojection is nearly linear in the inverse depth, and the
/// prior's Jacobians may stay at this first estimate.
const MIN_PARALLAX_SIGMAS: f64 = 6.0;
/// Inverse depth known to 1/50 m, parallax or not: a point beyond 50 m has no depth, but a bearing as good as any.
const MAX_SIGMA_RHO: f64 = 0.02;

/// Outcome of an attempt at triangulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Triangulation {
    /// It has one now.
    Done,
    /// The views are too close together; more may come.
    Waiting,
    /// Its views contradict each other: it is no point of the scene.
    Contradiction,
}

/// State held fixed while a landmark is triangulated.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Frames in order of time.
    pub frames: &'a [Frame],
    /// Extrinsics of both cameras.
    pub mounts: &'a [Mount; 2],
    /// The rig's time offset, s.
    pub time_offset_s: f64,
}

impl Scene<'_> {
    /// Hands the view of an observation and its `td - td_frame` to `use_it`.
    pub(super) fn with_view<F: Feature, T>(
        &self,
        landmark: &Landmark<F>,
        o: &Observation<F::Measurement>,
        use_it: impl FnOnce(CameraView<'_>, f64) -> T,
    ) -> T {
        let target = &self.frames[usize::from(o.frame)];
        let pose = |frame: u8, camera: u8| {
            let body = BodyPose::of(&self.frames[usize::from(frame)].nav);
            CameraPose::of(&body, &self.mounts[usize::from(camera)], &target.nav.p_o_b)
        };
        let view =
            CameraView { host: &pose(landmark.host, landmark.host_camera), target: &pose(o.frame, o.camera) };
        use_it(view, self.time_offset_s - target.time_offset_s)
    }
}

/// Pose of a camera in the odometry frame as a matrix and a vector.
pub(super) fn camera_pose(frame: &Frame, mount: &Mount) -> (Matrix3<f64>, Vector3<f64>) {
    let rot = frame.nav.rot_o_b.to_rotation_matrix().into_inner();
    (rot * mount.rot_b_c, rot * mount.p_b_c + frame.nav.p_o_b)
}

/// Finds the inverse depth along the host's bearing by linear least squares over all other views: in
/// view `k` the landmark lies along `R_k b + rho t_k`, and both components across the measured bearing
/// vanish. Needs a parallax of [`MIN_PARALLAX_SIGMAS`] standard deviations. While poses are only
/// guessed (`is_start`), views may contradict.
pub fn triangulate(
    landmark: &mut PointLandmark,
    scene: &Scene<'_>,
    options: &Options,
    is_start: bool,
) -> Triangulation {
    let Scene { frames, mounts, .. } = *scene;
    let host = usize::from(landmark.host);
    let host_camera = usize::from(landmark.host_camera);
    let Some(at_host) =
        landmark.observations.iter().find(|o| o.frame == landmark.host && o.camera == landmark.host_camera)
    else {
        return Triangulation::Contradiction;
    };
    let xy = at_host.measured.xy;
    let bearing = Vector3::new(xy.x, xy.y, 1.0);
    let (rot_host, p_host) = camera_pose(&frames[host], &mounts[host_camera]);
    let (mut num, mut den) = (0.0, 0.0);
    for o in &landmark.observations {
        if o.frame == landmark.host && o.camera == landmark.host_camera {
            continue;
        }
        let (rot, p) = camera_pose(&frames[usize::from(o.frame)], &mounts[usize::from(o.camera)]);
        let a = rot.tr_mul(&(rot_host * bearing));
        let t = rot.tr_mul(&(p_host - p));
        if a.z < MIN_FORWARD {
            continue;
        }
        let z = o.measured.xy;
        let constant = o.measured.weight * (a.xy() - z * a.z) / a.z;
        let slope = o.measured.weight * (t.xy() - z * t.z) / a.z;
        num -= constant.dot(&slope);
        den += slope.norm_squared();
    }
    if den <= 0.0 {
        return Triangulation::Waiting;
    }
    let sigma_rho = den.sqrt().recip();
    let rho = num / den;
    let is_wide = sigma_rho * MIN_PARALLAX_SIGMAS < rho || sigma_rho < MAX_SIGMA_RHO;
    if !is_wide {
        return Triangulation::Waiting;
    }
    if !is_start && (rho > options.max_rho || rho < -MAX_BEHIND_SIGMAS * sigma_rho) {
        return Triangulation::Contradiction;
    }
    landmark.feature = InversePoint { xy, rho: rho.clamp(options.min_rho, options.max_rho) };
    let fits = is_start || consistent(landmark, scene);
    landmark.is_triangulated = fits;
    if fits { Triangulation::Done } else { Triangulation::Contradiction }
}

/// True if every observation of the landmark agrees with its present parameters.
pub(super) fn consistent<F: Feature>(landmark: &Landmark<F>, scene: &Scene<'_>) -> bool {
    landmark.observations.iter().all(|o| {
        scene.with_view(landmark, o, |view, step_s| {
            let r = landmark.feature.residual(view, &o.measured, step_s, None);
            r.is_some_and(|r| r.norm() < MAX_RESIDUAL_SIGMAS)
        })
    })
}

/// Returns the track hosted by frame `heir`, with its observations from there on; it must be triangulated again. `None`
/// if `heir` has not observed it, or no frame has since.
pub fn moved_to<F: Feature>(landmark: &Landmark<F>, heir: usize) -> Option<Landmark<F>> {
    let heir = u8::try_from(heir).ok()?;
    let seen = landmark.observations.iter().find(|o| o.frame == heir)?;
    let mut moved = Landmark {
        track_id: landmark.track_id,
        host: heir,
        host_camera: seen.camera,
        is_triangulated: false,
        feature: landmark.feature,
        observations: heapless::Vec::new(),
    };
    for observation in landmark.observations.iter().filter(|o| o.frame >= heir) {
        moved.observations.push(*observation).ok()?;
    }
    Some(moved)
}

#[cfg(test)]
#[path = "triangulate_tests.rs"]
mod tests;
