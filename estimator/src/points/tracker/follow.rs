//! Tracks from the previous images into the new ones.

use super::PointTracker;
use crate::points::temporal::{Shift, Transition};
use nalgebra::UnitQuaternion;

/// A turn that moves the image by more than this, px, is not taken for granted.
const LARGE_TURN_PX: f64 = 8.0;
/// It is refuted where it leads to fewer than this share of so many tracks at least, and no turn at all to so many times as many.
const FOUND_SHARE: f64 = 0.6;
const MIN_TRACKS: usize = 20;
const TIMES_AS_MANY: f64 = 1.5;

impl PointTracker {
    /// Moves every track into this frame, by the camera whose previous image is the newest.
    pub(super) fn follow(&mut self) {
        // Beyond the limit the youngest go.
        self.store.tracks.iter_mut().skip(self.limit).for_each(|track| track.lost = true);
        self.store.sweep();
        self.before.clear();
        let is_doubtful = self.is_turn_large() && self.store.tracks.len() >= MIN_TRACKS;
        if is_doubtful || self.motion.is_some() {
            self.before.extend_from_slice(&self.store.tracks);
        }
        let found = self.follow_all();
        if is_doubtful && (found as f64) < FOUND_SHARE * self.before.len() as f64 {
            self.follow_without_turn(found);
        } else if self.is_prediction_missed() {
            self.follow_by_rivals();
        }
        let is_missed = self.is_prediction_missed();
        self.store.sweep();
        if is_missed {
            self.refuse_prediction();
        }
    }

    fn is_turn_large(&self) -> bool {
        let mut views = self.views.iter().zip(&self.rig).filter(|(view, _)| view.can_follow());
        views.any(|(view, camera)| view.rot_prev_cur_b.angle() * camera.focal_px() > LARGE_TURN_PX)
    }

    /// Follows the tracks as if the cameras had not turned, where the predicted turn led to `found` of them, and keeps to that if it leads to
    /// many times as many: then the gyroscope is wrong.
    fn follow_without_turn(&mut self, found: usize) {
        let (motion, turn) = (self.motion.take(), self.turn);
        let mut turns = [UnitQuaternion::identity(); 2];
        self.exchange_turns(&mut turns);
        std::mem::swap(&mut self.before, &mut self.store.tracks);
        if (self.follow_all() as f64) < TIMES_AS_MANY * found.max(1) as f64 {
            std::mem::swap(&mut self.before, &mut self.store.tracks);
            self.exchange_turns(&mut turns);
            (self.motion, self.turn) = (motion, turn);
        }
    }

    fn exchange_turns(&mut self, turns: &mut [UnitQuaternion<f64>; 2]) {
        let views = self.views.iter_mut().zip(turns);
        views.for_each(|(view, turn)| std::mem::swap(&mut view.rot_prev_cur_b, turn));
    }

    /// Follows all tracks, and returns how many were found; the others are marked as lost. Those without rivals come first: where they
    /// tell of another turn than the predicted one, the others are looked for by that.
    pub(super) fn follow_all(&mut self) -> usize {
        let unique = self.follow_those(false);
        self.turn = self.turn_by_unique();
        if let (Some(motion), Some(turn)) = (&mut self.motion, self.turn.filter(|turn| turn.is_other)) {
            motion.pose_prev_cur_b.rotation = turn.rot_prev_cur_b;
        }
        unique + self.follow_those(true)
    }

    /// Follows the tracks that have rivals, or those that have none.
    fn follow_those(&mut self, have_rivals: bool) -> usize {
        let (mut tracks, mut found) = (std::mem::take(&mut self.store.tracks), 0);
        let transitions = self.transitions();
        for track in tracks.iter_mut().filter(|track| track.rival_px.is_some() == have_rivals) {
            track.came_by = None;
            track.was_predicted = None;
            let usable = transitions.iter().flatten().filter(|t| track.px[t.index].is_some());
            let is_found = usable.min_by_key(|t| t.frames).is_some_and(|t| {
                let mask = self.masks[t.index].as_ref();
                t.follow(track, &self.store.references[track.slot], mask)
            });
            track.lost = !is_found;
            found += usize::from(is_found);
        }
        self.store.tracks = tracks;
        found
    }

    /// The way from the previous image of each camera into that of this frame, where there are both, by the predicted motion if there is one.
    pub(super) fn transitions(&self) -> [Option<Transition<'_>>; 2] {
        let is_unique_only = self.is_strict();
        std::array::from_fn(|c| {
            self.views.get(c).filter(|v| v.can_follow()).map(|view| Transition {
                index: c,
                camera: &self.rig[c],
                previous: &view.previous,
                current: &view.current,
                rot_cur_prev: self.rig[c].rotation_of(&view.rot_prev_cur_b).inverse().to_rotation_matrix(),
                frames: view.frames,
                max_iterations: self.options.max_iterations,
                max_return_px: self.options.max_forward_backward_px,
                border_px: self.options.border_px as f64,
                is_unique_only,
                is_wide: false,
                shift: self.motion.filter(|_| view.frames == 1).map(|motion| {
                    let pose_b_c = &self.rig[c].pose_b_c;
                    let pose_cur_prev_c = (pose_b_c.inverse() * motion.pose_prev_cur_b * pose_b_c).inverse();
                    Shift {
                        rot_cur_prev: pose_cur_prev_c.rotation.to_rotation_matrix(),
                        t_cur_prev: pose_cur_prev_c.translation.vector,
                        sigma_m: motion.sigma_m,
                    }
                }),
            })
        })
    }
}
