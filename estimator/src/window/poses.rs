//! Poses of bodies and cameras as matrices, at the present states and at those of the Jacobians, and what follows
//! from them for the landmarks.

use super::camera_poses::{CameraMotion, CameraPose, CameraView};
use super::camera_sums::LensRows;
use super::feature::Feature;
use super::frame::Frame;
use super::landmark::{Landmark, Observation};
use super::motions::Lifts;
use super::options::Options;
use super::problem::Problem;
use super::state::{BodyPose, MAX_FRAMES, Mount, Rig};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Poses and extrinsics of the window, refreshed whenever its states have changed.
#[derive(Clone, Debug)]
pub struct Poses {
    first: Vec<BodyPose>,
    mounts: [Mount; 2],
    /// Position in `O` that those of the cameras are relative to, m.
    pivot_o: Vector3<f64>,
    cameras_now: Vec<[CameraPose; 2]>,
    cameras_first: Vec<[CameraPose; 2]>,
}

impl Poses {
    /// Room for any window with this rig.
    pub fn new(rig: &Rig) -> Self {
        let body = BodyPose { rot_o_b: Matrix3::identity(), p_o_b: Vector3::zeros() };
        let mounts = [Mount::of(rig, 0), Mount::of(rig, 1)];
        let cameras = [0, 1].map(|k| CameraPose::of(&body, &mounts[k], &Vector3::zeros()));
        Self {
            first: vec![body; MAX_FRAMES],
            mounts,
            pivot_o: Vector3::zeros(),
            cameras_now: vec![cameras.clone(); MAX_FRAMES],
            cameras_first: vec![cameras; MAX_FRAMES],
        }
    }

    /// Takes over the states of rig and frames; Jacobians are taken at first estimates or at the present states.
    pub fn refresh(&mut self, rig: &Rig, frames: &[Frame], first_estimates: bool) {
        self.mounts = [Mount::of(rig, 0), Mount::of(rig, 1)];
        self.pivot_o = frames.last().map_or_else(Vector3::zeros, |frame| frame.nav.p_o_b);
        let Self { first, mounts, pivot_o, cameras_now, cameras_first } = self;
        let of = |body: &BodyPose| [0, 1].map(|k| CameraPose::of(body, &mounts[k], pivot_o));
        for (k, frame) in frames.iter().enumerate() {
            first[k] = BodyPose::of(frame.jacobian_state(first_estimates));
            cameras_now[k] = of(&BodyPose::of(&frame.nav));
            cameras_first[k] = of(&first[k]);
        }
    }

    /// Derivatives of the motions of the first `frames` frames and of the cameras by frames and rig, at the states of the
    /// Jacobians.
    pub fn lift(&self, lifts: &mut Lifts, frames: usize, options: &Options) {
        let mounts = &self.mounts[..options.cameras];
        lifts.refresh(&self.first[..frames], mounts, &self.pivot_o, &options.rig_mask);
    }

    /// Where a landmark is by the present pose of its host.
    #[inline]
    pub fn placed<F: Feature>(&self, landmark: &Landmark<F>) -> F::Placed {
        let (host, camera) = (usize::from(landmark.host), usize::from(landmark.host_camera));
        landmark.feature.placed(&self.cameras_now[host][camera])
    }

    /// Where it is by the pose of its host at which Jacobians are taken.
    #[inline]
    pub fn placed_first<F: Feature>(&self, landmark: &Landmark<F>) -> F::Placed {
        let (host, camera) = (usize::from(landmark.host), usize::from(landmark.host_camera));
        landmark.feature.placed(&self.cameras_first[host][camera])
    }

    /// The residual of one observation of a landmark that is [`Self::placed`], in standard deviations, where this was `measured` by the
    /// present intrinsics. `None` where the observer cannot see it.
    #[inline]
    pub fn residual<F: Feature>(
        &self,
        problem: &Problem<'_>,
        placed: &F::Placed,
        (observation, measured): (&Observation<F::Measurement>, &F::Measurement),
    ) -> Option<Vector2<f64>> {
        let (frame, camera) = (usize::from(observation.frame), usize::from(observation.camera));
        let step_s = problem.rig.time_offset_s - problem.frames[frame].time_offset_s;
        F::residual_of(placed, &self.cameras_now[frame][camera], measured, step_s)
    }

