//! A point of one camera found in the other without a guess.
//!
//! The epipolar curve (distortion included) is walked over inverse depth from infinity to the nearest depth
//! that is still of use, on a coarse level of the pyramid; the best two correlations are refined by flow to
//! full resolution. A match must win clearly, return to where it started, lie on its epipolar line and
//! before the cameras.

use super::align::TranslationTemplate;
use super::flow::{FlowOptions, MAX_LAST_STEP_PX, SAME_PLACE_PX, prepare_at, returns, track_patch};
use super::rig::{Baseline, RigCamera, predict};
use crate::image::Pyramid;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Nearest depth searched, m: at half a metre the patch of two cameras 0.1 m apart is still alike.
pub const NEAREST_M: f64 = 0.3;
/// Rays may diverge by this much through noise and calibration, as inverse depth times baseline times
/// focal length, px.
pub const MAX_DIVERGENCE_PX: f64 = 2.0;
/// Level of the search: patches of 48 px, steps of 4 px.
const SEARCH_LEVEL: usize = 2;
/// Steps of the walk at most: bounds the work for any rig.
const MAX_STEPS: usize = 96;
/// Steps of the walk at most on the full image.
const MAX_FINE_STEPS: usize = 192;
/// Least correlation on the search level of a candidate.
const MIN_SEARCH_ZNCC: f32 = 0.4;
/// Least correlation at full resolution.
const MIN_ZNCC: f32 = 0.75;
/// The winner's correlations on both scales exceed the other candidate's by this much in sum, unless they are
/// one place.
pub const MIN_LEAD: f32 = 0.08;

/// A point found in the other camera.
#[derive(Clone, Copy, Debug)]
pub struct StereoMatch {
    /// Pixel in the other camera.
    pub px: Vector2<f32>,
    /// Takes pixel offsets from the first camera to the other.
    pub warp: Matrix2<f32>,
}

/// The pair of views that is searched.
#[derive(Clone, Copy)]
pub struct StereoPair<'a> {
    /// Camera and image the points come from.
    pub from: (&'a RigCamera, &'a Pyramid),
    /// Camera and image they are looked for in.
    pub to: (&'a RigCamera, &'a Pyramid),
    /// The way between them.
    pub baseline: Baseline,
    /// Gauss-Newton steps per level.
    pub max_iterations: usize,
    /// Largest distance between a point and its return, px.
    pub max_return_px: f32,
    /// Compare points on the full image alone: on coarse levels fine repeated texture is aliased.
    pub is_unique_only: bool,
}

/// A place on the epipolar curve.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    px: Vector2<f32>,
    zncc: f32,
}

