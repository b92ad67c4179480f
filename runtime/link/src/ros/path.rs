//! The path of the vehicle since its last reset, in bounded memory: when it is full every second pose goes, and poses are
//! taken half as often.

use super::frames::RosFrames;
use super::messages::{Header, Path, PoseStamped, Time};
use nalgebra::Isometry3;
use plumbline_config::Timestamp;
use plumbline_estimator::Odometry;

/// Smallest time between two poses, ns.
const FINEST_NS: i64 = 100_000_000;

/// Poses of the body in the odometry frame, evenly spaced in time.
#[derive(Clone, Debug)]
pub struct PathHistory {
    limit: usize,
    spacing_ns: i64,
    reset_counter: u32,
    poses: Vec<(Timestamp, Isometry3<f64>)>,
}

impl PathHistory {
    /// Creates an empty path of at most `limit` poses.
    pub fn new(limit: usize) -> Self {
        let limit = limit.max(2);
        Self { limit, spacing_ns: FINEST_NS, reset_counter: 0, poses: Vec::with_capacity(limit + 1) }
    }

    /// Takes a pose, if it is due. A reset, and a clock that was set back, start another path.
    pub fn follow(&mut self, o: &Odometry) {
        let newest = self.poses.last().map(|(stamp, _)| *stamp);
        if o.reset_counter != self.reset_counter || newest.is_some_and(|newest| o.stamp < newest) {
            self.poses.clear();
            (self.spacing_ns, self.reset_counter) = (FINEST_NS, o.reset_counter);
        }
        let newest = self.poses.last().map(|(stamp, _)| *stamp);
        if newest.is_some_and(|newest| o.stamp.nanos_since(newest) < self.spacing_ns) {
            return;
        }
        self.poses.push((o.stamp, o.pose_o_b));
        if self.poses.len() > self.limit {
            let mut place = 0;
            self.poses.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.spacing_ns *= 2;
        }
    }

    /// Poses with their stamps, oldest first.
    pub fn poses(&self) -> &[(Timestamp, Isometry3<f64>)] {
        &self.poses
    }
}

/// Path of the vehicle from poses of the body, each with its stamp. `time` gives stamps as headers have them.
pub fn message<'a>(
    frames: &RosFrames<'a>,
    poses: &[(Timestamp, Isometry3<f64>)],
    time: impl Fn(Timestamp) -> Time,
) -> Path<'a> {
    let frame_id = frames.odom;
    let stamped = |(stamp, pose_b): &(Timestamp, Isometry3<f64>)| PoseStamped {
        header: Header { stamp: time(*stamp), frame_id },
        pose: frames.vehicle(pose_b).into(),
    };
    let poses: Vec<_> = poses.iter().map(stamped).collect();
    let stamp = poses.last().map_or_else(|| Time::from_nanos(0), |newest| newest.header.stamp);
    Path { header: Header { stamp, frame_id }, poses }
}

#[cfg(test)]
mod tests {
    use super::super::frames::tests::odometry;
    use super::*;

    fn flown(path: &mut PathHistory, seconds: std::ops::Range<i64>, reset_counter: u32) {
        for k in seconds.start * 200..seconds.end * 200 {
            let stamp = Timestamp::from_nanos(k * 5_000_000);
            path.follow(&Odometry { stamp, reset_counter, ..odometry() });
        }
    }

    #[test]
    fn holds_the_whole_flight_in_bounded_memory() {
        let mut path = PathHistory::new(100);
        flown(&mut path, 0..5, 0);
        assert_eq!(path.poses().len(), 50);
        flown(&mut path, 5..100, 0);
        let stamps: Vec<i64> = path.poses().iter().map(|(stamp, _)| stamp.as_nanos()).collect();
        assert!((50..=100).contains(&stamps.len()), "{}", stamps.len());
        assert_eq!(stamps[0], 0);
        assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == stamps[1] - stamps[0]), "{stamps:?}");
        assert!(*stamps.last().unwrap() > 98_000_000_000);
    }
}
