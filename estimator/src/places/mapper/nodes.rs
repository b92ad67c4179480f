//! Nodes of the graph and what belongs to them: how they come, are refined, and go.

use super::segment::Segment;
use super::{EXTRA_NODES, Mapper};
use crate::exchange::SolvedFrame;
use crate::places::graph::{Edge, Node};
use crate::places::line::MapLine;
use crate::window::snapshot::SnapshotKeyframe;
use nalgebra::{Isometry3, Matrix4};
use plumbline_config::Timestamp;

/// Distance at which segments that are not placed wait, far from everything, m.
const WAITING_ROOM_M: f64 = 1e6;

/// Data of a node of the graph.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeInfo {
    pub(super) stamp: Timestamp,
    pub(super) reset_counter: u32,
    /// Slot of the keyframe in the map.
    pub(super) slot: Option<usize>,
    pub(super) keyframe_id: u32,
    /// Pose in the odometry frame as it was first known: that of the causal trajectory.
    pub(super) first_pose_o_b: Isometry3<f64>,
}

impl Mapper {
    /// Adds a node, and the edge from the one before it.
    pub(super) fn add_node(
        &mut self,
        segment: &mut Segment,
        solved: &SolvedFrame,
        pose_o_b: &Isometry3<f64>,
    ) -> Option<usize> {
        let before = self.infos.len() - 1;
        let continues = self.infos[before].reset_counter == segment.reset_counter;
        self.make_room();
        let before = self.infos.len().checked_sub(1).filter(|_| continues);
        let waiting = Isometry3::translation(WAITING_ROOM_M, 0.0, 0.0);
        let pose_m_o = match before.filter(|_| segment.is_placed) {
            Some(before) => self.graph.nodes()[before].pose_m_o(),
            None if segment.is_placed => Isometry3::identity(),
            None => waiting,
        };
        let node = Node {
            segment: segment.number,
            is_placed: segment.is_placed,
            ..Node::new(*pose_o_b, &pose_m_o, before.is_none())
        };
        let info = NodeInfo {
            stamp: solved.stamp,
            reset_counter: segment.reset_counter,
            slot: None,
            keyframe_id: u32::MAX,
            first_pose_o_b: *pose_o_b,
        };
        let index = self.push_node(node, info)?;
        if let Some(before) = before {
            let information = segment.information_since_node(&self.graph.nodes()[before], pose_o_b);
            let edge = Edge::of_odometry(self.graph.nodes(), before, index, information);
            self.graph.add_sequential(edge);
        }
        segment.since_node = Matrix4::zeros();
        Some(index)
    }

    /// Takes over the improved poses that the window has of keyframes that are nodes.
    pub(super) fn refresh(&mut self, solved: &SolvedFrame) {
        for keyframe in &solved.keyframes {
            let known = self
                .infos
                .iter()
                .rposition(|i| i.stamp == keyframe.stamp && i.reset_counter == solved.reset_counter);
            if let Some(node) = known {
                self.graph.set_odometry(node, keyframe.pose_o_b);
                self.keep_lines(node, keyframe, solved);
            }
        }
    }

    /// The lines that a keyframe hosts, as the window knows them now.
    fn keep_lines(&mut self, node: usize, host: &SnapshotKeyframe, solved: &SolvedFrame) {
        let Some(slot) = self.infos[node].slot else { return };
        let Some(keyframe) = self.map.keyframe(slot) else { return };
        let pose_o_c = host.pose_o_b * keyframe.pose_b_c;
        let hosted = || solved.lines.iter().filter(|line| line.host == host.stamp);
        // The window forgets a line that is out of view, the map does not.
        if hosted().count() >= self.map.lines(slot).len() {
            self.map.set_lines(slot, hosted().map(|line| MapLine::new(&pose_o_c, &line.ends_o)));
        }
    }

    /// Takes out what was never found in the map.
    pub(super) fn forget_unplaced(&mut self) {
        while let Some(last) = self.graph.nodes().len().checked_sub(1)
            && !self.graph.nodes()[last].is_placed
        {
            if let Some(slot) = self.infos[last].slot {
                self.map.remove(slot);
            }
            self.remove_node(last);
        }
    }

    /// A full graph loses its oldest node that is no keyframe of the map, or else its oldest.
    fn make_room(&mut self) {
        if self.infos.len() < self.options.max_keyframes + EXTRA_NODES {
            return;
        }
        let without_view = (1..self.infos.len()).find(|&k| self.infos[k].slot.is_none());
        let gone = without_view.unwrap_or(1);
        if let Some(slot) = self.infos[gone].slot {
            self.map.remove(slot);
        }
        self.remove_node(gone);
    }

    pub(super) fn push_node(&mut self, node: Node, info: NodeInfo) -> Option<usize> {
        let index = self.graph.add_node(node)?;
        self.infos.push(info);
        Some(index)
    }

    pub(super) fn remove_node(&mut self, node: usize) {
        self.graph.remove_node(node);
        self.infos.remove(node);
    }

    /// The keyframes go where the graph has their nodes.
    pub(super) fn move_keyframes(&mut self) {
        for (node, info) in self.graph.nodes().iter().zip(&self.infos) {
            if let Some(slot) = info.slot {
                self.map.set_pose(slot, node.pose_m_b());
            }
        }
    }
}
