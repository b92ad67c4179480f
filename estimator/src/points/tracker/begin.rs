//! New points: corners where the leading camera has none, and their matches in the other one.

use super::{PointTracker, pairing};
use crate::image::Pyramid;
use crate::points::corners::{Demand, DetectedCorner};
use crate::points::pairing::Pairing;
use crate::points::repetition::{RepetitionWatch, is_in_lattice, nearest_rival_px};

/// New points a frame beside a full set of tracks; bounds the worst frame.
const MAX_NEW_BESIDE_TRACKS: usize = 60;
/// New corners looked at for repetition: at first (the strongest for rivals, others for lattices), and later one of either in so many
/// frames.
const FIRST_LOOKS: (usize, usize) = (16, 64);
const LOOK_PERIOD: u64 = 2;
/// Step from one look to the next through the corners: of any strength in a few looks.
const LOOK_STEP: u64 = 7;

impl PointTracker {
    /// Begins tracks in empty cells of the leading camera, and pairs them.
    pub(super) fn detect(&mut self) {
        let c = self.leading();
        let before = self.store.tracks.len();
        self.begin_tracks(c);
        if self.is_start_of_one_camera() {
            return;
        }
        let is_strict = self.is_strict();
        let is_predicted = self.motion.is_some();
        if is_predicted {
            self.take_depths_of_matches(c, before);
        }
        let pairing = pairing(&self.rig, &self.views, &self.options, is_strict, [c, 1 - c])
            .map(|pairing| Pairing { mask: self.masks[1 - c].as_ref(), ..pairing });
        let Some(pairing) = pairing else { return };
        self.store.iter_mut().skip(before).for_each(|(track, reference)| {
            let expected = track.px[c].filter(|_| is_predicted).and_then(|px| self.depths.around(&px));
            pairing.search(track, reference, expected);
        });
    }

    /// True if a point must be unique, or be looked for near where it is predicted.
    pub(super) fn is_strict(&self) -> bool {
        self.options.unique_only || self.is_repeating() && !self.is_start_of_one_camera()
    }

    /// True if all points are followed and none is paired: where lattices alone tell of the repetition, and the window has no state yet,
    /// most matches would be of another cell, and too few points are unique.
    pub(super) fn is_start_of_one_camera(&self) -> bool {
        !self.options.unique_only
            && self.is_repeating()
            && !self.repetition.is_everywhere()
            && !self.has_started
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
            look(&mut self.repetition, &view.current, corners, self.frame);
        }
        let is_repeating = self.rig.len() > 1 && self.repetition.is_repeating();
        let is_known = self.motion.is_some();
        let is_strict =
            self.options.unique_only || is_repeating && (self.repetition.is_everywhere() || self.has_started);
        for corner in corners {
            let px = corner.px.cast::<f64>();
            let Some(xy) = self.rig[c].unproject(&px) else { continue };
            let is_looked_at = is_strict || is_repeating;
            let rival_px = if is_looked_at { nearest_rival_px(&view.current, &corner.px) } else { None };
            if rival_px.is_some() && is_strict && !is_known {
                continue;
            }
            let Some(track) = self.store.begin(&view.current, &corner.px) else { continue };
            (track.px[c], track.xy[c]) = (Some(px), Some(xy));
            (track.rival_px, track.is_looked_at) = (rival_px, is_looked_at);
        }
    }
}

/// Looks at some of the new `corners` of `frame` for repetition.
fn look(repetition: &mut RepetitionWatch, image: &Pyramid, corners: &[DetectedCorner], frame: u64) {
    let looks = match (repetition.is_new(), frame.is_multiple_of(LOOK_PERIOD)) {
        (true, _) => FIRST_LOOKS,
        (false, is_due) => (usize::from(is_due), usize::from(is_due)),
    };
    for corner in corners.iter().take(looks.0) {
        repetition.add(nearest_rival_px(image, &corner.px).is_some());
    }
    let (first, stride) =
        ((frame / LOOK_PERIOD * LOOK_STEP) as usize, (corners.len() / looks.1.max(1)).max(1));
    for k in 0..looks.1.min(corners.len()) {
        let corner = &corners[(first + k * stride) % corners.len()];
        repetition.add_any(is_in_lattice(image, &corner.px));
    }
}
