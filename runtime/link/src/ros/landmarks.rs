//! Landmarks of the whole flight where the map has them now, in bounded memory.
//!
//! A keyframe that has left the window keeps its landmarks in its own frame. The corrected path has the poses of most
//! keyframes; a keyframe that it lacks is corrected as its neighbour in time. So the landmarks follow every loop.

use crate::net::history::{evenly, finished};
use nalgebra::{Isometry3, Point3, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::MapSnapshot;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::window::snapshot::SnapshotKeyframe;
use std::collections::VecDeque;

/// Keyframes that are kept, and landmarks of all of them; the oldest go first.
const MAX_KEYFRAMES: usize = 4_000;
const MAX_LANDMARKS: usize = 50_000;

/// Keyframe that is final, with the landmarks that it hosts.
#[derive(Clone, Debug)]
struct Keyframe {
    stamp: Timestamp,
    reset_counter: u32,
    pose_o_b: Isometry3<f64>,
    points_b: Vec<Vector3<f32>>,
    lines_b: Vec<[Vector3<f32>; 2]>,
}

/// Points, and both ends of lines, in the map frame, m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapLandmarks {
    /// Points.
    pub points: Vec<Vector3<f32>>,
    /// Lines.
    pub lines: Vec<[Vector3<f32>; 2]>,
}

/// Keyframes of the flight with their landmarks.
#[derive(Clone, Debug)]
pub struct LandmarkMap {
    per_keyframe: usize,
    last: Option<MapSnapshot>,
    keyframes: VecDeque<Keyframe>,
    landmarks: usize,
}

/// Takes coordinates from the odometry to the map frame, as of a keyframe.
#[derive(Clone, Copy, Debug)]
struct Correction {
    stamp: Timestamp,
    reset_counter: u32,
    pose_m_o: Isometry3<f64>,
}

impl LandmarkMap {
    /// Creates an empty map. Of each keyframe it keeps at most `per_keyframe` points and as many lines.
    #[must_use]
    pub fn new(per_keyframe: usize) -> Self {
        Self { per_keyframe, last: None, keyframes: VecDeque::new(), landmarks: 0 }
    }

    /// Newest content of the window.
    #[must_use]
    pub fn window(&self) -> Option<&MapSnapshot> {
        self.last.as_ref()
    }

    /// Takes the content of the window after a keyframe.
    pub fn update(&mut self, snapshot: MapSnapshot) {
        if let Some(last) = self.last.take() {
            for keyframe in finished(&last, &snapshot) {
                self.keep(&last, keyframe);
            }
        }
        self.last = Some(snapshot);
    }

    fn keep(&mut self, snapshot: &MapSnapshot, keyframe: &SnapshotKeyframe) {
        let to_body = keyframe.pose_o_b.inverse();
        let in_body = |p: &Vector3<f64>| (to_body * Point3::from(*p)).coords.cast();
        let points: Vec<_> = snapshot.points.iter().filter(|p| p.host == keyframe.stamp).collect();
        let lines: Vec<_> = snapshot.lines.iter().filter(|l| l.host == keyframe.stamp).collect();
        let kept = Keyframe {
            stamp: keyframe.stamp,
            reset_counter: snapshot.reset_counter,
            pose_o_b: keyframe.pose_o_b,
            points_b: evenly(points.len(), self.per_keyframe).map(|k| in_body(&points[k].p_o)).collect(),
            lines_b: evenly(lines.len(), self.per_keyframe)
                .map(|k| lines[k].ends_o.each_ref().map(in_body))
                .collect(),
        };
        self.landmarks += kept.points_b.len() + kept.lines_b.len();
        self.keyframes.push_back(kept);
        while self.keyframes.len() > MAX_KEYFRAMES || self.landmarks > MAX_LANDMARKS {
            let Some(oldest) = self.keyframes.pop_front() else { break };
            self.landmarks -= oldest.points_b.len() + oldest.lines_b.len();
        }
    }

    /// Landmarks in the map frame: those of keyframes by the corrected path, those of the window by the newest pose of the
    /// odometry frame in the map. Keyframes between resets of which the path has none are left out.
    #[must_use]
    pub fn corrected(&self, path: &MapPath, estimate: Option<&MapEstimate>) -> MapLandmarks {
        let corrections = self.corrections(path);
        let mut landmarks = MapLandmarks::default();
        for keyframe in &self.keyframes {
            let Some(pose_m_o) = nearest(&corrections, keyframe) else { continue };
            let pose_m_b = (pose_m_o * keyframe.pose_o_b).cast::<f32>();
            let place = |p: &Vector3<f32>| (pose_m_b * Point3::from(*p)).coords;
            landmarks.points.extend(keyframe.points_b.iter().map(place));
            landmarks.lines.extend(keyframe.lines_b.iter().map(|ends| ends.each_ref().map(place)));
        }
        if let (Some(window), Some(estimate)) = (&self.last, estimate)
            && let Some(pose_m_o) = estimate.pose_m_o
            && estimate.reset_counter == window.reset_counter
        {
            let place = |p: &Vector3<f64>| (pose_m_o * Point3::from(*p)).coords.cast();
            landmarks.points.extend(window.points.iter().map(|point| place(&point.p_o)));
            landmarks.lines.extend(window.lines.iter().map(|line| line.ends_o.each_ref().map(place)));
        }
        landmarks
    }

    /// Corrections of the keyframes that the path has, in order of time.
    fn corrections(&self, path: &MapPath) -> Vec<Correction> {
        let corrected = path.poses.iter().filter_map(|at| {
            let key = (at.reset_counter, at.stamp);
            let place = self.keyframes.binary_search_by_key(&key, |k| (k.reset_counter, k.stamp)).ok()?;
            let pose_m_o = at.pose_m_b * self.keyframes[place].pose_o_b.inverse();
            Some(Correction { stamp: at.stamp, reset_counter: at.reset_counter, pose_m_o })
        });
        corrected.collect()
    }
}

