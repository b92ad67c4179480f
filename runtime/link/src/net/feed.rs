//! Records of a flight on their way to the tasks that send them. Nothing blocks.

use super::pace::Pace;
use super::rings::Rings;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{Estimate, MapSnapshot, Odometry};
use plumbline_flight::local::{SensorNews, Shot};
use plumbline_flight::schedule::lane::LaneWriter;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

/// Fills the rings of a publisher.
#[derive(Debug)]
pub struct Feed {
    pub(super) rings: Arc<Rings>,
    pub(super) odometry: LaneWriter<(Odometry, i64)>,
    pub(super) estimates: LaneWriter<(Estimate, f64)>,
    pub(super) places: LaneWriter<MapEstimate>,
    /// Poses, and loops, of a path at most.
    pub(super) path_poses: usize,
    /// Rate of pictures: the flight makes as many as its fastest watcher wants.
    pub(super) pictures: Pace,
}

impl Feed {
    /// Takes odometry that the run handed over at this time, ns since 1970.
    pub fn odometry(&mut self, odometry: Odometry, handed_over_ns: i64) {
        self.odometry.push((odometry, handed_over_ns));
        self.rings.odometry_bell.ring();
    }

    /// Takes an estimate, and the computation of its frame, ms.
    pub fn estimate(&mut self, estimate: Estimate, frame_ms: f64) {
        self.estimates.push((estimate, frame_ms));
        self.rings.bell.ring();
    }

    /// Takes the pose of the odometry frame in the map.
    pub fn map_estimate(&mut self, estimate: MapEstimate) {
        self.places.push(estimate);
    }

    /// Takes what the window holds.
    pub fn window(&self, snapshot: MapSnapshot) {
        self.rings.snapshots.fill(|waiting| *waiting = snapshot);
        self.rings.bell.ring();
    }

    /// Takes the corrected path, thinned out to what the link can carry.
    pub fn path(&self, mut path: MapPath) {
        thin_out(&mut path, self.path_poses);
        self.rings.paths.fill(|waiting| *waiting = path);
        self.rings.bell.ring();
    }

    /// Takes a picture, if it is due.
    pub fn picture(&mut self, shot: Shot) {
        if !self.pictures.admits(shot.stamp) {
            return;
        }
        self.rings.shots.fill(|waiting| *waiting = shot);
        self.rings.picture_bell.ring();
    }

    /// Takes the rung of the degradation ladder.
    pub fn rung(&self, level: u8) {
        self.rings.rung.store(level, Ordering::Relaxed);
    }

    /// Takes the state of live sensors.
    pub fn sensors(&self, news: SensorNews) {
        *self.rings.sensors.lock().unwrap_or_else(PoisonError::into_inner) = news;
        self.rings.bell.ring();
    }

    /// Takes the count of records that the flight has dropped.
    pub fn lost(&self, count: u64) {
        self.rings.lost_before.store(count, Ordering::Relaxed);
    }
}

/// Keeps at most `limit` poses, evenly spread, the newest among them, and as many of the newest loops.
fn thin_out(path: &mut MapPath, limit: usize) {
    let known = path.poses.len();
    let (kept, mut at, mut taken) = (known.min(limit), 0, 0);
    path.poses.retain(|_| {
        at += 1;
        let is_taken = taken < kept && at * kept >= (taken + 1) * known;
        taken += usize::from(is_taken);
        is_taken
    });
    path.loops.drain(..path.loops.len().saturating_sub(limit));
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use plumbline_config::Timestamp;
    use plumbline_estimator::places::mapper::path::PathPose;

    #[test]
    fn a_path_is_thinned_evenly_and_keeps_its_newest_pose() {
        let mut path = MapPath::new(0);
        path.poses.extend((0..10).map(|k| PathPose {
            stamp: Timestamp::from_nanos(k),
            reset_counter: 0,
            pose_m_b: Isometry3::identity(),
        }));
        thin_out(&mut path, 4);
        let stamps: Vec<_> = path.poses.iter().map(|pose| pose.stamp.as_nanos()).collect();
        assert_eq!(stamps, [2, 4, 7, 9]);
        thin_out(&mut path, 100);
        assert_eq!(path.poses.len(), 4);
    }
}
