//! The Hessian blocks (`J'J` and `J'r`) of one landmark, summed over its observations, in rows as wide as the vector
//! unit likes.
//!
//! Every observation touches the rig, the host's pose and the landmark: these blocks are kept in one small dense
//! matrix and moved to the normal equations once per landmark. The blocks of the frame that made the observation go
//! there at once.

use super::dense::NormalEquations;
use super::eliminate::Eliminated;
use super::feature::Jacobians;
use super::options::Options;
use super::state::{HEADING, POSE_DIM, RIG_DIM, visual_of_frame};
use nalgebra::{SMatrix, Vector2};

/// Most degrees of freedom of a landmark: those of a line.
const MAX_LANDMARK_DIM: usize = 4;
/// Columns of the blocks that all observations of a landmark share: rig, host, landmark, residual. They are
/// a multiple of the vector width.
const COMMON: usize = 24;
const AT_HOST: usize = RIG_DIM;
const AT_LANDMARK: usize = AT_HOST + POSE_DIM;
const AT_RESIDUAL: usize = AT_LANDMARK + MAX_LANDMARK_DIM;

/// `J'J` and `J'r` of one landmark over what its observations have in common.
pub(super) struct LandmarkHessian<const D: usize>([[f64; COMMON]; AT_RESIDUAL]);

impl<const D: usize> Default for LandmarkHessian<D> {
    fn default() -> Self {
        Self([[0.0; COMMON]; AT_RESIDUAL])
    }
}

impl<const D: usize> LandmarkHessian<D> {
    /// Adds two rows of (rig, host, landmark, residual).
    pub(super) fn add(&mut self, rows: &[[f64; COMMON]; 2]) {
        for (i, to) in self.0[..AT_LANDMARK + D].iter_mut().enumerate() {
            let (a, b) = (rows[0][i], rows[1][i]);
            for (k, to) in to.iter_mut().enumerate() {
                *to += a * rows[0][k] + b * rows[1][k];
            }
        }
    }

    /// The landmark's own block.
    pub(super) fn landmark(&self) -> SMatrix<f64, D, D> {
        SMatrix::from_fn(|i, k| self.0[AT_LANDMARK + i][AT_LANDMARK + k])
    }

    /// Moves the blocks to the visual equations and the landmark's row.
    pub(super) fn flush(&self, visual: &mut NormalEquations, entry: &mut Eliminated<D>, host: usize) {
        let at = visual_of_frame(host);
        for (i, blocks) in self.0[..AT_LANDMARK].iter().enumerate() {
            let to = if i < AT_HOST { i } else { at + i - AT_HOST };
            let row = visual.row_mut(to);
            if i < AT_HOST {
                add_to(&mut row[..RIG_DIM - i], &blocks[i..RIG_DIM]);
                add_to(&mut row[at - i..at - i + POSE_DIM], &blocks[AT_HOST..AT_LANDMARK]);
            } else {
                add_to(&mut row[..AT_LANDMARK - i], &blocks[i..AT_LANDMARK]);
            }
            visual.gradient_mut()[to] += blocks[AT_RESIDUAL];
        }
        for (k, row) in entry.by_visual.iter_mut().enumerate() {
            let blocks = &self.0[AT_LANDMARK + k];
            add_to(&mut row[..RIG_DIM], &blocks[..RIG_DIM]);
            add_to(&mut row[at..at + POSE_DIM], &blocks[AT_HOST..AT_LANDMARK]);
            entry.gradient[k] = blocks[AT_RESIDUAL];
        }
    }
}

