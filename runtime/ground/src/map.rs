//! The map received from a vehicle: keyframes with their landmarks, in bounded memory.

use super::history::History;
use nalgebra::Isometry3;
use plumbline_estimator::MapSnapshot;
use plumbline_link::net::read::Heard;
use std::collections::BTreeMap;
use std::ops::Range;

/// Keyframes that are kept.
pub const MAX_KEYFRAMES: usize = 5_000;
/// Coordinates of landmarks that are kept.
const MAX_NUMBERS: usize = 400_000;

/// A keyframe with the landmarks that it hosts.
#[derive(Clone, Debug)]
pub struct MapKeyframe {
    /// Time of the keyframe, ns.
    pub stamp_ns: i64,
    /// Resets before it.
    pub reset_counter: u32,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Points, x y z in O.
    pub points_o: Vec<f32>,
    /// Lines, both ends, in O.
    pub lines_o: Vec<f32>,
}

/// Keyframes and landmarks in the vehicle's window now.
#[derive(Clone, Debug, Default)]
pub struct WindowScene {
    /// Keyframes.
    pub keyframes: Vec<Isometry3<f64>>,
    /// Points, x y z in O.
    pub points_o: Vec<f32>,
    /// Lines, both ends, in O.
    pub lines_o: Vec<f32>,
    /// Counts updates.
    pub version: u64,
}

/// Coordinates of points, and of both ends of lines, one after the other.
fn landmarks(message: &MapSnapshot) -> (Vec<f32>, Vec<f32>) {
    let points = message.points.iter().flat_map(|point| point.p_o.iter());
    let lines = message.lines.iter().flat_map(|line| line.ends_o.iter().flatten());
    (points.map(|x| *x as f32).collect(), lines.map(|x| *x as f32).collect())
}

/// Keyframes by sequence number, and in the order of arrival.
#[derive(Clone, Debug, Default)]
pub struct Map {
    keyframes: BTreeMap<u64, MapKeyframe>,
    /// Their numbers in the order of arrival, in this epoch.
    arrivals: History<u64>,
    numbers: usize,
    /// Keyframes that the vehicle has, as it reports.
    pub announced: u64,
    /// Time at which `announced` was published, ns by the vehicle's clock.
    announced_ns: i64,
    /// Counts how often the map was cleared.
    pub epoch: u64,
    /// Resets at the start of the present odometry frame: what is older lies in a frame that is gone.
    since_reset: u32,
    /// Keyframes below this number lie in a frame that is gone, and are not queried.
    first: u64,
    /// The window now.
    pub scene: WindowScene,
}

impl Map {
    /// Adds a keyframe; one that is known already is ignored.
    pub fn insert(&mut self, Heard { envelope, message }: &Heard<MapSnapshot>) {
        let (sequence, stamp_ns, reset_counter) =
            (envelope.sequence, envelope.stamp_ns, envelope.reset_counter);
        let Some(pose_o_b) = message.keyframes.first().map(|keyframe| keyframe.pose_o_b) else { return };
        self.raise(sequence.saturating_add(1), envelope.published_ns);
        if reset_counter < self.since_reset {
            self.first = self.first.max(sequence.saturating_add(1));
            return;
        }
        if self.keyframes.contains_key(&sequence) {
            return;
        }
        let (points_o, lines_o) = landmarks(message);
        self.numbers += points_o.len() + lines_o.len();
        self.keyframes.insert(sequence, MapKeyframe { stamp_ns, reset_counter, pose_o_b, points_o, lines_o });
        self.arrivals.push(sequence, usize::MAX);
        while self.keyframes.len() > MAX_KEYFRAMES || self.numbers > MAX_NUMBERS {
            let Some(oldest) = self.arrivals.pop_oldest() else { break };
            if let Some(gone) = self.keyframes.remove(&oldest) {
                self.numbers -= gone.points_o.len() + gone.lines_o.len();
            }
        }
    }

