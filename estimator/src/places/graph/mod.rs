//! Pose graph in position and yaw: what gravity leaves unknown.
//!
//! A node is a keyframe: position `p` and yaw `psi` in the map frame `M`; its attitude is `R = Rz(psi) R_vio`, with
//! the attitude `R_vio` of the odometry, so that `psi` is the correction of the heading and no Euler angle of the body
//! is ever taken. An edge from `a` to `b` measures `z_p` and `z_psi`:
//!
//! `e = ( Rz(-psi_a) (p_b - p_a) - z_p,  psi_b - psi_a - z_psi )`, with an information matrix of 4x4.
//!
//! Between neighbours the odometry measures; a loop is what a keyframe was located by. Loops may be false: what the
//! odometry speaks against is refused (`drift`); the others count only once another one agrees with them
//! ([`consistency`], pairwise consistency, Mangelson et al. 2018), and their weights follow graduated non-convexity with truncated least squares (Yang et al. 2020). The linear systems are
//! solved by conjugate gradients with the chain of the flight as preconditioner (`solver`). The work of a call is
//! bounded; the next call goes on where it ended.

pub mod consistency;
mod drift;
pub mod edge;
mod solver;

pub use edge::{Edge, EdgeKind, Node};

use consistency::agree;
use nalgebra::Isometry3;
use solver::Solver;

/// Square of the Mahalanobis distance beyond which a loop is false: 99 % of four Gaussian components.
const GATE: f64 = 13.28;
/// Factor by which the kernel sharpens from step to step.
const SHARPENING: f64 = 1.6;
/// Sharpness at which weights are as good as 0 or 1.
const SHARP: f64 = 50.0;
/// A step whose largest entry is below this ends the optimization, m or rad.
const TOLERANCE: f64 = 1e-5;
/// The newest loops that a new one is compared with.
const MAX_COMPARED: usize = 64;

/// Reason why a loop was not added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopRefused {
    /// The graph holds as many as it can, or has no such nodes.
    NoRoom,
    /// It says something else than the odometry, which cannot have drifted so far.
    Contradicted,
}

/// Result of a call of [`PoseGraph::optimize`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OptimizationProgress {
    /// Steps taken.
    pub steps: usize,
    /// True if the optimization has finished.
    pub is_done: bool,
    /// Loops that count.
    pub loops_used: usize,
}

/// Keyframes and what is known between them. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct PoseGraph {
    max_nodes: usize,
    /// Loops at most; beyond, new ones are refused.
    max_loops: usize,
    nodes: Vec<Node>,
    edges: Vec<Edge>,
    /// Places of the loops among the edges.
    loops: Vec<usize>,
    solver: Solver,
    sharpness: f64,
    is_done: bool,
}

impl PoseGraph {
    /// An empty graph with room for so many nodes and loops.
    #[must_use]
    pub fn new(max_nodes: usize, max_loops: usize) -> Self {
        Self {
            max_nodes,
            max_loops,
            nodes: Vec::with_capacity(max_nodes),
            edges: Vec::with_capacity(max_nodes + max_loops),
            loops: Vec::with_capacity(max_loops),
            solver: Solver::new(max_nodes),
            sharpness: SHARP,
            is_done: true,
        }
    }

    /// The nodes, in the order in which they were added.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Edges of both kinds.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Adds a node; `None` when there is no room. The first node of a graph must be fixed, or nothing holds it.
    pub fn add_node(&mut self, node: Node) -> Option<usize> {
        (self.nodes.len() < self.max_nodes).then(|| {
            self.nodes.push(node);
            self.nodes.len() - 1
        })
    }

    /// Adds what the odometry measured between two nodes; `false` when there is no room, or no such node.
    pub fn add_sequential(&mut self, edge: Edge) -> bool {
        let fits = self.edges.len() < self.max_nodes + self.max_loops && self.joins_nodes(&edge);
        if fits {
            self.edges.push(Edge { weight: 1.0, kind: EdgeKind::Sequential, ..edge });
        }
        fits
    }

    /// Square of the Mahalanobis distance between a loop and the way along the odometry; `None` where no odometry leads
    /// from end to end. The work is that of a walk along all edges.
    pub fn odometry_distance2(&self, edge: &Edge) -> Option<f64> {
        self.joins_nodes(edge).then(|| drift::distance2(&self.nodes, &self.edges, edge)).flatten()
    }

    /// Adds a loop. It waits until another one agrees with it, unless it `stands_alone`.
    ///
    /// # Errors
    /// When there is no room for it, or the odometry speaks against it.
    pub fn add_loop(&mut self, edge: Edge, stands_alone: bool) -> Result<(), LoopRefused> {
        if self.loops.len() == self.max_loops || !self.joins_nodes(&edge) {
            return Err(LoopRefused::NoRoom);
        }
        // A distance that is no number is refused too.
        let is_possible = self.odometry_distance2(&edge).is_none_or(|distance2| distance2 <= drift::GATE);
        if !is_possible {
            return Err(LoopRefused::Contradicted);
        }
        let mut edge = Edge { weight: 0.0, kind: EdgeKind::Loop { supporters: 0 }, ..edge };
        let mut supporters = usize::from(stands_alone);
        for &other in self.loops.iter().rev().take(MAX_COMPARED) {
            if agree(&self.nodes, &edge, &self.edges[other]) {
                supporters += 1;
                if let EdgeKind::Loop { supporters } = &mut self.edges[other].kind {
                    *supporters += 1;
                }
            }
        }
        edge.kind = EdgeKind::Loop { supporters };
        self.loops.push(self.edges.len());
        self.edges.push(edge);
        if supporters > 0 {
            self.begin_anew();
        }
        Ok(())
    }

