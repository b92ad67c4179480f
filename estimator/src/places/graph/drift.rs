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

use super::edge::{Edge, EdgeKind, Node, chained, turn, wrapped};
use nalgebra::{Matrix4, Vector3, Vector4};

/// Errors of steps add up to so much more than the covariances that the window gives them, as a factor on the standard
/// deviation: neighbouring steps share landmarks and biases. See `notes/places.md`.
const INFLATION: f64 = 3.0;
/// Further drift of the odometry, m per root of a metre of path.
const DRIFT_M: f64 = 0.02;
/// Drift of the odometry's heading, rad per root of a metre of way.
const DRIFT_RAD: f64 = 0.002;
/// Error of the ends of any path, however short, m and rad: the first poses of a flight are known less well
/// than the window says.
const ENDS: (f64, f64) = (0.01, 0.002);
/// Square of the Mahalanobis distance that is refused: one in ten thousand of four Gaussian components.
const GATE: f64 = 23.5;
/// A loop between pieces of odometry is confirmed when so many others agree with it.
const CONFIRMED: usize = 2;

/// Path from one node to another with its covariance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    /// In the odometry frame of the first, m.
    way: Vector3<f64>,
    /// Yaw of the second's odometry frame relative to that of the first, rad.
    turn: f64,
    covariance: Matrix4<f64>,
}

impl Way {
    /// Along the odometry, either way round; `None` where none joins the two.
    fn of_odometry(nodes: &[Node], edges: &[Edge], from: usize, to: usize) -> Option<Self> {
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
        let forth = Self { way: place(last) - place(first), turn: 0.0, covariance };
        (reached == last).then(|| if from == first { forth } else { forth.reversed() })
    }

    fn of_loop(edge: &Edge) -> Option<Self> {
        Some(Self { way: edge.way, turn: edge.turn, covariance: edge.covariance()? })
    }

    /// Returns the way back, with its covariance.
    fn reversed(&self) -> Self {
        let back = turn(-self.turn);
        let mut by_error = -Matrix4::identity();
        by_error.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(&self.way));
        let mut rotation = Matrix4::identity();
        rotation.fixed_view_mut::<3, 3>(0, 0).copy_from(back.to_rotation_matrix().matrix());
        let by_error = rotation * by_error;
        let covariance = by_error * self.covariance * by_error.transpose();
        Self { way: -(back * self.way), turn: -self.turn, covariance }
    }

    /// This way and then the next.
    fn then(&self, next: &Self) -> Self {
        let way = turn(self.turn) * next.way;
        let mut rotation = Matrix4::identity();
        let turned = turn(self.turn).to_rotation_matrix();
        rotation.fixed_view_mut::<3, 3>(0, 0).copy_from(turned.matrix());
        let second = rotation * next.covariance * rotation.transpose();
        let covariance = chained(&self.covariance, &way, &second);
        Self { way: self.way + way, turn: wrapped(self.turn + next.turn), covariance }
    }

    /// Square of the Mahalanobis distance of a loop that says where this way leads; infinite where it has none.
    fn distance2(&self, of: &Edge) -> f64 {
        let way: Vector3<f64> = of.way - self.way;
        let error: Vector4<f64> = way.push(wrapped(of.turn - self.turn));
        let both = of.covariance().and_then(|c| (self.covariance + c).cholesky());
        both.map_or(f64::INFINITY, |both| error.dot(&both.solve(&error)))
    }
}

/// Covariance of a step with what the window does not know of.
fn drifted(edge: &Edge) -> Option<Matrix4<f64>> {
    let length = edge.way.norm();
    let [walk, swing] = [DRIFT_M, DRIFT_RAD].map(|per_root| per_root * per_root * length);
    Some(
        edge.covariance()? * (INFLATION * INFLATION)
            + Matrix4::from_diagonal(&Vector4::new(walk, walk, walk, swing)),
    )
}

/// Square of the Mahalanobis distance between a loop and what the odometry says; `None` where it says nothing of it.
pub(super) fn distance2(nodes: &[Node], edges: &[Edge], of: &Edge) -> Option<f64> {
    let segment = |k: usize| nodes[k].segment;
    if segment(of.from) == segment(of.to) {
        return Some(Way::of_odometry(nodes, edges, of.from, of.to)?.distance2(of));
    }
    let is_confirmed = |e: &&Edge| {
        matches!(e.kind, EdgeKind::Loop { supporters } if supporters >= CONFIRMED)
            && e.weight > 0.5
            && segment(e.from) == segment(of.from)
            && segment(e.to) == segment(of.to)
    };
    let over = edges.iter().rev().find(is_confirmed)?;
    let there = Way::of_odometry(nodes, edges, of.from, over.from)?;
    let back = Way::of_odometry(nodes, edges, over.to, of.to)?;
    Some(there.then(&Way::of_loop(over)?).then(&back).distance2(of))
}

/// True if the odometry contradicts a loop. A distance that is not a number does.
pub(super) fn contradicts(nodes: &[Node], edges: &[Edge], of: &Edge) -> bool {
    distance2(nodes, edges, of).is_some_and(|distance2| {
        let is_possible = distance2 <= GATE;
        !is_possible
    })
}
