//! Nodes and edges of the pose graph: residual and derivatives.

use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, UnitQuaternion, Vector3, Vector4};

/// Drift of the odometry, m per root of a metre of path.
pub const DRIFT_M: f64 = 0.02;
/// Drift of the odometry's heading, rad per root of a metre of way.
pub const DRIFT_RAD: f64 = 0.002;

/// A keyframe in the graph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Pose of the body in the odometry frame, as it was when the keyframe was made.
    pub pose_o_b: Isometry3<f64>,
    /// Position of the body in the map, m.
    pub p_m_b: Vector3<f64>,
    /// Heading of the odometry frame in the map, rad.
    pub yaw: f64,
    /// True if it stays where it is.
    pub is_fixed: bool,
    /// Piece of unbroken odometry: edges of the odometry join nodes of one segment.
    pub segment: u32,
    /// True if the place of its segment in the map is known.
    pub is_placed: bool,
}

impl Node {
    /// A keyframe whose odometry frame lies at `pose_m_o` (a turn about the vertical, and a shift).
    #[must_use]
    pub fn new(pose_o_b: Isometry3<f64>, pose_m_o: &Isometry3<f64>, is_fixed: bool) -> Self {
        let pose_m_b = pose_m_o * pose_o_b;
        let yaw = yaw_of(&pose_m_o.rotation);
        Self { pose_o_b, p_m_b: pose_m_b.translation.vector, yaw, is_fixed, segment: 0, is_placed: true }
    }

    /// Moves the node to where `pose_m_o` puts it.
    pub(super) fn place(&mut self, pose_m_o: &Isometry3<f64>) {
        self.p_m_b = (pose_m_o * self.pose_o_b).translation.vector;
        self.yaw = yaw_of(&pose_m_o.rotation);
    }

    /// Pose of the body in the map.
    pub fn pose_m_b(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.p_m_b.into(), turn(self.yaw) * self.pose_o_b.rotation)
    }

    /// Way to another node in the odometry frame of this one, m, and the turn of its odometry frame against that, rad.
    pub(super) fn way_to(&self, to: &Self) -> (Vector3<f64>, f64) {
        (turn(-self.yaw) * (to.p_m_b - self.p_m_b), wrapped(to.yaw - self.yaw))
    }

    /// Pose of the odometry frame in the map, as this keyframe has it.
    pub fn pose_m_o(&self) -> Isometry3<f64> {
        let rotation = turn(self.yaw);
        let shift = self.p_m_b - rotation * self.pose_o_b.translation.vector;
        Isometry3::from_parts(shift.into(), rotation)
    }
}

/// Origin of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeKind {
    /// The odometry.
    Sequential,
    /// A keyframe seen again.
    Loop {
        /// Other loops that agree with it.
        supporters: usize,
    },
}

/// A relative measurement between two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Node in whose frame it is measured.
    pub from: usize,
    /// The other node.
    pub to: usize,
    /// Way from the one to the other, in the odometry frame of the first, m.
    pub way: Vector3<f64>,
    /// Difference of the headings of their odometry frames, rad.
    pub turn: f64,
    /// Information about way and turn.
    pub information: Matrix4<f64>,
    /// Origin of the measurement.
    pub kind: EdgeKind,
    /// Weight, 0 to 1.
    pub weight: f64,
}

/// Residual of an edge and its derivatives by position and yaw of both nodes.
pub(super) struct Linearized {
    pub error: Vector4<f64>,
    pub by_from: Matrix4<f64>,
    pub by_to: Matrix4<f64>,
}

impl Edge {
    /// Edge measured by the odometry between two keyframes of one odometry frame.
    #[must_use]
    pub fn of_odometry(nodes: &[Node], from: usize, to: usize, information: Matrix4<f64>) -> Self {
        let place = |i: usize| nodes.get(i).map_or_else(Vector3::zeros, |n| n.pose_o_b.translation.vector);
        let way = place(to) - place(from);
        Self { from, to, way, turn: 0.0, information, kind: EdgeKind::Sequential, weight: 1.0 }
    }

    /// The way and turn from node to node as the odometry has them now.
    pub(super) fn refresh_odometry(&mut self, nodes: &[Node]) {
        self.way = nodes[self.to].pose_o_b.translation.vector - nodes[self.from].pose_o_b.translation.vector;
    }

    /// A loop: the body of node `to` was located at `pose_a_b` in the body of node `from`.
    ///
    /// With `R_a = Rz(psi_a) R_vio_a` the turn is that about the vertical in `R_vio_a R_ab R_vio_b^T`.
    #[must_use]
    pub fn of_loop(
        nodes: &[Node],
        (from, to): (usize, usize),
        pose_a_b: &Isometry3<f64>,
        information: Matrix4<f64>,
    ) -> Self {
        let rotation = |i: usize| nodes.get(i).map_or_else(UnitQuaternion::identity, |n| n.pose_o_b.rotation);
        let (rot_a, rot_b) = (rotation(from), rotation(to));
        let turn = yaw_of(&(rot_a * pose_a_b.rotation * rot_b.inverse()));
        let way = rot_a * pose_a_b.translation.vector;
        Self { from, to, way, turn, information, kind: EdgeKind::Loop { supporters: 0 }, weight: 0.0 }
    }

