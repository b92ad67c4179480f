//! Gauss-Newton steps on the graph: conjugate gradients, preconditioned by the chain.
//!
//! The flight is a chain of nodes, and its part of the normal equations is block-tridiagonal: factored and solved in
//! time linear in the number of nodes. Loops are few beside it, and conjugate gradients need about as many iterations
//! as there are independent ones. Iterations are bounded.

use super::edge::{Edge, Node};
use nalgebra::{Matrix4, Vector4};

/// Iterations of a step at most.
const MAX_ITERATIONS: usize = 40;
/// Relative residual at which a step is good enough.
const TOLERANCE: f64 = 1e-6;
/// Added to the diagonal, relative.
const DAMPING: f64 = 1e-9;

/// Workspace for graphs of a size.
#[derive(Clone, Debug)]
pub(super) struct Solver {
    /// Diagonal blocks of the normal equations.
    diagonal: Vec<Matrix4<f64>>,
    /// Blocks beside the diagonal: of node `i` (row) and `i - 1`.
    lower: Vec<Matrix4<f64>>,
    /// Inverse pivots of the chain, and its multipliers.
    pivots: Vec<Matrix4<f64>>,
    multipliers: Vec<Matrix4<f64>>,
    gradient: Vec<Vector4<f64>>,
    step: Vec<Vector4<f64>>,
    residual: Vec<Vector4<f64>>,
    direction: Vec<Vector4<f64>>,
    image: Vec<Vector4<f64>>,
    solved: Vec<Vector4<f64>>,
}

impl Solver {
    pub fn new(nodes: usize) -> Self {
        let (matrices, vectors) = (vec![Matrix4::zeros(); nodes], vec![Vector4::zeros(); nodes]);
        Self {
            diagonal: matrices.clone(),
            lower: matrices.clone(),
            pivots: matrices.clone(),
            multipliers: matrices,
            gradient: vectors.clone(),
            step: vectors.clone(),
            residual: vectors.clone(),
            direction: vectors.clone(),
            image: vectors.clone(),
            solved: vectors,
        }
    }

    /// One step; the largest change, m or rad. Nodes that are fixed stay.
    pub fn step(&mut self, nodes: &mut [Node], edges: &[Edge]) -> f64 {
        let n = nodes.len();
        self.linearize(nodes, edges);
        self.factor_chain(n);
        self.solve(nodes, edges);
        let mut largest = 0.0;
        for (node, step) in nodes.iter_mut().zip(&self.step).filter(|(node, _)| !node.is_fixed) {
            node.p_m_b += step.xyz();
            node.yaw = super::edge::wrapped(node.yaw + step.w);
            let size = step.amax();
            largest = if size > largest { size } else { largest };
        }
        largest
    }

    fn linearize(&mut self, nodes: &[Node], edges: &[Edge]) {
        for i in 0..nodes.len() {
            self.diagonal[i] = Matrix4::zeros();
            self.lower[i] = Matrix4::zeros();
            self.gradient[i] = Vector4::zeros();
        }
        for edge in edges.iter().filter(|e| e.weight > 0.0) {
            let l = edge.linearize(nodes);
            let information = edge.information * edge.weight;
            let (from, to) = (l.by_from.transpose() * information, l.by_to.transpose() * information);
            self.diagonal[edge.from] += from * l.by_from;
            self.diagonal[edge.to] += to * l.by_to;
            self.gradient[edge.from] += from * l.error;
            self.gradient[edge.to] += to * l.error;
            if edge.to == edge.from + 1 {
                self.lower[edge.to] += to * l.by_from;
            } else if edge.from == edge.to + 1 {
                self.lower[edge.from] += from * l.by_to;
            }
        }
        for (i, node) in nodes.iter().enumerate() {
            let block = &mut self.diagonal[i];
            for k in 0..4 {
                block[(k, k)] += DAMPING * block[(k, k)] + 1e-12;
            }
            if node.is_fixed {
                *block = Matrix4::identity();
                self.gradient[i] = Vector4::zeros();
                self.lower[i] = Matrix4::zeros();
                if i + 1 < nodes.len() {
                    self.lower[i + 1] = Matrix4::zeros();
                }
            }
        }
    }

