//! Consistency of two loops: with the odometry between their ends they form a cycle, which must close within
//! the drift of the odometry.

use super::edge::{DRIFT_M, DRIFT_RAD, Edge, Node, turn, wrapped};
use nalgebra::Vector3;

/// Errors of both loops together count as this many of their standard deviations.
const DEVIATIONS: f64 = 3.5;
/// Loops whose ends are nearer than this to each other say the same thing of one view, not two things: m.
const MIN_APART_M: f64 = 0.1;

/// True if two loops agree. Loops closed from nearly the same place do not support each other: one deception
/// explains both. Nor do loops whose ends no odometry joins.
#[must_use]
pub fn agree(nodes: &[Node], a: &Edge, b: &Edge) -> bool {
    let is_joined = |i: usize, j: usize| {
        nodes[i].segment == nodes[j].segment || (nodes[i].is_placed && nodes[j].is_placed)
    };
    if !is_joined(a.from, b.from) || !is_joined(a.to, b.to) {
        return false;
    }
    let (old_way, old_turn) = nodes[a.from].way_to(&nodes[b.from]);
    let (new_way, new_turn) = nodes[a.to].way_to(&nodes[b.to]);
    if new_way.norm() < MIN_APART_M {
        return false;
    }
    // The way of `b` as `a` has it: back along the old flight, over the loop, along the new flight. In the odometry frame
    // of the old end of `a`; that of its new end is turned by the loop.
    let way: Vector3<f64> = turn(-old_turn) * (-old_way + a.way + turn(a.turn) * new_way);
    let turned = wrapped(a.turn + new_turn - old_turn - b.turn);
    let (Some(of_a), Some(of_b)) = (a.known_way(), b.known_way()) else { return false };
    let covariance = of_a.covariance + of_b.covariance;
    let length = old_way.norm() + new_way.norm();
    let sigma_yaw = (covariance[(3, 3)] + DRIFT_RAD * DRIFT_RAD * length).sqrt();
    let position = covariance[(0, 0)] + covariance[(1, 1)] + covariance[(2, 2)];
    let lever = sigma_yaw * new_way.norm();
    let sigma_position = (position + DRIFT_M * DRIFT_M * length + lever * lever).sqrt();
    (way - b.way).norm() <= DEVIATIONS * sigma_position && turned.abs() <= DEVIATIONS * sigma_yaw
}
