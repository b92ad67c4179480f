//! A track followed from one image of a camera to its next.

use super::flow::{FlowOptions, MAX_LAST_STEP_PX, returns, track_patch};
use super::repetition::search;
use super::rig::{Prediction, RigCamera, predict};
use super::template::{ReferencePatch, RefineLimits, Refinement};
use super::track::{RIVAL_SHARE, Track};
use super::witness::Witness;
use crate::image::Pyramid;
use crate::image::mask::ImageMask;
use nalgebra::{Matrix2, Rotation3, Vector2, Vector3};
use plumbline_config::Portable;

/// Least correlation with the patch of the previous frame.
const MIN_FLOW_ZNCC: f32 = 0.7;
/// Correlation of a reference that is looked for at the predicted place, without the flow's opinion.
const SURE_ZNCC: f32 = 0.95;
/// The reference corrects the flow by no more than this, px: further away lies another feature.
pub(super) const MAX_CORRECTION_PX: f32 = 1.5;
/// Largest change of an entry of the warp between two frames, 0.7 px at the edge of the patch: a patch that is
/// bent by more is not one surface.
const MAX_WARP_CHANGE: f32 = 0.13;
/// After this many frames in a row in which the reference was not recognised the track ends. A new reference
/// in its place would keep it longer, but what is no longer recognised is most often the edge of something
/// nearer that slides over the background: of the tracks of ten frames and more on a real flight, 30 % then
/// contradict a rigid scene by more than 1 px, against 11 % if they end.
const STRANGE_FRAMES: u32 = 2;
/// Levels of the way back: the return starts close to where it should end.
const RETURN_TOP_LEVEL: usize = 1;
/// Error of a place in the previous image, px.
const PLACE_SIGMA_PX: f64 = 0.3;
/// A place is predicted where it is certain to so many pixels.
pub(super) const MOST_SIGMA_PX: f64 = 2.0;
/// A point with rivals is looked for within so many standard deviations, and within these bounds, px.
const NEAR_SIGMAS: f64 = 2.0;
const NEAR_PX: (f64, f64) = (1.0, 2.0);
/// Or, where most were missed, within this, px.
pub(super) const WIDE_PX: f64 = 3.0;
/// Found beyond this share of the search, it is evidence against the prediction.
const RIM_SHARE: f64 = 0.75;
/// A place that is evidence of another turn is predicted to so many pixels.
const WITNESS_SIGMA_PX: f64 = 0.6;

/// True if a patch is the reference seen again: correlated, or differing by no more than noise.
pub(super) fn is_recognised(found: &Refinement) -> bool {
    /// Correlation of a patch with clear texture.
    const MIN_ZNCC: f32 = 0.85;
    /// Correlation of a faint patch, and its residual in grey levels.
    const FAINT: (f32, f32) = (0.7, 2.0);
    let is_alike = found.zncc >= MIN_ZNCC || (found.zncc >= FAINT.0 && found.rms <= FAINT.1);
    found.last_step_px < MAX_LAST_STEP_PX && is_alike
}

/// Two images of one camera.
#[derive(Clone, Copy)]
pub(super) struct Transition<'a> {
    /// Index of the camera.
    pub index: usize,
    pub camera: &'a RigCamera,
    pub previous: &'a Pyramid,
    pub current: &'a Pyramid,
    /// Takes previous to current coordinates of the camera.
    pub rot_cur_prev: Rotation3<f64>,
    /// Frames between the two images: 1 when none was missed.
    pub frames: u32,
    pub max_iterations: usize,
    pub max_return_px: f32,
    pub border_px: f64,
    /// Keep points that are unique in their surroundings only, and search on the full image alone.
    pub is_unique_only: bool,
    /// Predicted motion of the camera, where it is known and the texture repeats itself.
    pub shift: Option<Shift>,
    /// Look for points with rivals as far as these allow.
    pub is_wide: bool,
}

/// Predicted motion of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shift {
    /// Takes previous to current coordinates.
    pub rot_cur_prev: Rotation3<f64>,
    /// Position of the previous camera in the current, m.
    pub t_cur_prev: Vector3<f64>,
    /// Standard deviation of the way, m.
    pub sigma_m: f64,
}

/// Place where a point is predicted.
#[derive(Clone, Copy, Debug)]
struct Expected {
    px: Vector2<f64>,
    sigma_px: f64,
}