impl StereoPair<'_> {
    /// Finds the point at `px` (ideal normalized `xy`) of the first image in the other; `None` when it is not there.
    #[must_use]
    pub fn find(&self, px: &Vector2<f32>, xy: &Vector2<f64>) -> Option<StereoMatch> {
        let warp = self.warp_at(xy, 0.0)?;
        let mut best = [None; 2];
        for candidate in self.candidates(px, xy, &warp).into_iter().flatten() {
            let options = FlowOptions { top_level: self.search_level(), max_iterations: self.max_iterations };
            let found = track_patch((self.from.1, px), (self.to.1, &candidate.px), &warp, &options);
            let Some(found) = found.filter(|f| f.zncc >= MIN_ZNCC && f.last_step_px < MAX_LAST_STEP_PX)
            else {
                continue;
            };
            // Both scales count: small patches repeat where their surroundings do not.
            keep_best(&mut best, Candidate { px: found.px, zncc: found.zncc + candidate.zncc });
        }
        let [best, second] = best;
        let best = best?;
        let rival = second.filter(|s| (s.px - best.px).norm() > SAME_PLACE_PX);
        let clear = rival.is_none_or(|r| best.zncc >= r.zncc + MIN_LEAD);
        let options = FlowOptions { top_level: 0, max_iterations: self.max_iterations };
        let returns =
            || returns((self.to.1, &best.px), (self.from.1, px), &warp, &options, self.max_return_px);
        (clear && returns()).then_some(StereoMatch { px: best.px, warp })
    }

    /// The map of pixel offsets around `xy` (normalized) to the other camera, on a plane that faces the first at
    /// `inverse_depth`, 1/m; `None` behind the other camera.
    #[must_use]
    pub fn warp_at(&self, xy: &Vector2<f64>, inverse_depth: f64) -> Option<Matrix2<f32>> {
        let shift = self.baseline.translation * inverse_depth;
        predict(self.from.0, self.to.0, xy, &self.baseline.rotation, &shift).map(|p| p.warp)
    }

    /// Pixel in the other camera of the point at `xy` (normalized) and `inverse_depth`, 1/m; `None` behind it.
    #[must_use]
    pub fn transfer(&self, xy: &Vector2<f64>, inverse_depth: f64) -> Option<Vector2<f64>> {
        let p_to = self.baseline.rotation * Vector3::new(xy.x, xy.y, 1.0)
            + self.baseline.translation * inverse_depth;
        self.to.0.project(&p_to).map(|(px, ..)| px)
    }

    /// The two best local maxima of the correlation along the epipolar curve.
    fn candidates(
        &self,
        px: &Vector2<f32>,
        xy: &Vector2<f64>,
        warp: &Matrix2<f32>,
    ) -> [Option<Candidate>; 2] {
        let mut out = [None; 2];
        let level = self.search_level().min(self.to.1.level_count() - 1).min(self.from.1.level_count() - 1);
        let scale = 1.0 / (1u32 << level) as f32;
        let Some(back) = warp.try_inverse() else { return out };
        let mut template = TranslationTemplate::empty();
        if !prepare_at(self.from.1, level, &(px * scale), &back, &mut template) {
            return out;
        }
        let plane = self.to.1.plane(level);
        let steps = self.step_count(scale);
        // The correlation of the last two places, to see a local maximum pass.
        let mut before: [Option<Candidate>; 2] = [None, None];
        for step in 0..=steps + 1 {
            let inverse_depth = step as f64 / steps as f64 / NEAREST_M;
            let place = if step <= steps { self.transfer(xy, inverse_depth) } else { None };
            let here = place.filter(|p| self.to.0.model.contains(p, 0.0)).and_then(|p| {
                let px = p.cast::<f32>();
                template.zncc_at(&plane, &(px * scale)).map(|zncc| Candidate { px, zncc })
            });
            if let Some(middle) = before[1] {
                let level = |c: Option<Candidate>| c.map_or(f32::NEG_INFINITY, |c| c.zncc);
                if middle.zncc > level(before[0])
                    && middle.zncc >= level(here)
                    && middle.zncc >= MIN_SEARCH_ZNCC
                {
                    keep_best(&mut out, middle);
                }
            }
            before = [before[1], here];
        }
        out
    }

    /// Steps of about one pixel of the search level over the whole range of depth, for a point ahead.
    fn step_count(&self, scale: f32) -> usize {
        let across = self.baseline.translation.norm() / NEAREST_M * self.to.0.focal_px();
        let most = if self.is_unique_only { MAX_FINE_STEPS } else { MAX_STEPS };
        ((across * f64::from(scale)) as usize).clamp(1, most)
    }

    fn search_level(&self) -> usize {
        if self.is_unique_only { 0 } else { SEARCH_LEVEL }
    }
}

/// Puts a candidate among the two best.
fn keep_best(best: &mut [Option<Candidate>; 2], new: Candidate) {
    if best[0].is_none_or(|b| new.zncc > b.zncc) {
        *best = [Some(new), best[0]];
    } else if best[1].is_none_or(|b| new.zncc > b.zncc) {
        best[1] = Some(new);
    }
}
