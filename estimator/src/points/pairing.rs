//! The position of a track in the other camera of the rig.

use super::stereo::{MAX_DIVERGENCE_PX, NEAREST_M, StereoPair};
use super::template::{ReferencePatch, RefineLimits, Refinement};
use super::temporal::{MAX_CORRECTION_PX, is_recognised};
use super::track::{Depth, RIVAL_SHARE, StereoMemory, Track};
use crate::image::mask::ImageMask;
use nalgebra::{Matrix2, Vector2};
use plumbline_config::Portable;

/// Largest distance between the predicted and the found pixel of a known point, px.
const MAX_KNOWN_MOVE_PX: f32 = 4.0;
/// Largest difference of an entry of the warp from the last one, and of a new match from that of a plane
/// facing the camera: surfaces are seen at a slant.
const MAX_WARP_CHANGE: (f32, f32) = (0.2, 0.35);
/// Nearest depth that a match may have, as a share of the nearest searched.
const NEAREST_SHARE: f64 = 0.7;
/// An expected depth is looked for within so many standard deviations, from starts this far apart, px, and so many at most.
const NEAR_SIGMAS: f64 = 3.0;
const NEAR_STEP_PX: f64 = 2.5;
const MAX_NEAR_STARTS: f64 = 6.0;
/// Distance that a start may be off, px.
const NEAR_REACH_PX: f32 = 2.0;
/// A match lies this far beyond the ends of the search at most, px.
const END_PX: f32 = 0.5;
/// The best place there is better than any other by this much.
const NEAR_LEAD: f32 = 0.05;
/// Standard deviation of a match that was not refined against the reference patch, px.
const UNREFINED_SIGMA_PX: f32 = 0.3;

/// Pairs tracks of one camera with the other.
#[derive(Clone, Copy)]
pub(super) struct Pairing<'a> {
    /// Index of the camera in which the track was found, and of the other.
    pub from: usize,
    pub to: usize,
    pub pair: StereoPair<'a>,
    pub max_epipolar_px: f64,
    pub border_px: f64,
    /// Pixels of the second camera that are not looked at.
    pub mask: Option<&'a ImageMask>,
}

/// Distance from its predicted place within which a known point is looked for, px.
fn known_reach_px(track: &Track) -> f32 {
    track
        .rival_px
        .map_or(MAX_KNOWN_MOVE_PX, |rival_px| MAX_KNOWN_MOVE_PX.at_most(RIVAL_SHARE as f32 * rival_px))
}

