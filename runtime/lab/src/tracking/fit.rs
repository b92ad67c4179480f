//! Fit of the window's landmarks in its newest frame, px.

use super::{Residuals, Spread};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use plumbline_config::ValidConfig;
use plumbline_config::options::CameraConfig;
use plumbline_estimator::window::Window;
use plumbline_estimator::window::landmark::PointLandmark;
use plumbline_flight::schedule::times::Times;

/// Ages that part young, grown and old landmarks, frames.
const AGES: [u64; 2] = [5, 20];
/// Share of the corner's distance from the optical axis at which the rim begins.
const RIM: f64 = 0.6;
/// Least depth of a landmark in front of a camera, over its inverse depth.
const MIN_FORWARD: f64 = 0.02;

/// Residuals of a flight, in fixed memory.
#[derive(Clone, Debug)]
pub(super) struct Fits {
    cameras: Vec<Optics>,
    /// Landmarks of the newest frame and the frame in which each was first seen, in order of their tracks.
    known: Vec<(u32, u64)>,
    before: Vec<(u32, u64)>,
    frames: u64,
    by_age: [Times; 3],
    by_place: [Times; 2],
    taken: u64,
    rejected: u64,
}

/// Scale of a camera, and where its rim begins.
#[derive(Clone, Copy, Debug)]
struct Optics {
    focal_px: Vector2<f64>,
    rim: f64,
}

impl Optics {
    fn of(camera: &CameraConfig) -> Self {
        let corner = camera.model().unproject(&Vector2::zeros());
        let focal_px = Vector2::from(camera.focal_px);
        let flat = || Vector2::from(camera.centre_px).component_div(&focal_px);
        Self { focal_px, rim: RIM * corner.unwrap_or_else(flat).norm() }
    }
}

impl Fits {
    /// Room for the window of a configuration.
    pub(super) fn new(config: &ValidConfig) -> Self {
        let room = || Vec::with_capacity(config.estimator.window.max_landmarks);
        Self {
            cameras: config.camera.iter().map(Optics::of).collect(),
            known: room(),
            before: room(),
            frames: 0,
            by_age: std::array::from_fn(|_| Times::of_ms()),
            by_place: std::array::from_fn(|_| Times::of_ms()),
            taken: 0,
            rejected: 0,
        }
    }

    /// Takes the newest frame of a window.
    pub(super) fn frame(&mut self, window: &Window) {
        let Some(newest) = window.frames.len().checked_sub(1) else { return };
        self.frames += 1;
        self.rejected += window.outliers().points.len() as u64;
        self.meet(window);
        let pose_b_o = window.frames[newest].nav.pose_o_b().inverse();
        let pose_c_o = [0, 1].map(|camera| window.rig.pose_b_c(camera).inverse() * pose_b_o);
        let placed = |l: &&PointLandmark| l.is_triangulated && usize::from(l.host) < newest;
        for landmark in window.points.all().iter().filter(placed) {
            for o in landmark.observations.iter().filter(|o| usize::from(o.frame) == newest) {
                let camera = usize::from(o.camera);
                let Some(seen) = predicted(window, landmark, &pose_c_o[camera]) else { continue };
                self.record(landmark.track_id, camera, &o.measured.xy, &seen);
            }
        }
    }

    /// Remembers in which frame each landmark was seen first.
    fn meet(&mut self, window: &Window) {
        std::mem::swap(&mut self.known, &mut self.before);
        self.known.clear();
        for landmark in window.points.all().iter().take(self.known.capacity()) {
            let id = landmark.track_id;
            let known = self.before.binary_search_by_key(&id, |known| known.0);
            self.known.push((id, known.map_or(self.frames, |at| self.before[at].1)));
        }
        self.known.sort_unstable();
    }

    fn record(&mut self, track_id: u32, camera: usize, measured: &Vector2<f64>, seen: &Vector2<f64>) {
        let Some(optics) = self.cameras.get(camera) else { return };
        let residual_px = (seen - measured).component_mul(&optics.focal_px).norm();
        let first = self.known.binary_search_by_key(&track_id, |known| known.0).map(|at| self.known[at].1);
        let age = self.frames - first.unwrap_or(self.frames);
        self.by_age[AGES.iter().filter(|limit| age >= **limit).count()].record(residual_px);
        self.by_place[usize::from(measured.norm() > optics.rim)].record(residual_px);
        self.taken += 1;
    }

    /// Residuals, and the share of observations that were rejected.
    pub(super) fn figures(&self) -> (Residuals, Option<f64>) {
        let [young, grown, old] = self.by_age.each_ref().map(Spread::of);
        let [centre, rim] = self.by_place.each_ref().map(Spread::of);
        let all = self.taken + self.rejected;
        let outliers = (all > 0).then(|| self.rejected as f64 / all as f64);
        (Residuals { young, grown, old, centre, rim }, outliers)
    }
}

/// Where a camera at `pose_c_o` sees a landmark, in normalized coordinates; `None` behind it.
fn predicted(window: &Window, landmark: &PointLandmark, pose_c_o: &Isometry3<f64>) -> Option<Vector2<f64>> {
    let host = &window.frames[usize::from(landmark.host)].nav;
    let pose_o_h = host.pose_o_b() * window.rig.pose_b_c(usize::from(landmark.host_camera));
    let (xy, rho) = (&landmark.feature.xy, landmark.feature.rho);
    // Scaled by the inverse depth, so that points at infinity are no exception.
    let pose_c_h = pose_c_o * pose_o_h;
    let ray = pose_c_h.rotation * Vector3::new(xy.x, xy.y, 1.0) + pose_c_h.translation.vector * rho;
    (ray.z > MIN_FORWARD).then(|| Point3::from(ray).xy().coords / ray.z)
}
