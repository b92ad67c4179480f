//! The past of a flight, for those who come late or lost some of it on the way: poses, keyframes that are final, and the
//! corrected path as it was last sent.
//!
//! A keyframe is final when it has left the window. A snapshot comes with each new keyframe: what the snapshot before it still had
//! and the new one has no more is final, with its landmarks.

use super::now_ns;
use plumbline_estimator::window::snapshot::SnapshotKeyframe;
use plumbline_estimator::{Estimate, MapSnapshot};
use plumbline_record::messages::{Envelope, PastPose, PastTrajectory};
use plumbline_record::protobuf::encode;
use std::collections::VecDeque;
use std::ops::Range;

/// Poses that are kept: half an hour at 20 Hz.
pub const MAX_POSES: usize = 36_000;
/// Keyframes that are kept: half an hour at two a second.
const MAX_KEYFRAMES: usize = 4_096;
/// And bytes of them.
const MAX_KEYFRAME_BYTES: usize = 32 << 20;

/// Past of a flight, filled by the publisher.
#[derive(Debug)]
pub struct History {
    max_landmarks: usize,
    poses: VecDeque<PastPose>,
    last: Option<MapSnapshot>,
    /// Messages of keyframes in their envelopes, which are numbered from 0 on.
    keyframes: VecDeque<Vec<u8>>,
    keyframe_bytes: usize,
    next_keyframe: u64,
    /// The corrected path as it was last sent.
    pub path: Vec<u8>,
}

impl History {
    /// Creates the history; of each keyframe it keeps at most `max_landmarks` points and as many lines.
    pub fn new(max_landmarks: usize) -> Self {
        Self {
            max_landmarks,
            poses: VecDeque::new(),
            last: None,
            keyframes: VecDeque::new(),
            keyframe_bytes: 0,
            next_keyframe: 0,
            path: Vec::new(),
        }
    }

    /// Remembers a pose.
    pub fn remember(&mut self, estimate: &Estimate) {
        if !estimate.has_pose() {
            return;
        }
        if self.poses.len() == MAX_POSES {
            self.poses.pop_front();
        }
        let Estimate { stamp, pose_o_b, reset_counter, .. } = *estimate;
        self.poses.push_back(PastPose { stamp, pose_o_b, reset_counter });
    }

    /// Poses from `wanted.start` to before `wanted.end`, at least `step_ns` apart, in answers of at most `size` poses.
    pub fn trajectory(&self, wanted: &Range<i64>, step_ns: i64, size: usize) -> Vec<PastTrajectory> {
        let mut next_ns = i64::MIN;
        let mut is_due = |pose: &&PastPose| {
            let stamp_ns = pose.stamp.as_nanos();
            let is_due = wanted.contains(&stamp_ns) && stamp_ns >= next_ns;
            if is_due {
                next_ns = stamp_ns.saturating_add(step_ns);
            }
            is_due
        };
        let selected: Vec<PastPose> = self.poses.iter().filter(&mut is_due).copied().collect();
        if selected.is_empty() {
            return vec![PastTrajectory::default()];
        }
        selected.chunks(size).map(|poses| PastTrajectory { poses: poses.to_vec() }).collect()
    }

    /// Keyframes so far.
    pub fn keyframe_count(&self) -> u64 {
        self.next_keyframe
    }

    /// Takes a snapshot; the messages of the keyframes that are final now.
    pub fn update(&mut self, snapshot: &MapSnapshot) -> Vec<Vec<u8>> {
        let last = self.last.replace(snapshot.clone());
        let Some(last) = &last else { return Vec::new() };
        finished(last, snapshot)
            .map(|keyframe| self.keep(&alone(last, keyframe, self.max_landmarks)))
            .collect()
    }

    fn keep(&mut self, keyframe: &MapSnapshot) -> Vec<u8> {
        let bytes = encode(&Envelope::around(keyframe, encode(keyframe), self.next_keyframe, now_ns()));
        self.next_keyframe += 1;
        self.keyframe_bytes += bytes.len();
        self.keyframes.push_back(bytes.clone());
        while self.keyframes.len() > MAX_KEYFRAMES || self.keyframe_bytes > MAX_KEYFRAME_BYTES {
            self.keyframe_bytes -= self.keyframes.pop_front().map_or(0, |oldest| oldest.len());
        }
        bytes
    }

    /// Sequence numbers and messages of keyframes, oldest first, at most `limit`; those that were forgotten are left out.
    pub fn keyframes(&self, wanted: &Range<u64>, limit: usize) -> Vec<(u64, Vec<u8>)> {
        let first = self.next_keyframe - self.keyframes.len() as u64;
        let numbered = (first..).zip(&self.keyframes).filter(|(number, _)| wanted.contains(number));
        numbered.take(limit).map(|(number, bytes)| (number, bytes.clone())).collect()
    }
}

/// Keyframes of `last` that are final, since the window of `next` has them no more. After a reset those are all.
fn finished<'a>(last: &'a MapSnapshot, next: &'a MapSnapshot) -> impl Iterator<Item = &'a SnapshotKeyframe> {
    let is_gone = |stamp| {
        last.reset_counter != next.reset_counter
            || next.keyframes.iter().all(|keyframe| keyframe.stamp != stamp)
    };
    last.keyframes.iter().filter(move |keyframe| is_gone(keyframe.stamp))
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
    let count = limit.min(all.len());
    (0..count).map(|k| all[k * all.len() / count]).collect()
}

#[cfg(test)]
mod tests {
    use super::super::read::{self, Heard};
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_estimator::window::snapshot::SnapshotPoint;

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
        let mut history = History::new(usize::MAX);
        assert!(history.update(&snapshot(1..4, 0)).is_empty());
        let told = history.update(&snapshot(3..6, 0));
        assert_eq!(stamps(&told), [1, 2]);
        let MapSnapshot { keyframes, points, .. } = first(&told[0]).message;
        assert_eq!((keyframes.len(), points.len(), points[0].p_o), (1, 1, Vector3::new(1.0, 1.0, 2.0)));
        assert!(history.update(&snapshot(3..6, 0)).is_empty());
        assert_eq!(history.keyframe_count(), 2);
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
        let mut history = History::new(usize::MAX);
        history.update(&snapshot(1..4, 0));
        let told = history.update(&snapshot(3..5, 1));
        assert_eq!(stamps(&told), [1, 2, 3]);
        assert_eq!(first(&told[0]).envelope.reset_counter, 0);
    }

    #[test]
    fn those_who_come_late_get_what_is_kept_within_bounds() {
        let mut history = History::new(usize::MAX);
        for k in 0..(MAX_KEYFRAMES as i64 + 10) {
            history.update(&snapshot(k..k + 1, 0));
        }
        assert_eq!(history.keyframe_count(), MAX_KEYFRAMES as u64 + 9);
        let kept = |wanted: Range<u64>, limit| history.keyframes(&wanted, limit);
        let (numbers, messages): (Vec<_>, Vec<_>) = kept(0..u64::MAX, 3).into_iter().unzip();
        assert_eq!((numbers, stamps(&messages)), (vec![9, 10, 11], vec![9, 10, 11]));
        assert_eq!(kept(100..102, 64).len(), 2);
        assert!(kept(9_000..9_001, 64).is_empty() && kept(Range { start: 5, end: 2 }, 64).is_empty());
    }
}
