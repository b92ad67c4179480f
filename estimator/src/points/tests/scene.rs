//! A rendered world with a known truth: a textured plane, seen by a moving stereo rig without distortion.

use crate::image::synthetic::Texture;
use crate::points::{PointTracker, TrackerInput};
use crate::work_budget::InTurn;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::Random;
use plumbline_config::camera::Distortion;
use plumbline_config::options::PointsConfig;
use plumbline_config::{CameraModel, GrayImage};

pub(super) const WIDTH: usize = 320;
pub(super) const HEIGHT: usize = 240;
const FOCAL_PX: f64 = 260.0;
const BASELINE_M: f64 = 0.11;

/// The plane `z = depth + slope . (x, y)` in world coordinates; the first camera starts at the origin and
/// looks along z.
pub(super) struct Scene {
    texture: Texture,
    depth: f64,
    slope: Vector2<f64>,
    noise: f64,
}

impl Scene {
    pub(super) fn new(seed: u64, depth: f64) -> Self {
        Self { texture: Texture::new(seed), depth, slope: Vector2::new(0.3, -0.2), noise: 0.0 }
    }

    /// With noise of a standard deviation in grey levels.
    pub(super) fn with_noise(self, noise: f64) -> Self {
        Self { noise, ..self }
    }

    /// Intersection of a pixel's ray with the plane.
    pub(super) fn point(&self, pose_w_c: &Isometry3<f64>, px: &Vector2<f64>) -> Point3<f64> {
        let model = model();
        let xy = (px - model.centre_px).component_div(&model.focal_px);
        let (o, ray) = (pose_w_c.translation.vector, pose_w_c.rotation * Vector3::new(xy.x, xy.y, 1.0));
        let length = (self.depth + self.slope.dot(&o.xy()) - o.z) / (ray.z - self.slope.dot(&ray.xy()));
        Point3::from(o + ray * length)
    }

    /// An image with gain, offset and noise of its own.
    pub(super) fn render(&self, pose_w_c: &Isometry3<f64>, gain: f64, offset: f64, seed: u64) -> GrayImage {
        let mut random = Random::new(seed);
        let scale = FOCAL_PX / self.depth;
        self.texture.render_through(
            WIDTH,
            HEIGHT,
            |px| self.point(pose_w_c, &px).coords.xy() * scale,
            |grey| offset + gain * grey + if self.noise > 0.0 { self.noise * random.gaussian() } else { 0.0 },
        )
    }
}

pub(super) fn model() -> CameraModel {
    CameraModel {
        width_px: WIDTH,
        height_px: HEIGHT,
        focal_px: Vector2::new(FOCAL_PX, FOCAL_PX + 1.0),
        centre_px: Vector2::new(158.3, 121.2),
        distortion: Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
    }
}

/// Mounting of the cameras: turned against the body, and slightly against each other.
pub(super) fn extrinsics() -> [Isometry3<f64>; 2] {
    let left = Isometry3::from_parts(
        Translation3::new(0.02, -0.01, 0.03),
        UnitQuaternion::from_euler_angles(0.1, -0.2, 1.5),
    );
    let between = Isometry3::from_parts(
        Translation3::new(BASELINE_M, 0.0007, -0.001),
        UnitQuaternion::from_euler_angles(0.004, 0.01, -0.006),
    );
    [left, left * between]
}

/// A tracker on its way through a scene.
pub(super) struct Flight {
    pub scene: Scene,
    pub tracker: PointTracker,
    cameras: usize,
    pub frame: u64,
    pub(super) last_pose_w_b: Isometry3<f64>,
}

/// Conditions of a frame of a flight.
#[derive(Clone, Copy)]
pub(super) struct Shot {
    pub pose_w_b: Isometry3<f64>,
    /// Images that arrive.
    pub arrives: [bool; 2],
    pub gain: f64,
    pub offset: f64,
}

impl Flight {
    pub(super) fn new(scene: Scene, cameras: usize) -> Self {
        let options = PointsConfig { max_points: 60, cell_px: 32, ..PointsConfig::default() };
        let mut tracker = PointTracker::new(&options, &[model(), model()][..cameras]);
        tracker.set_extrinsics(&extrinsics());
        Self { scene, tracker, cameras, frame: 0, last_pose_w_b: start() }
    }

    /// Shows the tracker a frame.
    pub(super) fn shoot(&mut self, shot: &Shot) -> Vec<crate::points::PointObservation> {
        self.frame += 1;
        let image = |c: usize| {
            (c < self.cameras && shot.arrives[c]).then(|| {
                let seed = self.frame * 2 + c as u64;
                self.scene.render(&(shot.pose_w_b * extrinsics()[c]), shot.gain, shot.offset, seed)
            })
        };
        let images = [image(0), image(1)];
        let rot_prev_cur = self.last_pose_w_b.rotation.inverse() * shot.pose_w_b.rotation;
        self.last_pose_w_b = shot.pose_w_b;
        let input =
            TrackerInput { images: images.each_ref().map(|i| i.as_ref().map(GrayImage::view)), rot_prev_cur };
        self.tracker.track(&input, &InTurn, &mut ()).to_vec()
    }
}

/// Pose of the body when the left camera is at the origin of the world.
pub(super) fn start() -> Isometry3<f64> {
    extrinsics()[0].inverse()
}

/// A swaying path: up to 0.15 m and 6 degrees about the start, at 2 m distance some 3 px per frame.
pub(super) fn sway(frame: u64) -> Shot {
    let t = frame as f64 * 0.05;
    let turn = UnitQuaternion::from_euler_angles(
        0.05 * (2.1 * t).sin(),
        0.06 * (1.7 * t).sin(),
        0.1 * (1.3 * t).sin(),
    );
    let step = Translation3::new(0.15 * (1.1 * t).sin(), 0.1 * (1.9 * t).sin(), 0.1 * (0.9 * t).sin());
    let pose_w_c = Isometry3::from_parts(step, turn);
    Shot { pose_w_b: pose_w_c * start(), arrives: [true; 2], gain: 1.0, offset: 0.0 }
}
