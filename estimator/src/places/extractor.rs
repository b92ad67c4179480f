//! Features of a keyframe: corners on two levels of the pyramid, each with depth from the other camera.
//!
//! Gravity says how a patch is turned. Depth says how large it is in the image: its radius is that of a fixed length
//! in the world, so that a thing seen from near and from far gives the same bits.

use super::descriptor::{PatchFrame, Pattern};
use super::feature::Feature;
use crate::image::{Plane, Pyramid};
use crate::points::corners::{CornerDetector, Demand};
use crate::points::rig::{Baseline, RigCamera};
use crate::points::stereo::StereoPair;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Pyramid levels on which corners are sought.
const LEVELS: usize = 2;
/// Largest share of the features on the finer level: the coarser one keeps its share.
const FINE_SHARE: f32 = 0.75;
/// Half the window of the sub-pixel refinement, px of the level.
const SUBPIXEL_WINDOW: i32 = 4;
/// Steps of the sub-pixel refinement.
const SUBPIXEL_STEPS: usize = 4;
/// A corner that moves further than this in its refinement is none, px of the level.
const MAX_SUBPIXEL_MOVE: f32 = 6.0;
/// Limits of the flow that finds a corner in the other camera, as of the tracker.
const STEREO_ITERATIONS: usize = 10;
const MAX_RETURN_PX: f32 = 0.7;
const MAX_EPIPOLAR_PX: f64 = 1.5;
/// Shorter than this, the image of the vertical says nothing about how a patch is turned: the camera looks along it.
const MIN_VERTICAL: f32 = 0.25;
/// Side of the cells of which each gives at most one corner, px of the level.
const CELL_PX: usize = 22;
/// Corners keep this distance from the edge of the image, px of the level.
const BORDER_PX: usize = 8;
/// Least Shi-Tomasi score of a corner, as of the tracker.
const MIN_CORNER_SCORE: f32 = 12.0;
/// Radius of a patch in the world, m.
const PATCH_M: f32 = 0.16;
/// Limits of the radius in the image, px; the middle one is that of a corner of unknown depth.
const RADIUS_PX: [f32; 3] = [16.0, 24.0, 48.0];
/// Standard deviation of a corner's place on the finest level, px.
const SIGMA_PX: f32 = 1.0;
/// Standard deviation of the difference of its places in the two cameras, px.
const SIGMA_DISPARITY_PX: f32 = 0.35;

/// The images of one frame, and the cameras that took them.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// Left camera and image.
    pub left: (&'a RigCamera, &'a Pyramid),
    /// Right camera and image, where there is one.
    pub right: Option<(&'a RigCamera, &'a Pyramid)>,
    /// Direction of up in the left camera.
    pub up_c: Vector3<f64>,
}

/// Extracts features. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct Extractor {
    max_features: usize,
    pattern: Pattern,
    detectors: Vec<CornerDetector>,
    found: Vec<(Vector2<f32>, usize)>,
    features: Vec<Feature>,
}

impl Extractor {
    /// An extractor of at most `max_features` from images of a size.
    #[must_use]
    pub fn new(width_px: usize, height_px: usize, max_features: usize) -> Self {
        let detector = |level: usize| {
            let (width, height) = (width_px.div_ceil(1 << level), height_px.div_ceil(1 << level));
            CornerDetector::new(width, height, CELL_PX, BORDER_PX, MIN_CORNER_SCORE)
        };
        Self {
            max_features,
            pattern: Pattern::default(),
            detectors: (0..LEVELS).map(detector).collect(),
            found: Vec::with_capacity(max_features),
            features: Vec::with_capacity(max_features),
        }
    }

    /// The features of a frame, strongest corners of each level first.
    pub fn extract(&mut self, view: &View<'_>) -> &[Feature] {
        self.detect(view.left.1);
        self.features.clear();
        let stereo = view.right.map(|right| StereoPair {
            from: view.left,
            to: right,
            baseline: Baseline::between(view.left.0, right.0),
            max_iterations: STEREO_ITERATIONS,
            max_return_px: MAX_RETURN_PX,
            is_unique_only: false,
        });
        for (px, level) in &self.found {
            let feature = self.describe(view, stereo.as_ref(), px, *level);
            self.features.extend(feature);
        }
        &self.features
    }

    /// The features of the last frame.
    pub fn features(&self) -> &[Feature] {
        &self.features
    }

