//! Tracks from the previous images into the new ones.

use super::PointTracker;
use crate::points::temporal::{Followed, Shift, Transition};
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
        if self.is_turn_large() && self.store.tracks.len() >= MIN_TRACKS {
            self.before.extend_from_slice(&self.store.tracks);
        }
        let found = self.follow_all();
        if (found as f64) < FOUND_SHARE * self.before.len() as f64 {
            self.follow_without_turn(found);
        }
        let is_within = self.store.tracks.iter().filter_map(|track| track.was_predicted);
        let (predicted, missed) =
            (is_within.clone().count(), is_within.filter(|is_within| !is_within).count());
        self.store.sweep();
        self.judge_prediction(predicted, missed);
    }

    fn is_turn_large(&self) -> bool {
        let mut views = self.views.iter().zip(&self.rig).filter(|(view, _)| view.can_follow());
        views.any(|(view, camera)| view.rot_prev_cur_b.angle() * camera.focal_px() > LARGE_TURN_PX)
    }

    /// Follows the tracks as if the cameras had not turned, where the predicted turn led to `found` of them, and keeps to that if it leads to
    /// many times as many: then the gyroscope is wrong.
    fn follow_without_turn(&mut self, found: usize) {
        let (motion, figures) = (self.motion.take(), std::mem::take(&mut self.figures));
        let mut turns = [UnitQuaternion::identity(); 2];
        self.exchange_turns(&mut turns);
        std::mem::swap(&mut self.before, &mut self.store.tracks);
        if (self.follow_all() as f64) < TIMES_AS_MANY * found.max(1) as f64 {
            std::mem::swap(&mut self.before, &mut self.store.tracks);
            self.exchange_turns(&mut turns);
            (self.motion, self.figures) = (motion, figures);
        }
    }

    fn exchange_turns(&mut self, turns: &mut [UnitQuaternion<f64>; 2]) {
        let views = self.views.iter_mut().zip(turns);
        views.for_each(|(view, turn)| std::mem::swap(&mut view.rot_prev_cur_b, turn));
    }

    /// Follows all tracks, and returns how many were found; the others are marked as lost.
    fn follow_all(&mut self) -> usize {
        let is_unique_only = self.is_strict();
        let transitions: [Option<Transition<'_>>; 2] = std::array::from_fn(|c| {
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
                use_reference: self.use_reference,
                is_unique_only,
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
        });
        let mut found = 0;
        for (track, reference) in self.store.iter_mut() {
            track.came_by = None;
            track.was_predicted = None;
            let usable = transitions.iter().flatten().filter(|t| track.px[t.index].is_some());
            let outcome = usable.min_by_key(|t| t.frames).map_or(Followed::Lost, |t| {
                let mask = self.masks[t.index].as_ref();
                t.follow(track, reference, mask)
            });
            let counter = match outcome {
                Followed::Refined => &mut self.figures.refined,
                Followed::FlowOnly => &mut self.figures.flow_only,
                Followed::Changed => &mut self.figures.changed,
                Followed::Lost => &mut self.figures.lost,
            };
            *counter += 1;
            track.lost = matches!(outcome, Followed::Lost | Followed::Changed);
            found += usize::from(!track.lost);
        }
        found
    }
}
