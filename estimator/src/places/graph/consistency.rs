//! Whether two loops can both be true: with the odometry between their ends they make a circle, and the way around it
//! must end where it began, as far as the odometry may have drifted on it.

use super::edge::{Edge, Node, turn, wrapped};
use nalgebra::Vector3;

/// What odometry drifts by, m per root of a metre of way.
const DRIFT_M: f64 = 0.02;
/// The same of the heading, rad per root of a metre of way.
const DRIFT_RAD: f64 = 0.002;
/// Errors of both loops together count as this many of their standard deviations.
const DEVIATIONS: f64 = 3.5;
/// Loops whose ends are nearer than this to each other say the same thing of one view, not two things: m.
const MIN_APART_M: f64 = 0.1;

/// Whether two loops agree. Two that were closed from nearly one place do not support each other: what deceived the one
/// deceives the other.
#[must_use]
pub fn agree(nodes: &[Node], a: &Edge, b: &Edge) -> bool {
    let between =
        |i: usize, j: usize| nodes[j].pose_o_b.translation.vector - nodes[i].pose_o_b.translation.vector;
    let (old, new) = (between(a.from, b.from), between(a.to, b.to));
    if new.norm() < MIN_APART_M {
        return false;
    }
    // The way of `b` as `a` has it: back along the old flight, over the loop, along the new flight. Ways and turns are
    // in the odometry frame of the old end; that of the new end is turned by the loop.
    let way: Vector3<f64> = -old + a.way + turn(a.turn) * new;
    let length = old.norm() + new.norm();
    let sigma = |k: usize| {
        let of = |e: &Edge| e.information.cholesky().map_or(f64::INFINITY, |c| c.inverse()[(k, k)]);
        of(a) + of(b)
    };
    let sigma_yaw = (sigma(3) + DRIFT_RAD * DRIFT_RAD * length).sqrt();
    let position = [0, 1, 2].map(sigma).iter().sum::<f64>();
    let lever = sigma_yaw * new.norm();
    let sigma_position = (position + DRIFT_M * DRIFT_M * length + lever * lever).sqrt();
    (way - b.way).norm() <= DEVIATIONS * sigma_position
        && wrapped(a.turn - b.turn).abs() <= DEVIATIONS * sigma_yaw
}