    /// Applies the number of keyframes in a health message published at `published_ns`. A smaller one than before is that of a
    /// vehicle that has restarted, whose map is new, unless a keyframe has overtaken the message.
    pub fn announce(&mut self, keyframes: u64, published_ns: i64, has_restarted: bool) {
        if keyframes < self.announced && (has_restarted || published_ns >= self.announced_ns) {
            self.clear();
        }
        self.raise(keyframes, published_ns);
    }

    fn raise(&mut self, keyframes: u64, published_ns: i64) {
        if keyframes > self.announced {
            (self.announced, self.announced_ns) = (keyframes, published_ns);
        }
    }

    /// Replaces the window, unless it lies in a frame that is gone.
    pub fn set_scene(&mut self, message: &MapSnapshot) {
        if message.reset_counter < self.since_reset {
            return;
        }
        let (points_o, lines_o) = landmarks(message);
        let keyframes = message.keyframes.iter().map(|keyframe| keyframe.pose_o_b).collect();
        self.scene = WindowScene { keyframes, points_o, lines_o, version: self.scene.version + 1 };
    }

    /// Discards all keyframes: they are counted anew.
    pub fn clear(&mut self) {
        let (since_reset, version) = (self.since_reset, self.scene.version + 1);
        let scene = WindowScene { version, ..WindowScene::default() };
        *self = Self { epoch: self.epoch + 1, since_reset, scene, ..Self::default() };
    }

    /// Starts an odometry frame that is there since this many resets: keyframes and window of older ones are discarded.
    pub fn start_frame(&mut self, since_reset: u32) {
        self.since_reset = since_reset;
        self.scene = WindowScene { version: self.scene.version + 1, ..WindowScene::default() };
        let is_old = |keyframe: &MapKeyframe| keyframe.reset_counter < since_reset;
        if !self.keyframes.values().any(is_old) {
            return;
        }
        let (old, kept) = std::mem::take(&mut self.keyframes).into_iter().partition(|(_, k)| is_old(k));
        let old: BTreeMap<u64, MapKeyframe> = old;
        self.keyframes = kept;
        self.first = self.first.max(old.keys().next_back().map_or(0, |last| last + 1));
        let left = self.arrivals.iter().copied().filter(|sequence| !old.contains_key(sequence)).collect();
        self.arrivals = History::of(left, usize::MAX);
        self.numbers = self.keyframes.values().map(|k| k.points_o.len() + k.lines_o.len()).sum();
        self.epoch += 1;
    }

    /// Keyframes kept.
    pub fn len(&self) -> usize {
        self.keyframes.len()
    }

    /// True if the map has no keyframes.
    pub fn is_empty(&self) -> bool {
        self.keyframes.is_empty()
    }

    /// The newest gap of at most `limit` keyframes that were announced and not received, among those that are kept.
    pub fn missing(&self, limit: u64) -> Option<Range<u64>> {
        let oldest = self.announced.saturating_sub(MAX_KEYFRAMES as u64).max(self.first);
        // Keyframes discarded for lack of memory are not queried again.
        let oldest = if self.arrivals.total() > self.keyframes.len() as u64 {
            self.keyframes.keys().next().copied().unwrap_or(oldest).max(oldest)
        } else {
            oldest
        };
        let last = (oldest..self.announced).rev().find(|sequence| !self.keyframes.contains_key(sequence))?;
        let first = (oldest..=last)
            .rev()
            .take(usize::try_from(limit).unwrap_or(usize::MAX))
            .take_while(|sequence| !self.keyframes.contains_key(sequence))
            .last()?;
        Some(first..last + 1)
    }

