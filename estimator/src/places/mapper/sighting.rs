//! A place seen again becomes an edge of the graph, and places a segment of which nothing was known.

use super::nodes::NodeInfo;
use super::segment::Segment;
use super::{Mapper, Sighting};
use crate::places::graph::edge::{turn, yaw_of};
use crate::places::graph::{Edge, LoopRefused, Node};
use crate::places::locate::Located;
use crate::places::map::view_distance_within;
use nalgebra::{Isometry3, Matrix4, SMatrix, UnitQuaternion, Vector3};

/// Inliers, before guiding and in all, with which a sighting is beyond doubt: it needs no other to agree with it.
const BEYOND_DOUBT: (usize, usize) = (40, 70);
/// The node at the origin of the map.
const ORIGIN: usize = 0;

impl Mapper {
    /// Adds the edge from the keyframe that was seen again to `node`; `false` when the odometry speaks against it.
    pub(super) fn add_loop(&mut self, segment: &mut Segment, node: usize, located: &Located) -> bool {
        let seen = self.infos.iter().position(|i: &NodeInfo| i.keyframe_id == located.keyframe_id);
        let from = seen.unwrap_or(ORIGIN);
        let pose_m_from = self.graph.nodes()[from].pose_m_b();
        let pose_from_b = pose_m_from.inverse() * located.pose_m_b;
        let Some(information) = information(located, &self.graph.nodes()[from]) else { return false };
        let edge = Edge::of_loop(self.graph.nodes(), (from, node), &pose_from_b, information);
        let is_beyond_doubt = located.first_inliers >= BEYOND_DOUBT.0 && located.inliers >= BEYOND_DOUBT.1;
        let added = self.graph.add_loop(edge, is_beyond_doubt);
        if added.is_err() || segment.is_placed {
            return added != Err(LoopRefused::Contradicted);
        }
        let is_believed = self.graph.edges().last().is_some_and(Edge::is_supported);
        if is_believed {
            let pose_o_b = self.graph.nodes()[node].pose_o_b;
            self.graph.place_segment(segment.number, &upright(&located.pose_m_b, &pose_o_b));
            segment.is_placed = true;
            self.move_keyframes();
        }
        true
    }

    pub(super) fn sighting_of(&self, found: &Located) -> Sighting {
        let seen = self.map.keyframes().find(|(_, k)| k.id == found.keyframe_id).map(|(_, k)| k);
        let pose_m_k = seen.map_or_else(Isometry3::identity, |k| k.pose_m_b);
        Sighting {
            keyframe_stamp: seen.map(|k| k.stamp).unwrap_or_default(),
            pose_k_b: pose_m_k.inverse() * found.pose_m_b,
        }
    }

    /// True if the map has nearly the same view from where a frame was located.
    pub(super) fn has_view(&self, found: &Located, pose_b_c: &Isometry3<f64>) -> bool {
        let seen = self.map.keyframes().find(|(_, k)| k.id == found.keyframe_id);
        let here = found.pose_m_b * pose_b_c;
        seen.is_some_and(|(_, seen)| {
            view_distance_within(&seen.pose_m_c(), &here, self.options.spacing_m).is_some()
        })
    }
}

/// Pose of the odometry frame in the map, a turn about the vertical and a shift, when the body of `pose_o_b` is at
/// `pose_m_b`.
fn upright(pose_m_b: &Isometry3<f64>, pose_o_b: &Isometry3<f64>) -> Isometry3<f64> {
    let rotation: UnitQuaternion<f64> = turn(yaw_of(&(pose_m_b.rotation * pose_o_b.rotation.inverse())));
    let shift = pose_m_b.translation.vector - rotation * pose_o_b.translation.vector;
    Isometry3::from_parts(shift.into(), rotation)
}

/// Information about way and turn, in the odometry frame of `from`, from the covariance of the pose found.
fn information(located: &Located, from: &Node) -> Option<Matrix4<f64>> {
    let back = turn(-from.yaw).to_rotation_matrix();
    let mut by_pose = SMatrix::<f64, 4, 6>::zeros();
    by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(back.matrix());
    let heading = located.pose_m_b.rotation.inverse() * Vector3::z();
    by_pose.fixed_view_mut::<1, 3>(3, 3).copy_from(&heading.transpose());
    let covariance = by_pose * located.covariance * by_pose.transpose();
    covariance.cholesky().map(|c| c.inverse())
}