/// Correction that is nearest in time to a keyframe, between the same resets.
fn nearest(corrections: &[Correction], keyframe: &Keyframe) -> Option<Isometry3<f64>> {
    let key = (keyframe.reset_counter, keyframe.stamp);
    let next = corrections.partition_point(|c| (c.reset_counter, c.stamp) < key);
    let around = [next.checked_sub(1).and_then(|k| corrections.get(k)), corrections.get(next)];
    let same = around.into_iter().flatten().filter(|c| c.reset_counter == keyframe.reset_counter);
    let by_distance = same.min_by_key(|c| c.stamp.nanos_since(keyframe.stamp).unsigned_abs());
    by_distance.map(|c| c.pose_m_o)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_estimator::places::mapper::path::PathPose;
    use plumbline_estimator::window::snapshot::{SnapshotLine, SnapshotPoint};

    fn stamp(k: i64) -> Timestamp {
        Timestamp::from_nanos(k)
    }

    /// Keyframes along x, each with a point above it and a line before it.
    fn snapshot(stamps: std::ops::Range<i64>, reset_counter: u32) -> MapSnapshot {
        let at = |k: i64, z: f64| Vector3::new(k as f64, 0.0, z);
        MapSnapshot {
            stamp: stamp(stamps.end),
            reset_counter,
            keyframes: stamps
                .clone()
                .map(|k| SnapshotKeyframe {
                    stamp: stamp(k),
                    pose_o_b: Isometry3::translation(k as f64, 0.0, 0.0),
                })
                .collect(),
            points: stamps.clone().map(|k| SnapshotPoint { host: stamp(k), p_o: at(k, 1.0) }).collect(),
            lines: stamps
                .map(|k| SnapshotLine { host: stamp(k), ends_o: [at(k, 2.0), at(k, 3.0)] })
                .collect(),
        }
    }

    fn path(poses: &[(i64, u32, Isometry3<f64>)]) -> MapPath {
        let mut path = MapPath::new(0);
        path.poses.extend(poses.iter().map(|(k, reset_counter, pose_m_b)| PathPose {
            stamp: stamp(*k),
            reset_counter: *reset_counter,
            pose_m_b: *pose_m_b,
        }));
        path
    }

    #[test]
    fn landmarks_move_with_the_keyframes_that_host_them() {
        let mut map = LandmarkMap::new(usize::MAX);
        map.update(snapshot(0..3, 0));
        map.update(snapshot(3..6, 0));
        map.update(snapshot(6..9, 0));
        // A loop has moved the second half by 10 m along y; keyframe 4 is not in the path.
        let pose = |k: i64, y: f64| (k, 0, Isometry3::translation(k as f64, y, 0.0));
        let landmarks = map.corrected(
            &path(&[pose(0, 0.0), pose(1, 0.0), pose(2, 0.0), pose(3, 10.0), pose(5, 10.0)]),
            None,
        );
        let y: Vec<f32> = landmarks.points.iter().map(|p| p.y).collect();
        assert_eq!(y, [0.0, 0.0, 0.0, 10.0, 10.0, 10.0]);
        assert_eq!(landmarks.points[4], Vector3::new(4.0, 10.0, 1.0));
        assert_eq!(landmarks.lines[4], [2.0, 3.0].map(|z| Vector3::new(4.0, 10.0, z)));
    }

    #[test]
    fn keyframes_before_a_reset_that_the_map_lacks_are_left_out() {
        let mut map = LandmarkMap::new(usize::MAX);
        map.update(snapshot(0..3, 0));
        map.update(snapshot(3..6, 1));
        map.update(snapshot(6..9, 1));
        let landmarks = map.corrected(&path(&[(3, 1, Isometry3::translation(3.0, 1.0, 0.0))]), None);
        assert_eq!(landmarks.points.len(), 3);
        assert!(landmarks.points.iter().all(|p| p.y == 1.0));
    }

    #[test]
    fn the_window_lies_where_the_newest_correction_puts_it() {
        let mut map = LandmarkMap::new(usize::MAX);
        map.update(snapshot(0..2, 1));
        let estimate = |reset_counter| MapEstimate {
            frame_sequence: 0,
            stamp: stamp(2),
            pose_m_o: Some(Isometry3::translation(0.0, 5.0, 0.0)),
            reset_counter,
            keyframes: 0,
            sightings: 0,
            loops_used: 0,
        };
        let landmarks = map.corrected(&path(&[]), Some(&estimate(1)));
        assert_eq!(landmarks.points, [0.0, 1.0].map(|x| Vector3::new(x, 5.0, 1.0)));
        assert_eq!(landmarks.lines.len(), 2);
        // A correction of the frame before a reset says nothing of this one.
        assert_eq!(map.corrected(&path(&[]), Some(&estimate(0))), MapLandmarks::default());
    }

    #[test]
    fn memory_is_bounded_and_the_oldest_go_first() {
        let mut map = LandmarkMap::new(1);
        for k in 0..MAX_KEYFRAMES as i64 + 100 {
            map.update(snapshot(k..k + 1, 0));
        }
        assert_eq!(map.keyframes.len(), MAX_KEYFRAMES);
        assert_eq!(map.keyframes.back().unwrap().stamp, stamp(MAX_KEYFRAMES as i64 + 98));
        assert!(map.landmarks <= MAX_LANDMARKS && map.landmarks == 2 * MAX_KEYFRAMES);
    }
}