    /// The derivatives of an observation by the intrinsics of its camera, times `scale`, of a landmark that is
    /// [`Self::placed_first`]; `None` where intrinsics are held fixed.
    #[inline]
    pub fn by_lens<F: Feature>(
        &self,
        problem: &Problem<'_>,
        placed: &F::Placed,
        (observation, scale): (&Observation<F::Measurement>, f64),
    ) -> Option<LensRows> {
        let lenses = problem.options.lenses.as_ref()?;
        let (frame, camera) = (usize::from(observation.frame), usize::from(observation.camera));
        let target = &self.cameras_first[frame][camera];
        let by_lens = lenses.derivatives::<F>(camera, placed, target, &observation.measured)?;
        Some(by_lens.map(|row| row.map(|x| x * scale)))
    }

    /// The Jacobians of an observation of a landmark that is [`Self::placed_first`], by what was `measured`.
    #[inline]
    pub fn linearize<F: Feature>(
        &self,
        landmark: &Landmark<F>,
        placed: &F::Placed,
        (observation, measured): (&Observation<F::Measurement>, &F::Measurement),
        jacobians: &mut F::Jacobians,
    ) -> Option<()> {
        F::linearize(placed, view(&self.cameras_first, landmark, observation), measured, jacobians)
    }

    /// Predicts how fast the observations of frame `index` move through the image, from the frame's velocity and angular
    /// rate. These image rates are what the time offset is estimated by; taken as differences between images, they would
    /// carry the noise of the images into it.
    pub fn predict_rates<F: Feature>(
        &mut self,
        rig: &Rig,
        frames: &[Frame],
        landmarks: &mut [Landmark<F>],
        index: usize,
    ) {
        self.refresh(rig, frames, false);
        let rate_b = frames[index].rate_b();
        let v_b = frames[index].nav.rot_o_b.inverse() * frames[index].nav.v_o_b;
        let motions = self.mounts.each_ref().map(|mount| CameraMotion::of(mount, &rate_b, &v_b));
        for landmark in landmarks.iter_mut().filter(|l| l.is_triangulated) {
            for k in (0..landmark.observations.len()).rev() {
                let observation = landmark.observations[k];
                match usize::from(observation.frame) {
                    frame if frame > index => continue,
                    frame if frame < index => break,
                    _ => {}
                }
                let view = view(&self.cameras_now, landmark, &observation);
                let motion = &motions[usize::from(observation.camera)];
                if let Some(m) = landmark.feature.with_rate(view, &observation.measured, motion) {
                    landmark.observations[k].measured = m;
                }
            }
        }
    }

    /// Gives the landmarks of frame `from` that the newest frame still sees their earliest other keyframe as host;
    /// what frame `from` saw of them is forgotten. A landmark without another view keeps its host.
    pub fn rehost<F: Feature>(
        &mut self,
        rig: &Rig,
        frames: &[Frame],
        landmarks: &mut [Landmark<F>],
        from: usize,
    ) {
        let newest = frames.len().saturating_sub(1);
        self.refresh(rig, frames, false);
        for landmark in landmarks.iter_mut().filter(|l| usize::from(l.host) == from && l.is_triangulated) {
            let mut views = landmark.observations.iter().filter(|o| usize::from(o.frame) != from);
            if !views.clone().any(|o| usize::from(o.frame) == newest) {
                continue;
            }
            let Some(heir) = views.find(|o| frames[usize::from(o.frame)].is_keyframe).copied() else {
                continue;
            };
            let Some(feature) = landmark.feature.hosted_by_target(view(&self.cameras_now, landmark, &heir))
            else {
                continue;
            };
            landmark.feature = feature;
            landmark.host = heir.frame;
            landmark.host_camera = heir.camera;
            landmark.observations.retain(|o| usize::from(o.frame) != from);
        }
    }
}

/// The cameras that host a landmark and make an observation of it.
#[inline]
fn view<'a, F: Feature>(
    cameras: &'a [[CameraPose; 2]],
    landmark: &Landmark<F>,
    observation: &Observation<F::Measurement>,
) -> CameraView<'a> {
    let pose = |frame: u8, camera: u8| &cameras[usize::from(frame)][usize::from(camera)];
    CameraView {
        host: pose(landmark.host, landmark.host_camera),
        target: pose(observation.frame, observation.camera),
    }
}