    /// The odometry of a node is known better now: the node keeps its correction, and the edges about it follow.
    pub fn set_odometry(&mut self, node: usize, pose_o_b: Isometry3<f64>) {
        let Some(refreshed) = self.nodes.get_mut(node) else { return };
        let pose_m_o = refreshed.pose_m_o();
        refreshed.pose_o_b = pose_o_b;
        refreshed.place(&pose_m_o);
        for edge in self.edges.iter_mut().filter(|e| e.kind == EdgeKind::Sequential) {
            if edge.from == node || edge.to == node {
                edge.refresh_odometry(&self.nodes);
            }
        }
        self.is_done &= self.loops.iter().all(|&l| self.edges[l].weight == 0.0);
    }

    /// It has become known where a segment lies: its nodes go there, and are free to move from now on.
    pub fn place_segment(&mut self, segment: u32, pose_m_o: &Isometry3<f64>) {
        for node in self.nodes.iter_mut().filter(|n| n.segment == segment && !n.is_placed) {
            node.place(pose_m_o);
            (node.is_placed, node.is_fixed) = (true, false);
        }
        self.begin_anew();
    }

    /// Takes a node out. What the odometry knew over it becomes one edge; its loops hold on to the node before it, or
    /// after it where there is none.
    pub fn remove_node(&mut self, gone: usize) {
        if gone >= self.nodes.len() {
            return;
        }
        let find = |at: fn(&Edge) -> usize| {
            self.edges.iter().position(|e| e.kind == EdgeKind::Sequential && at(e) == gone)
        };
        let (before, after) = (find(|e| e.to), find(|e| e.from));
        if self.nodes[gone].is_fixed
            && let Some(after) = after
        {
            self.nodes[self.edges[after].to].is_fixed = true;
        }
        // The edge to the heir, from the node that goes.
        let to_heir = match (before, after) {
            (Some(before), _) => self.edges[before].reversed(&self.nodes),
            (None, Some(after)) => Some(self.edges[after]),
            (None, None) => None,
        };
        if let Some(to_heir) = to_heir {
            for &at in &self.loops {
                self.edges[at] = self.edges[at].rebased(&self.nodes, &to_heir);
            }
        }
        let joined = before.zip(after).and_then(|(b, a)| self.edges[b].followed_by(&self.edges[a]));
        if let (Some(before), Some(joined)) = (before, joined) {
            self.edges[before] = joined;
        }
        self.edges.retain(|e| e.from != gone && e.to != gone && e.from != e.to);
        self.nodes.remove(gone);
        for edge in &mut self.edges {
            edge.from -= usize::from(edge.from > gone);
            edge.to -= usize::from(edge.to > gone);
        }
        self.loops.clear();
        let loops = self.edges.iter().enumerate().filter(|(_, e)| e.kind != EdgeKind::Sequential);
        self.loops.extend(loops.map(|(index, _)| index));
    }

    fn joins_nodes(&self, edge: &Edge) -> bool {
        edge.from < self.nodes.len() && edge.to < self.nodes.len() && edge.from != edge.to
    }

    /// Starts the schedule of the kernel anew: all supported loops count, and the kernel is as wide as the worst of
    /// them needs.
    fn begin_anew(&mut self) {
        let mut worst = 0.0;
        for &at in &self.loops {
            let edge = &mut self.edges[at];
            edge.weight = if edge.is_supported() { 1.0 } else { 0.0 };
            let distance = edge.distance2(&self.nodes);
            if edge.is_supported() && distance > worst {
                worst = distance;
            }
        }
        self.sharpness = if worst > GATE { GATE / (2.0 * worst - GATE) } else { SHARP };
        self.is_done = false;
    }

    /// Goes on with the optimization for at most `steps` steps.
    pub fn optimize(&mut self, steps: usize) -> OptimizationProgress {
        let mut progress = OptimizationProgress::default();
        while progress.steps < steps && !self.is_done {
            progress.steps += 1;
            let largest = self.solver.step(&mut self.nodes, &self.edges);
            self.weigh_loops();
            let is_sharp = self.sharpness >= SHARP;
            self.is_done = is_sharp && largest < TOLERANCE;
            self.sharpness = if is_sharp { self.sharpness } else { self.sharpness * SHARPENING };
        }
        progress.is_done = self.is_done;
        progress.loops_used = self.loops.iter().filter(|l| self.edges[**l].counts()).count();
        progress
    }

    /// Weights of truncated least squares at this sharpness.
    fn weigh_loops(&mut self) {
        let mu = self.sharpness;
        for &at in &self.loops {
            let distance = self.edges[at].distance2(&self.nodes);
            let edge = &mut self.edges[at];
            edge.weight = if !edge.is_supported() || distance >= GATE * (mu + 1.0) / mu {
                0.0
            } else if distance <= GATE * mu / (mu + 1.0) {
                1.0
            } else {
                (GATE * mu * (mu + 1.0) / distance).sqrt() - mu
            };
        }
    }
}

#[cfg(test)]
mod tests;
