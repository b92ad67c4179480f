//! Which frame becomes a keyframe, and which frame makes room.
//!
//! Source: overlap and removal rules of basalt (Usenko et al. 2019, section IV) and the distance score of
//! DSO (Engel et al. 2016, section 3.1).

use super::Window;

/// A keyframe of whose landmarks less than this share is still seen may go first.
const MIN_SEEN_SHARE: f64 = 0.1;
/// The newest keyframes that are never removed.
const KEPT_KEYFRAMES: usize = 2;
/// Keeps the distance score finite between two keyframes at one place, m.
const DISTANCE_FLOOR_M: f64 = 1e-3;

impl Window {
    /// True if the newest frame should become a keyframe, with `connected` of its `tracked` points linked to landmarks.
    pub fn needs_keyframe(&self, connected: usize, tracked: usize) -> bool {
        let Some(newest) = self.frames.last() else { return false };
        let Some(last) = self.frames.iter().rev().skip(1).find(|f| f.is_keyframe) else { return true };
        let is_overdue = newest.stamp.seconds_since(last.stamp) > self.options.max_keyframe_interval_s;
        tracked > 0 && (is_overdue || (connected as f64) < self.options.min_connected_ratio * tracked as f64)
    }

    /// Removes frames until the window is within its limits.
    pub fn make_room(&mut self) {
        while let Some(index) = self.surplus_frame() {
            self.remove_frame(index);
        }
    }

    /// The next frame to remove, if there is one too many.
    fn surplus_frame(&self) -> Option<usize> {
        let count = self.frames.len();
        let is_recent = |k: usize| k + self.options.recent_frames >= count;
        if let Some(k) = (0..count).find(|&k| !self.frames[k].is_keyframe && !is_recent(k)) {
            return Some(k);
        }
        let keyframes = self.frames.iter().filter(|f| f.is_keyframe).count();
        if keyframes <= self.options.keyframes {
            return None;
        }
        self.forgotten_keyframe().or_else(|| self.crowded_keyframe())
    }

    fn removable(&self) -> impl Iterator<Item = usize> + '_ {
        let keyframes = self.frames.iter().filter(|f| f.is_keyframe).count();
        let all = self.frames.iter().enumerate().filter(|(_, f)| f.is_keyframe).map(|(k, _)| k);
        all.take(keyframes.saturating_sub(KEPT_KEYFRAMES))
    }

    /// The oldest keyframe whose landmarks are hardly seen any more.
    fn forgotten_keyframe(&self) -> Option<usize> {
        let newest = (self.frames.len() - 1) as u8;
        self.removable().find(|&k| {
            let hosted = self.points.all().iter().filter(|l| usize::from(l.host) == k && l.is_triangulated);
            let (mut all, mut seen) = (0.0, 0.0);
            for landmark in hosted {
                all += 1.0;
                if landmark.observations.iter().any(|o| o.frame == newest) {
                    seen += 1.0;
                }
            }
            seen < MIN_SEEN_SHARE * all || all == 0.0
        })
    }

    /// The keyframe that is close to others but far from the newest; ties go to the oldest.
    fn crowded_keyframe(&self) -> Option<usize> {
        let p = |k: usize| self.frames[k].nav.p_o_b;
        let newest = self.frames.len() - 1;
        let mut best: Option<(usize, f64)> = None;
        for i in self.removable() {
            let to_newest = (p(i) - p(newest)).norm().sqrt();
            let crowding: f64 = self
                .removable()
                .filter(|&j| j != i)
                .map(|j| 1.0 / ((p(i) - p(j)).norm() + DISTANCE_FLOOR_M))
                .sum();
            let score = to_newest * crowding;
            if best.is_none_or(|(_, s)| score > s) {
                best = Some((i, score));
            }
        }
        best.map(|(k, _)| k)
    }
}

#[cfg(test)]
#[path = "keyframes_tests.rs"]
mod tests;