    /// `H = L D L^T` of the chain.
    fn factor_chain(&mut self, n: usize) {
        for i in 0..n {
            let mut pivot = self.diagonal[i];
            if i > 0 {
                self.multipliers[i] = self.lower[i] * self.pivots[i - 1];
                pivot -= self.multipliers[i] * self.lower[i].transpose();
            }
            // A pivot that rounding has spoilt: the node is left to itself.
            let inverse = pivot.cholesky().or_else(|| self.diagonal[i].cholesky()).map(|c| c.inverse());
            self.pivots[i] = inverse.unwrap_or_else(Matrix4::identity);
        }
    }

    /// `solved = M^-1 residual`, with the chain for `M`.
    fn precondition(&mut self, n: usize) {
        for i in 0..n {
            self.solved[i] = self.residual[i];
            if i > 0 {
                let before = self.solved[i - 1];
                self.solved[i] -= self.multipliers[i] * before;
            }
        }
        for i in (0..n).rev() {
            self.solved[i] = self.pivots[i] * self.solved[i];
            if i + 1 < n {
                let after = self.solved[i + 1];
                self.solved[i] -= self.multipliers[i + 1].transpose() * after;
            }
        }
    }

    /// `image = H direction`: the chain by its blocks, and the other edges one by one.
    fn multiply(&mut self, nodes: &[Node], edges: &[Edge]) {
        let n = nodes.len();
        for i in 0..n {
            self.image[i] = self.diagonal[i] * self.direction[i];
            if i > 0 {
                self.image[i] += self.lower[i] * self.direction[i - 1];
            }
            if i + 1 < n {
                self.image[i] += self.lower[i + 1].transpose() * self.direction[i + 1];
            }
        }
        let beside = |e: &&Edge| e.weight > 0.0 && e.from.abs_diff(e.to) > 1;
        for edge in edges.iter().filter(beside) {
            if nodes[edge.from].is_fixed || nodes[edge.to].is_fixed {
                continue;
            }
            let l = edge.linearize(nodes);
            let cross = l.by_from.transpose() * (edge.information * edge.weight) * l.by_to;
            self.image[edge.from] += cross * self.direction[edge.to];
            self.image[edge.to] += cross.transpose() * self.direction[edge.from];
        }
    }

    fn solve(&mut self, nodes: &[Node], edges: &[Edge]) {
        let n = nodes.len();
        for i in 0..n {
            self.step[i] = Vector4::zeros();
            self.residual[i] = -self.gradient[i];
        }
        self.precondition(n);
        self.direction[..n].copy_from_slice(&self.solved[..n]);
        let mut energy = dot(&self.residual[..n], &self.solved[..n]);
        let limit = TOLERANCE * TOLERANCE * energy;
        for _ in 0..MAX_ITERATIONS {
            // Written so that a NaN ends it.
            if !(energy > limit && energy > 0.0) {
                break;
            }
            self.multiply(nodes, edges);
            let curvature = dot(&self.direction[..n], &self.image[..n]);
            let is_curved = curvature > 0.0;
            if !is_curved {
                break;
            }
            let length = energy / curvature;
            for i in 0..n {
                self.step[i] += self.direction[i] * length;
                self.residual[i] -= self.image[i] * length;
            }
            self.precondition(n);
            let next = dot(&self.residual[..n], &self.solved[..n]);
            let share = next / energy;
            for i in 0..n {
                self.direction[i] = self.solved[i] + self.direction[i] * share;
            }
            energy = next;
        }
    }
}

fn dot(a: &[Vector4<f64>], b: &[Vector4<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
