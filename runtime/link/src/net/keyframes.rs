//! The map as far as it is final: keyframes that have left the window, with their landmarks.
//!
//! A snapshot comes with each new keyframe. What the snapshot before it still had and the new one has no more is
//! final. The last ones are kept, encoded, for those who come late or lost some on the way.

use super::now_ns;
use plumbline_estimator::MapSnapshot;
use plumbline_estimator::window::snapshot::SnapshotKeyframe;
use plumbline_record::messages::Envelope;
use plumbline_record::protobuf::encode;
use std::collections::VecDeque;
use std::ops::Range;

/// Keyframes that are kept: half an hour at two a second.
const MAX_KEPT: usize = 4_096;
/// And bytes of them.
const MAX_KEPT_BYTES: usize = 32 << 20;

/// Makes keyframe messages in their envelopes, and remembers them.
#[derive(Debug)]
pub struct KeyframeHistory {
    max_landmarks: usize,
    last: Option<MapSnapshot>,
    kept: VecDeque<Vec<u8>>,
    bytes: usize,
    next: u64,
}

impl KeyframeHistory {
    /// Creates the history; of each keyframe it publishes at most `max_landmarks` points and as many lines.
    #[must_use]
    pub fn new(max_landmarks: usize) -> Self {
        Self { max_landmarks, last: None, kept: VecDeque::new(), bytes: 0, next: 0 }
    }

    /// Keyframes so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.next
    }

    /// Takes a snapshot; the messages of the keyframes that are final now.
    pub fn update(&mut self, snapshot: &MapSnapshot) -> Vec<Vec<u8>> {
        let mut messages = Vec::new();
        if let Some(last) = self.last.take() {
            for keyframe in finished(&last, snapshot) {
                let alone = alone(&last, keyframe, self.max_landmarks);
                let envelope = Envelope::around(&alone, encode(&alone), self.next, now_ns());
                messages.push(self.keep(&envelope));
            }
        }
        self.last = Some(snapshot.clone());
        messages
    }

    fn keep(&mut self, envelope: &Envelope) -> Vec<u8> {
        let bytes = encode(envelope);
        self.next += 1;
        self.bytes += bytes.len();
        self.kept.push_back(bytes.clone());
        while self.kept.len() > MAX_KEPT || self.bytes > MAX_KEPT_BYTES {
            self.bytes -= self.kept.pop_front().map_or(0, |oldest| oldest.len());
        }
        bytes
    }

    /// Messages of keyframes by their sequence numbers, oldest first, at most `limit`; those that were
    /// forgotten are left out.
    #[must_use]
    pub fn get(&self, wanted: Range<u64>, limit: usize) -> Vec<Vec<u8>> {
        let first = self.next - self.kept.len() as u64;
        let from = wanted.start.max(first);
        let skip = usize::try_from(from - first).unwrap_or(usize::MAX);
        let count = usize::try_from(wanted.end.saturating_sub(from)).unwrap_or(usize::MAX).min(limit);
        self.kept.iter().skip(skip).take(count).cloned().collect()
    }
}

/// Keyframes of `last` that are final, since the window of `next` has them no more. After a reset those are all.
pub fn finished<'a>(
    last: &'a MapSnapshot,
    next: &'a MapSnapshot,
) -> impl Iterator<Item = &'a SnapshotKeyframe> {
    let is_gone = |stamp| {
        last.reset_counter != next.reset_counter
            || next.keyframes.iter().all(|keyframe| keyframe.stamp != stamp)
    };
    last.keyframes.iter().filter(move |keyframe| is_gone(keyframe.stamp))
}

/// Places of `count` of `entries` entries, evenly chosen; all of them where there are fewer.
pub fn evenly(entries: usize, count: usize) -> impl Iterator<Item = usize> {
    let count = count.min(entries);
    (0..count).map(move |k| k * entries / count)
}

