//! Cover and neighbours of keyframes by their places, computed when they are added, and again when they have moved.

use super::{MAX_NEIGHBOUR_DISTANCE, MAX_NEIGHBOURS, PlaceMap, view_distance_within};

/// Points of a keyframe that are looked for in another to tell how much they share.
const SHARED_SAMPLES: usize = 48;
/// Keyframes that share fewer of these are no neighbours.
const MIN_SHARED: usize = 12;
/// Ratio of the depth of a point in two keyframes beyond which it does not look alike.
const MAX_DEPTH_RATIO: f64 = 2.0;
/// A keyframe that has moved by no more than this, by the view distance, keeps its neighbours, m.
const MOVED_M: f64 = 0.03;

/// View distance and neighbour of a keyframe that no other keyframe covers.
pub(super) const UNCOVERED: (f64, usize) = (f64::INFINITY, usize::MAX);

impl PlaceMap {
    /// Finds out anew what covers keyframes that have moved, and their neighbours: of `limit` at most, in turn. Returns
    /// of how many it did.
    pub fn tend(&mut self, limit: usize) -> usize {
        let slots = self.keyframes.len();
        let mut tended = 0;
        for _ in 0..slots {
            if tended == limit {
                break;
            }
            let slot = self.next_tended % slots;
            self.next_tended = slot + 1;
            let (now, then) = (&self.poses_m_c[slot], &self.linked_at[slot]);
            if self.keyframes[slot].is_some() && view_distance_within(now, then, MOVED_M).is_none() {
                self.link_anew(slot);
                tended += 1;
            }
        }
        tended
    }

    fn link_anew(&mut self, slot: usize) {
        self.unlink(slot);
        self.update_cover(slot);
        self.link(slot);
    }

    /// Makes it nobody's neighbour, and lets it cover nobody.
    pub(super) fn unlink(&mut self, slot: usize) {
        for other in self.keyframes.iter_mut().flatten() {
            other.neighbours.retain(|n| usize::from(*n) != slot);
        }
        if let Some(keyframe) = &mut self.keyframes[slot] {
            keyframe.neighbours.clear();
        }
        for other in 0..self.keyframes.len() {
            if self.keyframes[other].is_some() && self.covered[other].1 == slot {
                self.measure_cover(other);
            }
        }
    }

    /// Finds out what covers a new keyframe, and what it covers.
    pub(super) fn update_cover(&mut self, slot: usize) {
        self.measure_cover(slot);
        let new = &self.poses_m_c[slot];
        for (other, covered) in self.covered.iter_mut().enumerate() {
            if other == slot || self.keyframes[other].is_none() {
                continue;
            }
            if let Some(distance) = view_distance_within(new, &self.poses_m_c[other], covered.0) {
                *covered = (distance, slot);
            }
        }
    }

    fn measure_cover(&mut self, slot: usize) {
        let mut covered = UNCOVERED;
        for other in (0..self.keyframes.len()).filter(|&o| o != slot && self.keyframes[o].is_some()) {
            let (a, b) = (&self.poses_m_c[slot], &self.poses_m_c[other]);
            if let Some(distance) = view_distance_within(a, b, covered.0) {
                covered = (distance, other);
            }
        }
        self.covered[slot] = covered;
    }

    /// Finds the neighbours of a new keyframe, and makes it theirs.
    pub(super) fn link(&mut self, slot: usize) {
        self.linked_at[slot] = self.poses_m_c[slot];
        let mut best: heapless::Vec<(usize, usize), { MAX_NEIGHBOURS + 1 }> = heapless::Vec::new();
        for (other, _) in self.keyframes().filter(|(other, _)| *other != slot) {
            let (a, b) = (&self.poses_m_c[slot], &self.poses_m_c[other]);
            if view_distance_within(a, b, MAX_NEIGHBOUR_DISTANCE).is_none() {
                continue;
            }
            // What cannot enter the list need not be counted in full.
            let least = if best.len() < MAX_NEIGHBOURS { MIN_SHARED } else { best[best.len() - 1].0 + 1 };
            let Some(shared) = self.shared_at_least(least, slot, other) else { continue };
            let at = best.iter().position(|(s, _)| *s < shared).unwrap_or(best.len());
            let _ = best.insert(at, (shared, other));
            best.truncate(MAX_NEIGHBOURS);
        }
        for &(_, other) in &best {
            self.make_neighbour(slot, other);
            self.make_neighbour(other, slot);
        }
    }

    /// Number of points that two keyframes share, by the one that shares less, if it is at least `least`.
    fn shared_at_least(&self, least: usize, a: usize, b: usize) -> Option<usize> {
        let forth = self.shared(a, b);
        if forth < least {
            return None;
        }
        Some(forth.min(self.shared(b, a))).filter(|shared| *shared >= least)
    }

