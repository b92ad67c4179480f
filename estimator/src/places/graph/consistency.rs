//! Consistency of two loops: with the odometry between their ends they form a cycle, which must close within
//! the drift of the odometry.

use super::edge::{Edge, Node, turn, wrapped};
use nalgebra::Vector3;

/// Drift of the odometry, m per root of a metre of path.
const DRIFT_M: f64 = 0.02;
/// Drift of the odometry's heading, rad per root of a metre of way.
const DRIFT_RAD: f64 = 0.002;
/// Errors of both loops together count as this many of their standard deviations.
const DEVIATIONS: f64 = 3.5;
/// Loops whose ends are nearer than this to each other say the same thing of one view, not two things: m.
const MIN_APART_M: f64 = 0.1;

/// From one node to another, as the graph has it.
struct Between {
    /// In the odometry frame of the first, m.
    way: Vector3<f64>,
    /// Yaw of the second's odometry frame relative to that of the first, rad.
    turn: f64,
}

impl Between {
    fn new(from: &Node, to: &Node) -> Self {
        Self { way: turn(-from.yaw) * (to.p_m_b - from.p_m_b), turn: wrapped(to.yaw - from.yaw) }
    }
}

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
    let old = Between::new(&nodes[a.from], &nodes[b.from]);
    let new = Between::new(&nodes[a.to], &nodes[b.to]);
    if new.way.norm() < MIN_APART_M {
        return false;
    }
    // The way of `b` as `a` has it: back along the old flight, over the loop, along the new flight. In the odometry frame
    // of the old end of `a`; that of its new end is turned by the loop.
    let way: Vector3<f64> = turn(-old.turn) * (-old.way + a.way + turn(a.turn) * new.way);
    let turned = wrapped(a.turn + new.turn - old.turn - b.turn);
    let length = old.way.norm() + new.way.norm();
    let sigma = |k: usize| {
        let of = |e: &Edge| e.information.cholesky().map_or(f64::INFINITY, |c| c.inverse()[(k, k)]);
        of(a) + of(b)
    };
    let sigma_yaw = (sigma(3) + DRIFT_RAD * DRIFT_RAD * length).sqrt();
    let position = [0, 1, 2].map(sigma).iter().sum::<f64>();
    let lever = sigma_yaw * new.way.norm();
    let sigma_position = (position + DRIFT_M * DRIFT_M * length + lever * lever).sqrt();
    (way - b.way).norm() <= DEVIATIONS * sigma_position && turned.abs() <= DEVIATIONS * sigma_yaw
}
