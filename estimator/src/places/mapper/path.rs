//! The corrected path of a flight, as far as it is known: what is shown of the map to people.

use super::Mapper;
use crate::places::graph::{EdgeKind, Node};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_fields::Record;

/// A keyframe on the corrected path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("PathPose")]
pub struct PathPose {
    /// Time of the pose.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Resets of the odometry up to then: poses of one count are joined by unbroken odometry.
    #[field(2)]
    pub reset_counter: u32,
    /// Pose of the body in the map.
    #[field(3, single)]
    pub pose_m_b: Isometry3<f64>,
}

/// One end of a loop: a keyframe of this flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("LoopEnd")]
pub struct LoopEnd {
    /// Time of the end.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Position of the body in the map, m.
    #[field(2, wire = "position_m", single)]
    pub p_m_b: Vector3<f64>,
}

/// A place that was seen again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("Loop")]
pub struct LoopEnds {
    /// The keyframe that was seen again.
    #[field(1)]
    pub seen: LoopEnd,
    /// The keyframe that saw it.
    #[field(2)]
    pub seen_by: LoopEnd,
}

/// The corrected path with its loops.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Path")]
pub struct MapPath {
    /// Keyframes whose place in the map is known, oldest first; evenly thinned out to the limit.
    #[field(1, most = 2_000)]
    pub poses: Vec<PathPose>,
    /// The newest loops that count, between keyframes of this flight: the one that was seen again, and the one that saw it.
    #[field(2, most = 2_000)]
    pub loops: Vec<LoopEnds>,
    /// Distance between the odometry's position of the newest keyframe and that in the map, counted from the
    /// beginning of its piece of unbroken odometry, m. Absent where its place in the map is not known.
    #[field(3)]
    pub drift_m: Option<f64>,
    #[field(none)]
    limit: usize,
}

impl MapPath {
    /// With room for so many poses, and so many loops.
    #[must_use]
    pub fn new(limit: usize) -> Self {
        Self { poses: Vec::with_capacity(limit), loops: Vec::with_capacity(limit), drift_m: None, limit }
    }
}

impl Mapper {
    /// Copies the corrected path as it is now. Allocates nothing.
    pub fn copy_path(&self, path: &mut MapPath) {
        let MapPath { poses, loops, drift_m, limit } = path;
        poses.clear();
        loops.clear();
        *drift_m = self.drift_m();
        let nodes =
            || self.graph.nodes().iter().zip(&self.infos).filter(|(n, i)| n.is_placed && is_flown(i.stamp));
        let known = nodes().count();
        let kept = known.min(*limit);
        for (at, (node, info)) in nodes().enumerate() {
            // The newest is always among them.
            if poses.len() < kept && (at + 1) * kept >= (poses.len() + 1) * known {
                let (stamp, reset_counter) = (info.stamp, info.reset_counter);
                poses.push(PathPose { stamp, reset_counter, pose_m_b: node.pose_m_b() });
            }
        }
        let counting = || {
            let loops = self.graph.edges().iter().filter(|e| e.kind != EdgeKind::Sequential);
            loops.filter(|e| e.counts()).filter_map(|e| {
                Some(LoopEnds { seen: self.loop_end(e.from)?, seen_by: self.loop_end(e.to)? })
            })
        };
        let too_many = counting().count().saturating_sub(*limit);
        loops.extend(counting().skip(too_many));
    }

    /// The end of a loop at a node; `None` where that is the origin, on which keyframes of a loaded map hang.
    fn loop_end(&self, node: usize) -> Option<LoopEnd> {
        let (node, info) = self.graph.nodes().get(node).zip(self.infos.get(node))?;
        is_flown(info.stamp).then_some(LoopEnd { stamp: info.stamp, p_m_b: node.p_m_b })
    }

    /// See [`MapPath::drift_m`].
    fn drift_m(&self) -> Option<f64> {
        let flown =
            || self.graph.nodes().iter().zip(&self.infos).filter(|(_, i)| is_flown(i.stamp)).map(|(n, _)| n);
        let newest = flown().next_back().filter(|n| n.is_placed)?;
        let first = flown().find(|n| n.segment == newest.segment)?;
        Some(drift_m(first, newest))
    }
}

/// True if a node is a keyframe of this flight, not the origin of the map.
fn is_flown(stamp: Timestamp) -> bool {
    stamp != Timestamp::MIN
}