    /// Puts a keyframe among the neighbours of another, by what they share; the weakest goes where there is no room.
    fn make_neighbour(&mut self, slot: usize, other: usize) {
        let share = |n: usize| self.shared(slot, n).min(self.shared(n, slot));
        let Some(keyframe) = &self.keyframes[slot] else { return };
        let shared = share(other);
        let weaker = keyframe.neighbours.iter().position(|n| share(usize::from(*n)) < shared);
        let at = weaker.unwrap_or(keyframe.neighbours.len());
        let Some(keyframe) = &mut self.keyframes[slot] else { return };
        if at < MAX_NEIGHBOURS {
            keyframe.neighbours.truncate(MAX_NEIGHBOURS - 1);
            let _ = keyframe.neighbours.insert(at, other as u16);
        }
    }

    /// Number of sampled points of one keyframe that lie in the view of another.
    fn shared(&self, of: usize, within: usize) -> usize {
        let Some(b) = self.keyframe(within) else { return 0 };
        let pose = self.poses_m_c[within].inverse() * self.poses_m_c[of];
        let points = self.features(of).iter().filter(|f| f.is_point()).take(SHARED_SAMPLES);
        points
            .filter(|f| {
                let p = f.position_c();
                let q = pose * nalgebra::Point3::from(p);
                let ratio = q.z / p.z;
                ratio > 1.0 / MAX_DEPTH_RATIO
                    && ratio < MAX_DEPTH_RATIO
                    && (q.x / q.z).abs() <= f64::from(b.field[0])
                    && (q.y / q.z).abs() <= f64::from(b.field[1])
            })
            .count()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Keyframe, MapLimits};
    use super::*;
    use crate::places::Feature;
    use crate::places::descriptor::Descriptor;
    use nalgebra::{Isometry3, Vector2};
    use plumbline_config::Timestamp;

    /// A wall of points 3 m ahead.
    fn wall() -> Vec<Feature> {
        let at = |k: usize| Vector2::new(0.1 * (k % 8) as f32 - 0.4, 0.1 * (k / 8) as f32 - 0.4);
        let feature = |k: usize| Feature {
            descriptor: Descriptor::default(),
            xy: at(k),
            sigma_xy: 0.002,
            inverse_depth: 0.33,
            sigma_inverse_depth: 0.01,
        };
        (0..64).map(feature).collect()
    }

    fn at(x: f64) -> Keyframe {
        let pose = Isometry3::translation(x, 0.0, 0.0);
        Keyframe::new(0, Timestamp::from_nanos(0), pose, Isometry3::identity())
    }

    /// Two laps along the same way, and the second out by 50 m.
    fn drifted() -> PlaceMap {
        let mut map = PlaceMap::new(MapLimits { keyframes: 8, features: 64 });
        for k in 0..8u32 {
            let lap = f64::from(k / 4);
            map.add(at(1.5 * f64::from(k % 4) + 50.0 * lap + 0.01 * lap), &wall()).unwrap();
        }
        map
    }

    #[test]
    fn keyframes_that_are_brought_together_become_neighbours_and_cover_each_other() {
        let mut map = drifted();
        assert!(!map.keyframe(5).unwrap().neighbours.contains(&1));
        for slot in 4..8 {
            let x = 1.5 * (slot - 4) as f64 + 0.01;
            map.set_pose(slot, Isometry3::translation(x, 0.0, 0.0));
        }
        assert_eq!([map.tend(1), map.tend(2), map.tend(8), map.tend(8)], [1, 2, 1, 0]);
        for (slot, like) in [(4, 0), (5, 1), (1, 5), (7, 3), (3, 7)] {
            let neighbours = &map.keyframe(slot).unwrap().neighbours;
            assert_eq!(neighbours.first(), Some(&like), "of {slot}: {neighbours:?}");
            assert_eq!(map.covered[slot].1, usize::from(like));
        }
        // One of a pair that shows the same is what a full map forgets.
        map.add(at(100.0), &wall()).unwrap();
        let x = |slot: usize| map.keyframe(slot).map_or(f64::NAN, |k| k.pose_m_b.translation.x);
        for k in 0..4 {
            let place = 1.5 * f64::from(k);
            assert!((0..8).any(|slot| (x(slot) - place).abs() < 0.1), "nothing is left at {place} m");
        }
    }

    #[test]
    fn keyframes_that_are_moved_apart_are_neighbours_no_more() {
        let mut map = drifted();
        assert!(map.keyframe(0).unwrap().neighbours.contains(&1));
        map.set_pose(0, Isometry3::translation(-30.0, 0.0, 0.0));
        map.tend(8);
        assert!(map.keyframe(0).unwrap().neighbours.is_empty());
        assert!(!map.keyframe(1).unwrap().neighbours.contains(&0));
        let nearest = map.covered[1];
        assert_eq!((nearest.1, (nearest.0 - 1.5).abs() < 1e-9), (2, true));
    }

    #[test]
    fn small_moves_are_not_worth_the_work() {
        let mut map = drifted();
        for slot in 0..8 {
            let x = map.keyframe(slot).unwrap().pose_m_b.translation.x + 0.005;
            map.set_pose(slot, Isometry3::translation(x, 0.0, 0.0));
        }
        assert_eq!(map.tend(8), 0);
    }
}
