//! New points: corners where the leading camera has none, and their matches in the other one.

use super::{PointTracker, pairing};
use crate::points::corners::Demand;
use crate::points::pairing::Pairing;
use crate::points::repetition::nearest_rival_px;

/// New points a frame beside a full set of tracks; bounds the worst frame.
const MAX_NEW_BESIDE_TRACKS: usize = 60;
/// New corners looked at for repetition: at first, and later one in so many frames.
const FIRST_LOOKS: usize = 16;
const LOOK_PERIOD: u64 = 2;

impl PointTracker {
    /// Begins tracks in empty cells of the leading camera, and pairs them.
    pub(super) fn detect(&mut self) {
        let c = self.leading();
        let before = self.store.tracks.len();
        self.begin_tracks(c);
        let is_strict = self.is_strict();
        let is_predicted = self.motion.is_some();
        if is_predicted {
            self.take_depths_of_matches(c, before);
        }
        let pairing = pairing(&self.rig, &self.views, &self.options, is_strict, self.use_reference, c, 1 - c)
            .map(|pairing| Pairing { mask: self.masks[1 - c].as_ref(), ..pairing });
        let Some(pairing) = pairing else { return };
        self.store.iter_mut().skip(before).for_each(|(track, reference)| {
            let expected = track.px[c].filter(|_| is_predicted).and_then(|px| self.depths.around(&px));
            pairing.search(track, reference, expected);
        });
    }

    /// True if a point must be unique, or be looked for near where it is predicted.
    pub(super) fn is_strict(&self) -> bool {
        self.options.unique_only || self.is_repeating()
    }

    fn begin_tracks(&mut self, c: usize) {
        self.taken.clear();
        self.taken.extend(self.store.tracks.iter().filter_map(|t| t.px[c]).map(|px| px.cast::<f32>()));
        let free = self.limit.saturating_sub(self.store.tracks.len());
        // Following costs as much as beginning: an empty tracker may begin them all.
        let max_new = (MAX_NEW_BESIDE_TRACKS + free / 2).min(free);
        let demand = Demand { wanted: self.taken.len() + free, max_new };
        let view = &self.views[c];
        let corners = self.detectors[c].detect(&view.current.plane(0), &self.taken, &demand);
        if self.rig.len() > 1 {
            let is_due = self.frame.is_multiple_of(LOOK_PERIOD);
            let looks = if self.repetition.is_new() { FIRST_LOOKS } else { usize::from(is_due) };
            for corner in corners.iter().take(looks) {
                self.repetition.add(nearest_rival_px(&view.current, &corner.px).is_some());
            }
        }
        let is_strict = self.options.unique_only || self.rig.len() > 1 && self.repetition.is_repeating();
        for corner in corners {
            let px = corner.px.cast::<f64>();
            let Some(xy) = self.rig[c].unproject(&px) else { continue };
            let rival_px = if is_strict { nearest_rival_px(&view.current, &corner.px) } else { None };
            if rival_px.is_some() && self.motion.is_none() {
                continue;
            }
            let Some(track) = self.store.begin(&view.current, &corner.px) else { continue };
            (track.px[c], track.xy[c]) = (Some(px), Some(xy));
            track.rival_px = rival_px;
            self.figures.new += 1;
        }
    }
}
