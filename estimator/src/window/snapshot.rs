//! Snapshot of the window's keyframes and landmarks, for maps and for people. No estimate depends on it.

use super::Window;
use super::feature::Feature;
use super::landmark::{Landmark, LineLandmark, PointLandmark};
use crate::estimate::Estimate;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use plumbline_config::{Timestamp, ValidSetup};
use plumbline_fields::Record;

/// Landmarks further from their host than this are directions rather than places, m.
const FARTHEST_M: f64 = 100.0;

/// A keyframe. Its measurement time names it: no two frames share one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("WindowKeyframe")]
pub struct SnapshotKeyframe {
    /// When it was taken, on the IMU's time axis.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    #[field(2)]
    pub pose_o_b: Isometry3<f64>,
}

/// A point landmark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("WindowPoint")]
pub struct SnapshotPoint {
    /// Stamp of the keyframe that hosts it.
    #[field(1, wire = "host_ns")]
    pub host: Timestamp,
    /// Where it is in the odometry frame, m.
    #[field(2, wire = "position_o", single)]
    pub p_o: Vector3<f64>,
}

/// A line landmark, cut off where its host saw it end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("WindowLine")]
pub struct SnapshotLine {
    /// Stamp of the keyframe that hosts it.
    #[field(1, wire = "host_ns")]
    pub host: Timestamp,
    /// Both ends in the odometry frame, m.
    #[field(2, single)]
    pub ends_o: [Vector3<f64>; 2],
}

/// Keyframes and landmarks of the window after one frame, oldest first; on the key `map/keyframe` a keyframe that has left it, with its
/// own landmarks as last estimated, which never changes again.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Window")]
pub struct MapSnapshot {
    /// Time of the newest frame.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Resets so far.
    #[field(2)]
    pub reset_counter: u32,
    /// Keyframes.
    #[field(3, most = 64)]
    pub keyframes: Vec<SnapshotKeyframe>,
    /// Points with a depth.
    #[field(4, most = 10_000)]
    pub points: Vec<SnapshotPoint>,
    /// Lines with a place.
    #[field(5, most = 5_000)]
    pub lines: Vec<SnapshotLine>,
}

impl MapSnapshot {
    /// An empty one, with room for any window of the configuration.
    #[must_use]
    pub fn new(config: &ValidSetup) -> Self {
        let window = &config.estimator.window;
        Self {
            keyframes: Vec::with_capacity(super::MAX_FRAMES),
            points: Vec::with_capacity(window.max_landmarks),
            lines: Vec::with_capacity(config.estimator.lines.max_landmarks),
            ..Self::default()
        }
    }
}

/// The camera that hosts a landmark.
struct Host {
    stamp: Timestamp,
    pose_o_c: Isometry3<f64>,
}

impl Host {
    /// The host of a landmark that has a depth.
    fn of<F: Feature>(window: &Window, landmark: &Landmark<F>) -> Option<Self> {
        let frame = window.frames.get(usize::from(landmark.host)).filter(|_| landmark.is_triangulated)?;
        let pose_b_c = window.rig.pose_b_c(usize::from(landmark.host_camera));
        Some(Self { stamp: frame.stamp, pose_o_c: frame.pose_at_stamp() * pose_b_c })
    }

    /// The place that lies `depth_m` along the optical axis where the host sees `xy`.
    fn place(&self, xy: &Vector2<f64>, depth_m: f64) -> Option<Vector3<f64>> {
        let is_place = depth_m > 0.0 && depth_m < FARTHEST_M;
        is_place.then(|| (self.pose_o_c * Point3::from(Vector3::new(xy.x, xy.y, 1.0) * depth_m)).coords)
    }
}

impl Window {
    /// Writes down the keyframes and landmarks; allocates nothing in a snapshot made for the configuration.
    pub fn snapshot(&self, estimate: &Estimate, snapshot: &mut MapSnapshot) {
        snapshot.stamp = estimate.stamp;
        snapshot.reset_counter = estimate.reset_counter;
        snapshot.keyframes.clear();
        let keyframes = self.frames.iter().filter(|f| f.is_keyframe);
        snapshot
            .keyframes
            .extend(keyframes.map(|f| SnapshotKeyframe { stamp: f.stamp, pose_o_b: f.pose_at_stamp() }));
        snapshot.points.clear();
        snapshot.points.extend(self.points.all().iter().filter_map(|l| self.place_of_point(l)));
        snapshot.lines.clear();
        snapshot.lines.extend(self.snapshot_lines());
    }

    /// The lines that have a place, as they are known now.
    pub(crate) fn snapshot_lines(&self) -> impl Iterator<Item = SnapshotLine> {
        self.lines.all().iter().filter_map(|l| self.place_of_line(l))
    }

    fn place_of_point(&self, landmark: &PointLandmark) -> Option<SnapshotPoint> {
        let host = Host::of(self, landmark)?;
        let p_o = host.place(&landmark.feature.xy, 1.0 / landmark.feature.rho)?;
        Some(SnapshotPoint { host: host.stamp, p_o })
    }

    fn place_of_line(&self, landmark: &LineLandmark) -> Option<SnapshotLine> {
        let host = Host::of(self, landmark)?;
        let seen = landmark
            .observations
            .iter()
            .find(|o| o.frame == landmark.host && o.camera == landmark.host_camera)?;
        let [a, b] = seen.measured.ends_xy.map(|xy| host.place(&xy, landmark.feature.depth_at(&xy)));
        Some(SnapshotLine { host: host.stamp, ends_o: [a?, b?] })
    }
}