    fn detect(&mut self, pyramid: &Pyramid) {
        self.found.clear();
        let fine = (FINE_SHARE * self.max_features as f32) as usize;
        let limits = [fine, self.max_features];
        for (level, detector) in self.detectors.iter_mut().enumerate().take(pyramid.level_count()) {
            let room = limits[level].saturating_sub(self.found.len());
            let plane = pyramid.plane(level);
            let scale = (1u32 << level) as f32;
            for corner in detector.detect(&plane, &[], &Demand { wanted: room, max_new: room }) {
                if let Some(px) = refine_corner(&plane, &corner.px) {
                    self.found.push((px * scale, level));
                }
            }
        }
    }

    fn describe(
        &self,
        view: &View<'_>,
        stereo: Option<&StereoPair<'_>>,
        px: &Vector2<f32>,
        level: usize,
    ) -> Option<Feature> {
        let (camera, pyramid) = view.left;
        let xy = camera.model.unproject(&px.cast())?;
        let focal_px = camera.focal_px();
        let (inverse_depth, sigma) =
            stereo.and_then(|pair| depth(pair, px, &xy)).unwrap_or((0.0, f64::INFINITY));
        let [least, usual, most] = RADIUS_PX;
        let radius_px = if inverse_depth > 0.0 {
            (PATCH_M * (focal_px * inverse_depth) as f32).clamp(least, most)
        } else {
            usual
        };
        let up = up_in_image(&view.up_c);
        let descriptor = self.pattern.describe(pyramid, &PatchFrame { px: *px, radius_px, up })?;
        Some(Feature {
            descriptor,
            xy: xy.cast(),
            sigma_xy: SIGMA_PX * (1u32 << level) as f32 / focal_px as f32,
            inverse_depth: inverse_depth as f32,
            sigma_inverse_depth: sigma as f32,
        })
    }
}

/// Inverse depth of a corner and its standard deviation, 1/m.
fn depth(pair: &StereoPair<'_>, px: &Vector2<f32>, xy: &Vector2<f64>) -> Option<(f64, f64)> {
    let found = pair.find(px, xy)?;
    let xy_right = pair.to.0.model.unproject(&found.px.cast())?;
    let focal_px = pair.to.0.focal_px();
    let geometry = pair.baseline.triangulate(xy, &xy_right, focal_px)?;
    let sound = geometry.epipolar_px < MAX_EPIPOLAR_PX && geometry.inverse_depth > 0.0;
    let sigma = f64::from(SIGMA_DISPARITY_PX) / (focal_px * pair.baseline.translation.norm());
    sound.then_some((geometry.inverse_depth, sigma))
}

/// Direction of the vertical in the image, the same for all of it; upright where the image does not tell.
fn up_in_image(up_c: &Vector3<f64>) -> Vector2<f32> {
    let lifted = up_c.xy().cast::<f32>();
    if lifted.norm() < MIN_VERTICAL { Vector2::new(0.0, -1.0) } else { lifted.normalize() }
}

/// The point that the gradients around a corner point to (Förstner and Gülch 1987): `sum g g^T (q - p) = 0`.
fn refine_corner(plane: &Plane<'_>, start: &Vector2<f32>) -> Option<Vector2<f32>> {
    let mut q = *start;
    for _ in 0..SUBPIXEL_STEPS {
        let (cx, cy) = (q.x.round() as i32, q.y.round() as i32);
        let (mut h, mut b) = (Matrix2::<f32>::zeros(), Vector2::<f32>::zeros());
        for dy in -SUBPIXEL_WINDOW..=SUBPIXEL_WINDOW {
            for dx in -SUBPIXEL_WINDOW..=SUBPIXEL_WINDOW {
                let (x, y) = (cx + dx, cy + dy);
                let at = |x: i32, y: i32| {
                    let (column, row) = (x + plane.origin as i32, y + plane.origin as i32);
                    f32::from(plane.pixels[row as usize * plane.columns + column as usize])
                };
                let g = Vector2::new(at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1));
                let offset = Vector2::new(x as f32, y as f32) - q;
                let weight = 1.0 / (1.0 + 0.1 * offset.norm_squared());
                let gg = g * g.transpose() * weight;
                h += gg;
                b += gg * offset;
            }
        }
        let step = h.try_inverse()? * b;
        q += step;
        // Written so that a NaN fails.
        let is_near = (q - start).norm() <= MAX_SUBPIXEL_MOVE;
        if !is_near {
            return None;
        }
        if step.norm() < 0.02 {
            break;
        }
    }
    Some(q)
}