/// Distance between where the odometry takes the vehicle from `first`, and where the map has `newest`, m.
fn drift_m(first: &Node, newest: &Node) -> f64 {
    let by_odometry = first.pose_m_o() * newest.pose_o_b;
    (by_odometry.translation.vector - newest.p_m_b).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::graph::Edge;
    use crate::places::mapper::nodes::NodeInfo;
    use nalgebra::Matrix4;
    use plumbline_config::Config;

    /// A flight along x, with so many keyframes a metre apart, that the odometry takes for 1.01 m.
    fn flown(keyframes: usize) -> Mapper {
        let config = Config::preset("sim").unwrap();
        let mut mapper = Mapper::new(config.setup(), None);
        for k in 0..keyframes {
            let pose_o_b = Isometry3::translation(1.01 * k as f64, 0.0, 0.0);
            let stamp = Timestamp::from_nanos(k as i64);
            let info = NodeInfo {
                stamp,
                reset_counter: 0,
                slot: None,
                keyframe_id: k as u32,
                first_pose_o_b: pose_o_b,
            };
            let node = mapper.push_node(Node::new(pose_o_b, &Isometry3::identity(), k == 0), info).unwrap();
            if k > 0 {
                let edge = Edge::of_odometry(mapper.graph.nodes(), node - 1, node, Matrix4::identity() * 1e2);
                mapper.graph.add_sequential(edge);
            }
        }
        mapper
    }

    fn path_of(mapper: &Mapper, limit: usize) -> MapPath {
        let mut path = MapPath::new(limit);
        mapper.copy_path(&mut path);
        path
    }

    fn stamps(path: &MapPath) -> Vec<i64> {
        path.poses.iter().map(|at| at.stamp.as_nanos()).collect()
    }

    #[test]
    fn a_path_is_thinned_out_evenly_and_ends_with_the_newest() {
        assert_eq!(stamps(&path_of(&flown(4), 10)), [0, 1, 2, 3]);
        assert_eq!(stamps(&path_of(&flown(10), 5)), [1, 3, 5, 7, 9]);
        assert_eq!(stamps(&path_of(&flown(7), 3)), [2, 4, 6]);
        assert!(path_of(&flown(3), 0).poses.is_empty());
    }

    #[test]
    fn without_a_keyframe_nothing_is_known() {
        let path = path_of(&flown(0), 10);
        assert_eq!((path.poses.len(), path.loops.len(), path.drift_m), (0, 0, None));
    }

    #[test]
    fn loops_that_count_are_told_with_the_drift_they_take_out() {
        let mut mapper = flown(11);
        assert_eq!(path_of(&mapper, 20).drift_m, Some(0.0));
        // The last two keyframes are located against the first ones, and the last against a loaded map too.
        let information = Matrix4::identity() * 1e6;
        for (from, to, way_m) in [(1, 11, 10.0), (2, 10, 8.0), (0, 11, 10.0)] {
            let edge = Edge::of_loop(
                mapper.graph.nodes(),
                (from, to),
                &Isometry3::translation(way_m, 0.0, 0.0),
                information,
            );
            mapper.graph.add_loop(edge, true).unwrap();
        }
        mapper.graph.optimize(500);
        let path = path_of(&mapper, 20);
        let stamps = |l: &LoopEnds| [l.seen.stamp, l.seen_by.stamp].map(Timestamp::as_nanos);
        let ends: Vec<_> = path.loops.iter().map(stamps).collect();
        assert_eq!(ends, [[0, 10], [1, 9]], "what hangs on the origin is no keyframe of the flight");
        assert!((path.loops[0].seen_by.p_m_b.x - 10.0).abs() < 0.01, "{path:?}");
        assert!((path.drift_m.unwrap() - 0.1).abs() < 0.01, "{path:?}");
        assert_eq!(path_of(&mapper, 1).loops, path.loops[1..], "the newest are kept");
    }

    #[test]
    fn copying_again_allocates_nothing() {
        let mapper = flown(8);
        let mut path = MapPath::new(5);
        let memory = path.poses.as_ptr();
        for _ in 0..3 {
            mapper.copy_path(&mut path);
        }
        assert_eq!((path.poses.as_ptr(), path.poses.len()), (memory, 5));
    }
}