impl Expected {
    /// Radius of the search around it, where the nearest place that looks the same is `rival_px` away, px.
    fn reach_px(&self, rival_px: f32, is_wide: bool) -> f64 {
        let near_px = (NEAR_SIGMAS * self.sigma_px).clamp(NEAR_PX.0, NEAR_PX.1);
        (if is_wide { WIDE_PX } else { near_px }).at_most(RIVAL_SHARE * f64::from(rival_px))
    }
}

impl Transition<'_> {
    /// Moves the track to the current image, or marks it unseen there; what `mask` hides is unseen. `true` if it goes on: it
    /// was found, and is still the point it was.
    pub fn follow(&self, track: &mut Track, reference: &ReferencePatch, mask: Option<&ImageMask>) -> bool {
        let is_hidden = |px: Vector2<f64>| mask.is_some_and(|mask| mask.hides_px(&px));
        let found = self.try_follow(track, reference);
        if found.is_none() || track.px[self.index].is_some_and(is_hidden) {
            track.unsee(self.index);
            return false;
        }
        track.strange < STRANGE_FRAMES
    }

    /// Where a track that was followed by this camera was predicted, and where it is; `None` if its place was not predicted well.
    pub fn witness(&self, track: &Track) -> Option<Witness> {
        let (_, xy) = track.came_by.filter(|(by, _)| *by == self.index)?;
        self.expected(track, &xy).filter(|expected| expected.sigma_px < WITNESS_SIGMA_PX)?;
        let (shift, rho) = (self.shift.as_ref()?, track.depth?.rho);
        let p = shift.rot_cur_prev * Vector3::new(xy.x, xy.y, 1.0) + shift.t_cur_prev * rho;
        Some(Witness { expected: p.xy() / p.z, found: track.xy[self.index]?, rho: rho / p.z })
    }

    fn try_follow(&self, track: &mut Track, reference: &ReferencePatch) -> Option<()> {
        let c = self.index;
        let (px, xy) = (track.px[c]?, track.xy[c]?);
        let turned = predict(self.camera, self.camera, &xy, &self.rot_cur_prev, &Vector3::zeros())?;
        let expected = self.expected(track, &xy);
        let guess = expected.map_or(turned.px + track.flow_px[c] * f64::from(self.frames), |e| e.px);
        if let (Some(_), Some(rival_px)) = (self.shift, track.rival_px) {
            let expected =
                expected.filter(|e| NEAR_SIGMAS * e.sigma_px <= RIVAL_SHARE * f64::from(rival_px))?;
            track.was_predicted = Some(false);
            self.recognise_near(track, reference, &px, &expected, &turned)?;
            let off_px = (track.px[c]? - expected.px).norm();
            track.was_predicted = Some(off_px <= RIM_SHARE * expected.reach_px(rival_px, self.is_wide));
            return self.moved(track, &xy, &turned);
        }
        self.recognise(track, reference, &guess, &turned).or_else(|| {
            let flowed = self.flow(&px.cast(), &guess.cast(), &turned.warp).or_else(|| {
                // The point may have stopped: once more without its own velocity.
                let moved = track.flow_px[c].norm() > 1.0;
                moved.then(|| self.flow(&px.cast(), &turned.px.cast(), &turned.warp)).flatten()
            })?;
            self.settle(track, reference, &px, &flowed, &turned)
        })?;
        self.moved(track, &xy, &turned)
    }

    /// Writes down where the track is now, and how it came there.
    fn moved(&self, track: &mut Track, xy: &Vector2<f64>, turned: &Prediction) -> Option<()> {
        let c = self.index;
        let now = track.px[c]?;
        self.camera.model.contains(&now, self.border_px).then_some(())?;
        track.xy[c] = Some(self.camera.unproject(&now)?);
        track.flow_px[c] = (now - turned.px) / f64::from(self.frames);
        track.came_by = Some((c, *xy));
        Some(())
    }

    /// Place of a track by the predicted motion and its depth.
    fn expected(&self, track: &Track, xy: &Vector2<f64>) -> Option<Expected> {
        let (shift, depth) = (self.shift.as_ref()?, track.depth?);
        let t = shift.t_cur_prev * depth.rho;
        let place = predict(self.camera, self.camera, xy, &shift.rot_cur_prev, &t)?;
        let focal_px = self.camera.focal_px();
        let across = (shift.t_cur_prev.xy() - xy * shift.t_cur_prev.z).norm();
        let by_depth = focal_px * across * depth.sigma;
        let by_way = focal_px * depth.rho * shift.sigma_m;
        let sigma_px = (by_depth.squared() + by_way.squared() + PLACE_SIGMA_PX.squared()).sqrt();
        (sigma_px < MOST_SIGMA_PX).then_some(Expected { px: place.px, sigma_px })
    }

    /// Most points are where their motion so far and the gyroscope predict them, and the reference is seen there again: then
    /// there is no need to walk down the pyramid. Only where the other camera will contradict a mistake.
    fn recognise(
        &self,
        track: &mut Track,
        reference: &ReferencePatch,
        guess: &Vector2<f64>,
        turned: &Prediction,
    ) -> Option<()> {
        (self.frames == 1 && track.stereo.is_some() && track.strange == 0).then_some(())?;
        let c = self.index;
        let warp = turned.warp * track.warp[c];
        let refined = reference.refine(self.current, &guess.cast(), &warp, &self.limits())?;
        let is_sure = refined.zncc >= SURE_ZNCC && refined.last_step_px < MAX_LAST_STEP_PX;
        is_sure.then(|| {
            // The other camera turns with this one.
            track.warp[1 - c] = turned.warp * track.warp[1 - c];
            track.recognise(c, &refined);
        })
    }

    /// Looks for the track no further from where it is expected than it may be.
    fn recognise_near(
        &self,
        track: &mut Track,
        reference: &ReferencePatch,
        px: &Vector2<f64>,
        expected: &Expected,
        turned: &Prediction,
    ) -> Option<()> {
        let c = self.index;
        let reach_px = expected.reach_px(track.rival_px?, self.is_wide) as f32;
        let warp = turned.warp * track.warp[c];
        let limits = RefineLimits { max_move_px: reach_px, ..self.limits() };
        let refined =
            reference.refine(self.current, &expected.px.cast(), &warp, &limits).filter(is_recognised);
        track.warp[1 - c] = turned.warp * track.warp[1 - c];
        if let Some(refined) = refined {
            track.recognise(c, &refined);
            return Some(());
        }
        let options = FlowOptions { top_level: 0, max_iterations: self.max_iterations };
        let found = track_patch(
            (self.previous, &px.cast()),
            (self.current, &expected.px.cast()),
            &turned.warp,
            &options,
        )?;
        let is_near = (found.px.cast() - expected.px).norm() <= f64::from(reach_px);
        (is_near && found.zncc >= MIN_FLOW_ZNCC && found.last_step_px < MAX_LAST_STEP_PX).then_some(())?;
        track.flow(c, &found.px, warp);
        Some(())
    }

    fn limits(&self) -> RefineLimits {
        RefineLimits {
            max_iterations: self.max_iterations,
            max_linearizations: 2,
            max_move_px: MAX_CORRECTION_PX,
            max_warp_change: MAX_WARP_CHANGE,
        }
    }

    fn flow(&self, px: &Vector2<f32>, guess: &Vector2<f32>, warp: &Matrix2<f32>) -> Option<Vector2<f32>> {
        if self.is_unique_only {
            return search((self.previous, px), (self.current, guess), warp, self.max_iterations);
        }
        let options =
            FlowOptions { top_level: self.previous.level_count() - 1, max_iterations: self.max_iterations };
        let found = track_patch((self.previous, px), (self.current, guess), warp, &options)?;
        (found.zncc >= MIN_FLOW_ZNCC && found.last_step_px < MAX_LAST_STEP_PX).then_some(found.px)
    }

    /// Decides between the reference and the flow. The reference is the stronger test, so the way back is
    /// walked only without it.
    fn settle(
        &self,
        track: &mut Track,
        reference: &ReferencePatch,
        px: &Vector2<f64>,
        flowed: &Vector2<f32>,
        turned: &Prediction,
    ) -> Option<()> {
        let c = self.index;
        let predicted_warp = turned.warp * track.warp[c];
        track.warp[1 - c] = turned.warp * track.warp[1 - c];
        let refined =
            reference.refine(self.current, flowed, &predicted_warp, &self.limits()).filter(is_recognised);
        if let Some(refined) = refined {
            track.recognise(c, &refined);
            return Some(());
        }
        let options = FlowOptions { top_level: RETURN_TOP_LEVEL, max_iterations: self.max_iterations };
        let there = (self.current, flowed);
        returns(there, (self.previous, &px.cast()), &turned.warp, &options, self.max_return_px)
            .then_some(())?;
        track.flow(c, flowed, predicted_warp);
        Some(())
    }
}