    /// Keyframes from arrival number `from` on, at most `limit`, and the number after the last of them.
    pub fn since(&self, from: u64, limit: usize) -> (u64, Vec<(u64, &MapKeyframe)>) {
        let from = from.clamp(self.arrivals.first(), self.arrivals.total());
        let some = self.arrivals.since(from).take(limit);
        let count = some.len() as u64;
        let some = some.filter_map(|sequence| Some((*sequence, self.keyframes.get(sequence)?))).collect();
        (from + count, some)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_messages::{heard, window};
    use super::*;

    fn keyframe(sequence: u64, points: usize) -> Heard<MapSnapshot> {
        heard(sequence, window(0, 0, points))
    }

    fn later(sequence: u64, reset_counter: u32) -> Heard<MapSnapshot> {
        heard(sequence, window(0, reset_counter, 1))
    }

    #[test]
    fn keyframes_of_an_older_odometry_frame_are_discarded_and_not_queried() {
        let mut map = Map::default();
        (0..4).for_each(|sequence| map.insert(&keyframe(sequence, 1)));
        map.set_scene(&window(0, 0, 1));
        let (epoch, version) = (map.epoch, map.scene.version);
        map.start_frame(1);
        assert!(map.is_empty() && map.scene.points_o.is_empty());
        assert!(map.epoch > epoch && map.scene.version > version, "pages are told");
        // What was in the window at the reset is announced after it.
        [later(4, 0), later(6, 1)].iter().for_each(|message| map.insert(message));
        map.set_scene(&window(0, 0, 1));
        assert!(map.scene.points_o.is_empty(), "a window of before comes late");
        assert_eq!(map.missing(64), Some(5..6));
        map.insert(&later(5, 1));
        assert_eq!((map.len(), map.missing(64)), (2, None));
        assert_eq!(map.since(0, 10).1.len(), 2);
    }

    #[test]
    fn what_is_missing_is_found_newest_gap_first() {
        let mut map = Map::default();
        assert_eq!(map.missing(64), None);
        for sequence in [0, 1, 4, 5, 9] {
            map.insert(&keyframe(sequence, 1));
        }
        assert_eq!(map.missing(64), Some(6..9));
        assert_eq!(map.missing(2), Some(7..9));
        (6..9).for_each(|sequence| map.insert(&keyframe(sequence, 1)));
        assert_eq!(map.missing(64), Some(2..4));
        map.announced = 12;
        assert_eq!(map.missing(64), Some(10..12));
    }

    #[test]
    fn a_message_that_a_keyframe_has_overtaken_clears_no_map() {
        let published = |sequence, published_ns| {
            let mut message = keyframe(sequence, 1);
            message.envelope.published_ns = published_ns;
            message
        };
        let mut map = Map::default();
        (0..3).for_each(|sequence| map.insert(&published(sequence, 10 + sequence as i64)));
        map.announce(2, 11, false);
        assert_eq!((map.len(), map.announced), (3, 3), "it was published before the third keyframe");
        map.announce(5, 13, false);
        map.insert(&published(3, 12));
        assert_eq!((map.len(), map.missing(64)), (4, Some(4..5)));
        let mut restarted = map.clone();
        restarted.announce(1, 14, false);
        assert_eq!((restarted.len(), restarted.missing(64)), (0, Some(0..1)), "the vehicle has restarted");
        map.announce(1, 3, true);
        assert_eq!((map.len(), map.announced), (0, 1), "and its clock was set back");
    }

    #[test]
    fn late_keyframes_are_told_in_the_order_of_their_arrival() {
        let mut map = Map::default();
        [0, 3, 1, 1].into_iter().for_each(|sequence| map.insert(&keyframe(sequence, 1)));
        let (next, some) = map.since(0, 2);
        assert_eq!((next, some.iter().map(|(s, _)| *s).collect::<Vec<_>>()), (2, vec![0, 3]));
        assert_eq!(map.since(next, 10).1.len(), 1);
        assert!(map.since(3, 10).1.is_empty());
    }

    #[test]
    fn memory_is_bounded_and_what_was_forgotten_is_not_asked_for_again() {
        let mut map = Map::default();
        (0..2_000).for_each(|sequence| map.insert(&keyframe(sequence, 100)));
        assert!(map.len() <= MAX_NUMBERS / 300);
        assert_eq!(map.missing(64), None);
    }
}