    /// What it says, with its covariance.
    pub(super) fn known_way(&self) -> Option<Way> {
        let covariance = self.information.cholesky()?.inverse();
        Some(Way { way: self.way, turn: self.turn, covariance })
    }

    /// The edge that says `way` from node `from` to node `to`.
    fn saying(&self, way: &Way, [from, to]: [usize; 2]) -> Option<Self> {
        let information = way.covariance.cholesky()?.inverse();
        Some(Self { from, to, way: way.way, turn: way.turn, information, ..*self })
    }

    /// This edge and then the next: what is known from the first node to the last.
    #[must_use]
    pub(super) fn followed_by(&self, next: &Self) -> Option<Self> {
        self.saying(&self.known_way()?.then(&next.known_way()?), [self.from, next.to])
    }

    /// Returns the edge in the other direction, with its ends where the graph has them now.
    #[must_use]
    pub(super) fn reversed(&self, nodes: &[Node]) -> Option<Self> {
        let (way, turn) = nodes[self.from].way_to(&nodes[self.to]);
        let forth = Way { way, turn, ..self.known_way()? };
        self.saying(&forth.reversed(), [self.to, self.from])
    }

    /// A loop that ends at the node from which `to_heir` leads away, moved to where that leads to.
    #[must_use]
    pub(super) fn rebased(&self, nodes: &[Node], to_heir: &Self) -> Self {
        let gone = to_heir.from;
        let moved = if self.to == gone {
            self.followed_by(to_heir)
        } else if self.from == gone {
            to_heir.reversed(nodes).and_then(|from_heir| from_heir.followed_by(self))
        } else {
            None
        };
        moved.map_or(*self, |moved| Self { kind: self.kind, weight: self.weight, ..moved })
    }

    /// True if most of it counts in the graph.
    pub fn counts(&self) -> bool {
        self.weight > 0.5
    }

    /// True if it may count: a loop without supporters does not.
    pub fn is_supported(&self) -> bool {
        self.kind != EdgeKind::Loop { supporters: 0 }
    }

    /// Square of the Mahalanobis distance of the residual.
    pub fn distance2(&self, nodes: &[Node]) -> f64 {
        let error = self.error(&nodes[self.from], &nodes[self.to]);
        error.dot(&(self.information * error))
    }

    pub(super) fn error(&self, from: &Node, to: &Node) -> Vector4<f64> {
        let (way, turn) = from.way_to(to);
        (way - self.way).push(wrapped(turn - self.turn))
    }

    pub(super) fn linearize(&self, nodes: &[Node]) -> Linearized {
        let (from, to) = (&nodes[self.from], &nodes[self.to]);
        let back: Matrix3<f64> = *turn(-from.yaw).to_rotation_matrix().matrix();
        let way = to.p_m_b - from.p_m_b;
        let mut by_from = Matrix4::zeros();
        by_from.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
        by_from.fixed_view_mut::<3, 1>(0, 3).copy_from(&(back * -Vector3::z().cross(&way)));
        by_from[(3, 3)] = -1.0;
        let mut by_to = Matrix4::zeros();
        by_to.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        by_to[(3, 3)] = 1.0;
        Linearized { error: self.error(from, to), by_from, by_to }
    }
}

/// Way and turn from one node to another, with their covariance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    /// In the odometry frame of the first, m.
    pub way: Vector3<f64>,
    /// Yaw of the second's odometry frame relative to that of the first, rad.
    pub turn: f64,
    pub covariance: Matrix4<f64>,
}

impl Way {
    /// This way and then the next.
    pub fn then(&self, next: &Self) -> Self {
        let way = turn(self.turn) * next.way;
        let rotation = turned_axes(self.turn);
        let second = rotation * next.covariance * rotation.transpose();
        let covariance = chained(&self.covariance, &way, &second);
        Self { way: self.way + way, turn: wrapped(self.turn + next.turn), covariance }
    }

    /// Returns the way back, with its covariance.
    pub fn reversed(&self) -> Self {
        let mut by_error = -Matrix4::identity();
        by_error.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(&self.way));
        let by_error = turned_axes(-self.turn) * by_error;
        let covariance = by_error * self.covariance * by_error.transpose();
        Self { way: -(turn(-self.turn) * self.way), turn: -self.turn, covariance }
    }
}

/// Turns the way in errors of way and turn.
fn turned_axes(yaw: f64) -> Matrix4<f64> {
    turn(yaw).to_rotation_matrix().to_homogeneous()
}

/// Covariance of way and turn over two steps, each known by its own; `way` is that of the second, m, in the axes of the
/// first: an error of the first turn swings it.
#[must_use]
pub fn chained(first: &Matrix4<f64>, way: &Vector3<f64>, second: &Matrix4<f64>) -> Matrix4<f64> {
    let mut by_first = Matrix4::identity();
    by_first.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(way));
    by_first * first * by_first.transpose() + second
}

/// Rotation about the vertical.
#[must_use]
pub fn turn(yaw: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
}

/// The turn about the vertical that is nearest to a rotation.
#[must_use]
pub fn yaw_of(rotation: &UnitQuaternion<f64>) -> f64 {
    let m: Rotation3<f64> = rotation.to_rotation_matrix();
    libm::atan2(m[(1, 0)] - m[(0, 1)], m[(0, 0)] + m[(1, 1)])
}

/// An angle between minus and plus half a turn.
#[must_use]
pub fn wrapped(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}
