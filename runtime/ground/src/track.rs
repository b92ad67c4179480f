//! The path of a vehicle, and its poses, in bounded memory.

use super::history::History;
use nalgebra::{Isometry3, Vector3};
use std::fmt::Write as _;

/// Points of the path that are kept.
pub const MAX_POINTS: usize = 20_000;
/// Poses that are kept: half an hour at 20 Hz.
pub const MAX_POSES: usize = 36_000;
/// Points of the path are this far apart in time or in space.
const MIN_STEP_S: f64 = 0.2;
const MIN_STEP_M: f64 = 0.02;
/// Points of the past are this far in time from those that are here.
const FILL_STEP_S: f64 = 0.5;
/// A pose that is older than the newest point by less than this is late; by more, the clock was set back, s.
const LATE_S: f64 = 10.0;

/// One pose as it was received.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// Measurement time, ns.
    pub stamp_ns: i64,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
}

/// Poses in the TUM format: `t[s] x y z qx qy qz qw`.
pub fn tum(poses: &[PoseSample]) -> String {
    let mut text = String::new();
    for PoseSample { stamp_ns, pose_o_b } in poses {
        let (p, q) = (pose_o_b.translation.vector, pose_o_b.rotation.coords);
        let (s, ns) = (stamp_ns.div_euclid(1_000_000_000), stamp_ns.rem_euclid(1_000_000_000));
        let _ = writeln!(
            text,
            "{s}.{ns:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            p.x, p.y, p.z, q.x, q.y, q.z, q.w
        );
    }
    text
}

/// The path since the vehicle appeared, thinned for display.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Points of this epoch: time since the first, s, and x y z.
    pub points: History<[f64; 4]>,
    /// Counts how often the path was cleared.
    pub epoch: u64,
    start_ns: Option<i64>,
}

impl Track {
    /// Adds a position as a point when it is far enough from the last, in time or space.
    pub fn push(&mut self, stamp_ns: i64, p: &Vector3<f64>) {
        let start_ns = *self.start_ns.get_or_insert(stamp_ns);
        let t_s = stamp_ns.saturating_sub(start_ns) as f64 * 1e-9;
        if let Some([last_s, x, y, z]) = self.points.newest() {
            let step_m = (p - Vector3::new(*x, *y, *z)).norm();
            if (0.0..MIN_STEP_S).contains(&(t_s - last_s)) && step_m < MIN_STEP_M {
                return;
            }
            if t_s < *last_s {
                // Estimates and odometry come by different keys: after a silence an older one may be the first to come.
                if last_s - t_s < LATE_S {
                    return;
                }
                self.clear();
                return self.push(stamp_ns, p);
            }
        }
        self.points.push([t_s, p.x, p.y, p.z], MAX_POINTS);
    }

    /// Inserts points of the past, in order of time, where the path has none: before it, and in interruptions of the link.
    pub fn fill(&mut self, past: &[(i64, Vector3<f64>)]) {
        let (Some(start_ns), Some((oldest_ns, _))) = (self.start_ns, past.first()) else { return };
        let new_start_ns = start_ns.min(*oldest_ns);
        let shift_s = start_ns.saturating_sub(new_start_ns) as f64 * 1e-9;
        let mut points: Vec<_> = self.points.iter().map(|[t, x, y, z]| [t + shift_s, *x, *y, *z]).collect();
        let known = points.len();
        for (stamp_ns, p) in past {
            let t_s = stamp_ns.saturating_sub(new_start_ns) as f64 * 1e-9;
            let next = points[..known].partition_point(|[t, ..]| *t < t_s);
            let around = points[next.saturating_sub(1)..known.min(next + 1)].iter();
            if around.into_iter().all(|[t, ..]| (t - t_s).abs() >= FILL_STEP_S) {
                points.push([t_s, p.x, p.y, p.z]);
            }
        }
        if points.len() == known {
            return;
        }
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        self.epoch += 1;
        self.start_ns = Some(new_start_ns);
        self.points = History::of(points, MAX_POINTS);
    }

    /// Discards all points.
    pub fn clear(&mut self) {
        *self = Self { epoch: self.epoch + 1, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fly(track: &mut Track, seconds: std::ops::Range<i64>) {
        for k in seconds.start * 200..seconds.end * 200 {
            track.push(k * 5_000_000, &Vector3::new(k as f64 * 0.005, 0.0, 0.0));
        }
    }

    #[test]
    fn text_keeps_every_nanosecond() {
        let pose_o_b = Isometry3::translation(1.0, 0.5, -1.0);
        let text = tum(&[PoseSample { stamp_ns: 1_403_715_273_262_142_976, pose_o_b }; 2]);
        assert_eq!(text.lines().count(), 2);
        assert!(text.starts_with("1403715273.262142976 1.000000000 0.500000000 -1.000000000 0.0"), "{text}");
    }

    #[test]
    fn a_path_is_thinned_out_by_distance() {
        let mut track = Track::default();
        fly(&mut track, 0..10);
        assert!((400..=510).contains(&track.points.len()), "{}", track.points.len());
    }

    #[test]
    fn hours_do_not_grow() {
        let mut track = Track::default();
        fly(&mut track, 0..3_600);
        assert_eq!(track.points.len(), MAX_POINTS);
        assert_eq!(track.points.first(), track.points.total() - MAX_POINTS as u64);
    }

    #[test]
    fn the_past_goes_where_nothing_came() {
        let mut track = Track::default();
        fly(&mut track, 10..12);
        fly(&mut track, 20..22);
        let past: Vec<_> = (0..30).map(|k| (k * 1_000_000_000, Vector3::zeros())).collect();
        let count = track.points.len();
        track.fill(&past);
        // 10 seconds before, 7 between, 7 since.
        assert_eq!((track.points.len(), track.epoch), (count + 24, 1));
        let times: Vec<f64> = track.points.iter().map(|p| p[0]).collect();
        assert!(times.is_sorted());
        track.fill(&past);
        assert_eq!((track.points.len(), track.epoch), (count + 24, 1), "a second time nothing is missing");
    }

    #[test]
    fn time_that_goes_back_begins_a_new_path() {
        let mut track = Track::default();
        fly(&mut track, 10..12);
        fly(&mut track, 0..1);
        assert_eq!(track.epoch, 1);
    }

    #[test]
    fn a_pose_that_comes_late_leaves_the_path_whole() {
        let mut track = Track::default();
        fly(&mut track, 0..12);
        let points = track.points.len();
        fly(&mut track, 8..9);
        assert_eq!((track.points.len(), track.epoch), (points, 0));
    }
}