/// A keyframe of `snapshot` with the landmarks that it hosts, at most `limit` points and as many lines, evenly chosen.
fn alone(snapshot: &MapSnapshot, keyframe: &SnapshotKeyframe, limit: usize) -> MapSnapshot {
    let host = keyframe.stamp;
    MapSnapshot {
        stamp: host,
        reset_counter: snapshot.reset_counter,
        keyframes: vec![*keyframe],
        points: thinned(snapshot.points.iter().filter(|point| point.host == host), limit),
        lines: thinned(snapshot.lines.iter().filter(|line| line.host == host), limit),
    }
}

/// `limit` of some landmarks, evenly chosen.
fn thinned<'a, T: Copy + 'a>(landmarks: impl Iterator<Item = &'a T>, limit: usize) -> Vec<T> {
    let all: Vec<T> = landmarks.copied().collect();
    evenly(all.len(), limit).map(|k| all[k]).collect()
}

#[cfg(test)]
mod tests {
    use super::super::read::{self, Heard};
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_estimator::window::snapshot::{SnapshotKeyframe, SnapshotPoint};

    fn snapshot(stamps: Range<i64>, reset_counter: u32) -> MapSnapshot {
        let stamp = Timestamp::from_nanos;
        let keyframe =
            |k| SnapshotKeyframe { stamp: stamp(k), pose_o_b: Isometry3::translation(k as f64, 0.0, 0.0) };
        let point = |k| SnapshotPoint { host: stamp(k), p_o: Vector3::new(k as f64, 1.0, 2.0) };
        MapSnapshot {
            reset_counter,
            keyframes: stamps.clone().map(keyframe).collect(),
            points: stamps.map(point).collect(),
            ..MapSnapshot::default()
        }
    }

    fn first(bytes: &[u8]) -> Heard<MapSnapshot> {
        read::heard(bytes).unwrap()
    }

    fn stamps(messages: &[Vec<u8>]) -> Vec<i64> {
        let decoded = messages.iter().map(|bytes| first(bytes));
        decoded.map(|keyframe| keyframe.envelope.stamp_ns).collect()
    }

    #[test]
    fn a_keyframe_is_told_once_when_it_has_left_the_window_with_its_own_landmarks() {
        let mut history = KeyframeHistory::new(usize::MAX);
        assert!(history.update(&snapshot(1..4, 0)).is_empty());
        let told = history.update(&snapshot(3..6, 0));
        assert_eq!(stamps(&told), [1, 2]);
        let MapSnapshot { keyframes, points, .. } = first(&told[0]).message;
        assert_eq!((keyframes.len(), points.len(), points[0].p_o), (1, 1, Vector3::new(1.0, 1.0, 2.0)));
        assert!(history.update(&snapshot(3..6, 0)).is_empty());
        assert_eq!(history.count(), 2);
    }

    #[test]
    fn landmarks_are_thinned_out_evenly() {
        let all: Vec<u32> = (0..10).collect();
        assert_eq!(thinned(all.iter(), 20), all);
        assert_eq!(thinned(all.iter(), 3), [0, 3, 6]);
        assert!(thinned(all.iter(), 0).is_empty());
    }

    #[test]
    fn a_reset_ends_all_keyframes_of_before() {
        let mut history = KeyframeHistory::new(usize::MAX);
        history.update(&snapshot(1..4, 0));
        let told = history.update(&snapshot(3..5, 1));
        assert_eq!(stamps(&told), [1, 2, 3]);
        assert_eq!(first(&told[0]).envelope.reset_counter, 0);
    }

    #[test]
    fn those_who_come_late_get_what_is_kept_within_bounds() {
        let mut history = KeyframeHistory::new(usize::MAX);
        for k in 0..(MAX_KEPT as i64 + 10) {
            history.update(&snapshot(k..k + 1, 0));
        }
        assert_eq!(history.count(), MAX_KEPT as u64 + 9);
        assert_eq!(stamps(&history.get(0..u64::MAX, 3)), [9, 10, 11]);
        assert_eq!(stamps(&history.get(100..102, 64)), [100, 101]);
        assert!(history.get(9_000..9_001, 64).is_empty());
        assert!(history.get(Range { start: 5, end: 2 }, 64).is_empty());
    }
}
