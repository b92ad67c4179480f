//! Points that are predicted by the window, while the texture in view repeats itself.

use super::PointTracker;
use crate::points::prediction::{KnownPoint, MATCH_SIGMA_PX, PredictedMotion, take_depths};
use crate::points::rig::{Baseline, RigCamera};
use crate::points::temporal::MOST_SIGMA_PX;
use crate::points::track::Depth;
use plumbline_config::Portable;

/// Distance at which a way is judged: points are predicted while it is known to [`MOST_SIGMA_PX`] there, m.
const PREDICTED_M: f64 = 1.5;
/// Frames for which predictions are refused once most points have missed one.
const REFUSED_FRAMES: u32 = 10;
/// Matches of tracks up to this age are no evidence of the depth around them.
const NEW_AGE: u32 = 2;

impl PointTracker {
    /// Sets the motion to the next frame that the window predicts, and the landmarks that it knows, in order of their tracks.
    pub fn set_prediction(&mut self, motion: Option<&PredictedMotion>, known: &[KnownPoint]) {
        self.motion = None;
        self.refused = self.refused.saturating_sub(1);
        let is_ready = self.is_repeating()
            && !self.options.unique_only
            && self.refused == 0
            && self.views.iter().all(|view| view.has_previous && view.previous_frame == self.frame);
        let Some(motion) = motion.filter(|_| is_ready) else { return };
        if motion.sigma_m / PREDICTED_M * self.rig[0].focal_px() > MOST_SIGMA_PX {
            return;
        }
        let pose_b_c = self.rig[0].pose_b_c;
        let pose_prev_known_c = pose_b_c.inverse() * motion.pose_prev_known_b * pose_b_c;
        take_depths(&mut self.store.tracks, known, &pose_prev_known_c, match_sigma(&self.rig));
        self.depths.clear();
        for track in &self.store.tracks {
            if let (Some(px), Some(depth)) = (track.px[0], track.depth) {
                self.depths.add(px, depth);
            }
        }
        for track in self.store.tracks.iter_mut().filter(|track| track.depth.is_none()) {
            track.depth = track.px[0].and_then(|px| self.depths.around(&px));
        }
        self.motion = Some(*motion);
    }

    /// Takes note of whether the window has a state.
    pub fn set_state_known(&mut self, is_known: bool) {
        self.has_started |= is_known;
    }

    /// Ends the tracks that began before the repetition was noticed: matched on coarse levels, most are paired with another cell.
    pub(super) fn end_tracks_of_before(&mut self) {
        if self.is_strict() {
            self.store.tracks.iter_mut().for_each(|track| track.lost = !track.is_looked_at);
            self.store.sweep();
        }
    }

    /// True if the texture in view repeats itself, so that points are predicted, or else only those followed that are unique.
    pub fn is_repeating(&self) -> bool {
        self.rig.len() > 1 && self.repetition.is_repeating()
    }

    /// Ends the tracks that have rivals, and refuses predictions for a while.
    pub(super) fn refuse_prediction(&mut self) {
        self.refused = REFUSED_FRAMES;
        self.motion = None;
        self.store.tracks.iter_mut().for_each(|track| track.lost = track.rival_px.is_some());
        self.store.sweep();
    }

    /// Takes the depths around new points from the matches of the first `count` tracks in camera `c`.
    pub(super) fn take_depths_of_matches(&mut self, c: usize, count: usize) {
        let sigma = match_sigma(&self.rig);
        self.depths.clear();
        for track in self.store.tracks[..count].iter().filter(|track| track.age > NEW_AGE) {
            if let (Some(px), Some(stereo)) = (track.px[c], track.stereo) {
                self.depths.add(px, Depth { rho: stereo.inverse_depth, sigma });
            }
        }
    }
}

/// Standard deviation of the inverse depth of a stereo match, 1/m.
fn match_sigma(rig: &[RigCamera]) -> f64 {
    let baseline_m = Baseline::between(&rig[0], &rig[1]).translation.norm();
    MATCH_SIGMA_PX / (baseline_m * rig[0].focal_px()).at_least(1.0)
}
