//! A piece of unbroken odometry, and what the window knows of the way since its last node.

use crate::exchange::SolvedFrame;
use crate::places::graph::Node;
use crate::places::graph::edge::{DRIFT_M, DRIFT_RAD, chained};
use nalgebra::{Isometry3, Matrix4, Vector4};
use plumbline_config::{Portable, Timestamp};

/// Least error of a way of which the window gave none, m and rad.
const LEAST: (f64, f64) = (0.005, 0.001);

/// The segment that is being flown.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub(super) number: u32,
    pub(super) reset_counter: u32,
    pub(super) is_placed: bool,
    /// Covariance of the odometry since the last node, and the keyframe up to which it reaches.
    pub(super) since_node: Matrix4<f64>,
    pub(super) known_until: Timestamp,
}

impl Segment {
    /// Carries the covariance since the last node over the newest keyframe.
    pub(super) fn follow(&mut self, solved: &SolvedFrame) {
        let Some(step) = solved.steps.last().filter(|s| s.to == solved.stamp && s.from == self.known_until)
        else {
            if solved.is_keyframe {
                self.known_until = solved.stamp;
            }
            return;
        };
        let pose_at = |stamp| solved.keyframes.iter().find(|k| k.stamp == stamp).map(|k| k.pose_o_b);
        if let (Some(from), Some(to)) = (pose_at(step.from), pose_at(step.to)) {
            let way = to.translation.vector - from.translation.vector;
            self.since_node = chained(&self.since_node, &way, &step.covariance);
        }
        self.known_until = solved.stamp;
    }

    /// Information about the way since the node before; at least as uncertain as odometry is at best.
    pub(super) fn information_since_node(&self, before: &Node, pose_o_b: &Isometry3<f64>) -> Matrix4<f64> {
        if let Some(known) = self.since_node.cholesky() {
            return known.inverse();
        }
        let length = (pose_o_b.translation.vector - before.pose_o_b.translation.vector).norm();
        let information = |least: f64, per_root: f64| 1.0 / (least + per_root * length.sqrt()).squared();
        let (position, heading) = (information(LEAST.0, DRIFT_M), information(LEAST.1, DRIFT_RAD));
        Matrix4::from_diagonal(&Vector4::new(position, position, position, heading))
    }
}