/// Adds the blocks of the Manhattan world's heading, from the same two rows.
pub(super) fn add_heading<const D: usize>(
    visual: &mut NormalEquations,
    entry: &mut Eliminated<D>,
    rows: &[[f64; COMMON]; 2],
    heading: &Vector2<f64>,
    host: usize,
) {
    let mixed = |k: usize| heading[0] * rows[0][k] + heading[1] * rows[1][k];
    for k in 0..RIG_DIM {
        visual.add(k, HEADING, mixed(k));
    }
    visual.add(HEADING, HEADING, heading.norm_squared());
    for k in 0..POSE_DIM {
        visual.add(HEADING, visual_of_frame(host) + k, mixed(AT_HOST + k));
    }
    visual.gradient_mut()[HEADING] += mixed(AT_RESIDUAL);
    for (k, row) in entry.by_visual.iter_mut().enumerate() {
        row[HEADING] += mixed(AT_LANDMARK + k);
    }
}

fn add_to(to: &mut [f64], from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from;
    }
}

/// The two rows of an observation that it shares with others, times `scale`.
pub(super) fn common_rows<const D: usize>(
    j: &Jacobians<D>,
    r: &Vector2<f64>,
    scale: f64,
    is_host_free: bool,
    options: &Options,
) -> [[f64; COMMON]; 2] {
    let mut rows = [[0.0; COMMON]; 2];
    for (d, row) in rows.iter_mut().enumerate() {
        for (k, (to, mask)) in row.iter_mut().zip(options.rig_mask.iter()).enumerate() {
            *to = j.rig[(d, k)] * mask * scale;
        }
        // Seen from its host frame, a landmark has no derivative by that frame's pose.
        if is_host_free {
            for k in 0..POSE_DIM {
                row[AT_HOST + k] = j.host[(d, k)] * scale;
            }
        }
        for k in 0..D {
            row[AT_LANDMARK + k] = j.landmark[(d, k)] * scale;
        }
        row[AT_RESIDUAL] = r[d] * scale;
    }
    rows
}

/// Adds the blocks of the observing frame `target`, from the rows of one observation and its `jacobian` by that
/// frame's pose.
pub(super) fn add_target<const D: usize>(
    visual: &mut NormalEquations,
    entry: &mut Eliminated<D>,
    rows: &[[f64; COMMON]; 2],
    jacobian: &SMatrix<f64, 2, 6>,
    scale: f64,
    (host, target): (usize, usize),
) {
    let (at_host, at) = (visual_of_frame(host), visual_of_frame(target));
    let t: [[f64; POSE_DIM]; 2] = [0, 1].map(|d| std::array::from_fn(|k| jacobian[(d, k)] * scale));
    let outer = |a: f64, b: f64| -> [f64; POSE_DIM] { std::array::from_fn(|k| a * t[0][k] + b * t[1][k]) };
    for i in 0..RIG_DIM {
        let row = visual.row_mut(i);
        add_to(&mut row[at - i..at - i + POSE_DIM], &outer(rows[0][i], rows[1][i]));
    }
    for i in 0..POSE_DIM {
        add_to(&mut visual.row_mut(at + i)[..POSE_DIM - i], &outer(t[0][i], t[1][i])[i..]);
        if host < target {
            let row = visual.row_mut(at_host + i);
            let from = at - at_host - i;
            add_to(&mut row[from..from + POSE_DIM], &outer(rows[0][AT_HOST + i], rows[1][AT_HOST + i]));
        } else {
            let row = visual.row_mut(at + i);
            let from = at_host - at - i;
            for k in 0..POSE_DIM {
                row[from + k] += t[0][i] * rows[0][AT_HOST + k] + t[1][i] * rows[1][AT_HOST + k];
            }
        }
        visual.gradient_mut()[at + i] += t[0][i] * rows[0][AT_RESIDUAL] + t[1][i] * rows[1][AT_RESIDUAL];
    }
    for (k, row) in entry.by_visual.iter_mut().enumerate() {
        add_to(&mut row[at..at + POSE_DIM], &outer(rows[0][AT_LANDMARK + k], rows[1][AT_LANDMARK + k]));
    }
}

#[cfg(test)]
#[path = "hessian_blocks_tests.rs"]
mod tests;
