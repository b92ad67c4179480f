//! Consistency of a loop with the odometry: the path along the flight from one end to the other must lead
//! where the loop says, within the drift of the odometry.
//!
//! Appearance proves nothing where another place looks the same, and poses found in a look-alike room agree
//! with each other as well as true ones do. This check therefore comes before any agreement of loops: a loop
//! that it refuses does not count, however many agree with it.
//!
//! Between two keyframes of one piece of unbroken odometry the way is the odometry's own, and its covariance is that of
//! its steps, one after the other, each larger than the window says by a factor that was measured, and by a walk that
//! no window knows of. Loops have no say in it: a false one cannot make others believable, nor true ones false. Between
//! two pieces, or a piece and a loaded map, no odometry leads; there the way goes over the newest loop between the two that
//! others have confirmed, once there is one.

use super::edge::{DRIFT_M, DRIFT_RAD, Edge, EdgeKind, Node, Way, chained, wrapped};
use nalgebra::{Matrix4, Vector4};

/// Errors of steps add up to so much more than the covariances that the window gives them, as a factor on the standard
/// deviation: neighbouring steps share landmarks and biases. See `notes/places.md`.
const INFLATION: f64 = 3.0;
/// Error of the ends of any path, however short, m and rad: the first poses of a flight are known less well
/// than the window says.
const ENDS: (f64, f64) = (0.01, 0.002);
/// Square of the Mahalanobis distance that is refused: one in ten thousand of four Gaussian components.
pub(super) const GATE: f64 = 23.5;
/// A loop between pieces of odometry is confirmed when so many others agree with it.
const CONFIRMED: usize = 2;

/// The way along the odometry, either way round; `None` where none joins the two.
fn of_odometry(nodes: &[Node], edges: &[Edge], from: usize, to: usize) -> Option<Way> {
    let (first, last) = (from.min(to), from.max(to));
    let mut reached = first;
    let (moved, turned) = (ENDS.0 * ENDS.0, ENDS.1 * ENDS.1);
    let mut covariance = Matrix4::from_diagonal(&Vector4::new(moved, moved, moved, turned));
    // Edges of the odometry stand in the order of their nodes.
    let is_between = |e: &&Edge| e.kind == EdgeKind::Sequential && e.from >= first && e.to <= last;
    for edge in edges.iter().filter(is_between) {
        if edge.from != reached {
            return None;
        }
        covariance = chained(&covariance, &edge.way, &drifted(edge)?);
        reached = edge.to;
    }
    let place = |k: usize| nodes[k].pose_o_b.translation.vector;
    let forth = Way { way: place(last) - place(first), turn: 0.0, covariance };
    (reached == last).then(|| if from == first { forth } else { forth.reversed() })
}

/// Square of the Mahalanobis distance of a loop that says where a way leads; infinite where it has none.
fn apart2(way: &Way, of: &Edge) -> f64 {
    let error: Vector4<f64> = (of.way - way.way).push(wrapped(of.turn - way.turn));
    let both = of.known_way().and_then(|said| (way.covariance + said.covariance).cholesky());
    both.map_or(f64::INFINITY, |both| error.dot(&both.solve(&error)))
}

/// Covariance of a step with what the window does not know of.
fn drifted(edge: &Edge) -> Option<Matrix4<f64>> {
    let length = edge.way.norm();
    let [walk, swing] = [DRIFT_M, DRIFT_RAD].map(|per_root| per_root * per_root * length);
    Some(
        edge.known_way()?.covariance * (INFLATION * INFLATION)
            + Matrix4::from_diagonal(&Vector4::new(walk, walk, walk, swing)),
    )
}

/// Square of the Mahalanobis distance between a loop and what the odometry says; `None` where it says nothing of it.
pub(super) fn distance2(nodes: &[Node], edges: &[Edge], of: &Edge) -> Option<f64> {
    let segment = |k: usize| nodes[k].segment;
    if segment(of.from) == segment(of.to) {
        return Some(apart2(&of_odometry(nodes, edges, of.from, of.to)?, of));
    }
    let is_confirmed = |e: &&Edge| {
        matches!(e.kind, EdgeKind::Loop { supporters } if supporters >= CONFIRMED)
            && e.counts()
            && segment(e.from) == segment(of.from)
            && segment(e.to) == segment(of.to)
    };
    let over = edges.iter().rev().find(is_confirmed)?;
    let there = of_odometry(nodes, edges, of.from, over.from)?;
    let back = of_odometry(nodes, edges, over.to, of.to)?;
    Some(apart2(&there.then(&over.known_way()?).then(&back), of))
}