impl Pairing<'_> {
    /// Finds a track where its depth is expected; else, unless it has rivals, anywhere along its epipolar line. `true` when found.
    pub fn search(&self, track: &mut Track, reference: &ReferencePatch, expected: Option<Depth>) -> bool {
        expected.is_some_and(|depth| self.try_near(track, reference, &depth).is_some())
            || track.rival_px.is_none() && self.try_search(track, reference).is_some()
    }

    /// Looks where the depth is expected.
    fn try_near(&self, track: &mut Track, reference: &ReferencePatch, depth: &Depth) -> Option<()> {
        let xy = track.xy[self.from]?;
        let [low, high] = [-1.0, 1.0].map(|side: f64| depth.rho + side * NEAR_SIGMAS * depth.sigma);
        let [a, b] = [low, high].map(|rho| self.pair.transfer(&xy, rho.at_least(0.0)));
        let (a, b) = (a?.cast::<f32>(), b?.cast::<f32>());
        let length_px = f64::from((a - b).norm());
        // On the way between the two ends, but for the error of a match.
        let is_between =
            |px: &Vector2<f32>| (px - a).norm() + (px - b).norm() <= (a - b).norm() + 2.0 * END_PX;
        let reach_px = known_reach_px(track).at_most(NEAR_REACH_PX);
        let starts = (length_px / NEAR_STEP_PX).ceil().at_least(1.0);
        (starts <= MAX_NEAR_STARTS).then_some(())?;
        let mut best: Option<Refinement> = None;
        let mut rival = -1.0f32;
        for k in 0..starts as usize {
            let share = (k as f64 + 0.5) / starts;
            let rho = (low + share * (high - low)).at_least(0.0);
            let Some(start) = self.pair.transfer(&xy, rho) else { continue };
            let Some(warp) = self.pair.warp_at(&xy, rho) else { continue };
            let warp = warp * track.warp[self.from];
            let found = self.refine(reference, &start.cast(), &warp, (reach_px, MAX_WARP_CHANGE.1));
            let Some(found) = found.filter(|found| is_between(&found.px)) else { continue };
            let Some(other) = best else {
                best = Some(found);
                continue;
            };
            let (better, worse) = if found.zncc <= other.zncc { (other, found) } else { (found, other) };
            if (better.px - worse.px).norm() >= 1.0 {
                rival = rival.at_least(worse.zncc);
            }
            best = Some(better);
        }
        let found = best.filter(|best| best.zncc >= rival + NEAR_LEAD)?;
        track.stereo = None;
        self.accept(track, &xy, (found.px, found.warp, found.covariance_px2))
    }

    /// Finds a track near where its depth predicts it.
    pub fn continue_match(&self, track: &mut Track, reference: &ReferencePatch) -> Option<()> {
        let (xy, memory) = (track.xy[self.from]?, track.stereo?);
        let inverse_depth = memory.inverse_depth + memory.change;
        let guess = self.pair.transfer(&xy, inverse_depth)? + memory.offset_px;
        let warp = self.pair.warp_at(&xy, inverse_depth)? * track.warp[self.from];
        let reach_px = known_reach_px(track);
        let near = (reach_px, MAX_WARP_CHANGE.0);
        let refined = self.refine(reference, &guess.cast(), &track.warp[self.to], near);
        let found = refined.or_else(|| {
            // Its last warp may have been wrong: once more from that of the first camera.
            self.refine(reference, &guess.cast(), &warp, (reach_px, MAX_WARP_CHANGE.1))
        })?;
        self.accept(track, &xy, (found.px, found.warp, found.covariance_px2))
    }

    fn try_search(&self, track: &mut Track, reference: &ReferencePatch) -> Option<()> {
        let (px, xy) = (track.px[self.from]?, track.xy[self.from]?);
        let found = self.pair.find(&px.cast(), &xy)?;
        let warp = found.warp * track.warp[self.from];
        let unrefined = (found.px, warp, Matrix2::identity() * (UNREFINED_SIGMA_PX * UNREFINED_SIGMA_PX));
        let found = self
            .refine(reference, &found.px, &warp, (MAX_CORRECTION_PX, MAX_WARP_CHANGE.1))
            .map_or(unrefined, |found| (found.px, found.warp, found.covariance_px2));
        track.stereo = None;
        self.accept(track, &xy, found)
    }

    /// The reference seen again near `start`.
    fn refine(
        &self,
        reference: &ReferencePatch,
        start: &Vector2<f32>,
        warp: &Matrix2<f32>,
        (max_move_px, max_warp_change): (f32, f32),
    ) -> Option<Refinement> {
        let limits = RefineLimits {
            max_iterations: self.pair.max_iterations,
            max_linearizations: 3,
            max_move_px,
            max_warp_change,
        };
        reference.refine(self.pair.to.1, start, warp, &limits).filter(is_recognised)
    }

    /// Takes a match (place, warp and covariance, px²) when it lies on its epipolar line, before the cameras, and well within the image.
    fn accept(
        &self,
        track: &mut Track,
        xy: &Vector2<f64>,
        (px, warp, covariance_px2): (Vector2<f32>, Matrix2<f32>, Matrix2<f32>),
    ) -> Option<()> {
        let camera = self.pair.to.0;
        let px = px.cast::<f64>();
        camera.model.contains(&px, self.border_px).then_some(())?;
        (!self.mask.is_some_and(|mask| mask.hides_px(&px))).then_some(())?;
        let xy_to = camera.unproject(&px)?;
        let geometry = self.pair.baseline.triangulate(xy, &xy_to, camera.focal_px())?;
        let disparity_per_depth = self.pair.baseline.translation.norm() * camera.focal_px();
        let plausible = geometry.epipolar_px <= self.max_epipolar_px
            && geometry.inverse_depth * disparity_per_depth >= -MAX_DIVERGENCE_PX
            && geometry.inverse_depth <= 1.0 / (NEAREST_SHARE * NEAREST_M);
        plausible.then_some(())?;
        let predicted = self.pair.transfer(xy, geometry.inverse_depth)?;
        let change = track.stereo.map_or(0.0, |s| geometry.inverse_depth - s.inverse_depth);
        track.stereo =
            Some(StereoMemory { inverse_depth: geometry.inverse_depth, change, offset_px: px - predicted });
        track.px[self.to] = Some(px);
        track.xy[self.to] = Some(xy_to);
        track.warp[self.to] = warp;
        track.covariance_px2[self.to] = covariance_px2;
        Some(())
    }
}
