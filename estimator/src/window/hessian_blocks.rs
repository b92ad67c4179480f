//! Sums over the observations of one landmark, in rows as wide as the vector unit likes.
//!
//! Every observation touches the rig, the host's pose and the landmark: those sums are kept in one small
//! dense block and moved to the normal equations once per landmark. What an observation says of the frame
//! it was made in goes there at once.

use super::Options;
use super::dense::NormalEquations;
use super::eliminate::Eliminated;
use super::feature::Jacobians;
use super::state::{GLOBAL_DIM, HEADING, POSE_DIM, RIG_DIM};
use nalgebra::{SMatrix, Vector2};

/// Most degrees of freedom of a landmark: those of a line.
const MAX_LANDMARK_DIM: usize = 4;
/// Columns of the sums that all observations of a landmark share: rig, host, landmark, residual. They are
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

    /// Moves the sums to the visual equations and the landmark's row.
    pub(super) fn flush(&self, visual: &mut NormalEquations, entry: &mut Eliminated<D>, host: usize) {
        let at = GLOBAL_DIM + POSE_DIM * host;
        for (i, sums) in self.0[..AT_LANDMARK].iter().enumerate() {
            let to = if i < AT_HOST { i } else { at + i - AT_HOST };
            let row = visual.row_mut(to);
            if i < AT_HOST {
                add_to(&mut row[..RIG_DIM - i], &sums[i..RIG_DIM]);
                add_to(&mut row[at - i..at - i + POSE_DIM], &sums[AT_HOST..AT_LANDMARK]);
            } else {
                add_to(&mut row[..AT_LANDMARK - i], &sums[i..AT_LANDMARK]);
            }
            visual.gradient_mut()[to] += sums[AT_RESIDUAL];
        }
        for (k, row) in entry.by_visual.iter_mut().enumerate() {
            let sums = &self.0[AT_LANDMARK + k];
            add_to(&mut row[..RIG_DIM], &sums[..RIG_DIM]);
            add_to(&mut row[at..at + POSE_DIM], &sums[AT_HOST..AT_LANDMARK]);
            entry.gradient[k] = sums[AT_RESIDUAL];
        }
    }
}

/// Adds what the same two rows say of the heading of the structure.
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
        visual.add(HEADING, GLOBAL_DIM + POSE_DIM * host + k, mixed(AT_HOST + k));
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
        // Seen from its host frame, a landmark says nothing about that frame's pose.
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

/// Adds what an observation says of the observing frame `target`.
pub(super) fn add_target<const D: usize>(
    visual: &mut NormalEquations,
    entry: &mut Eliminated<D>,
    rows: &[[f64; COMMON]; 2],
    jacobian: &SMatrix<f64, 2, 6>,
    scale: f64,
    (host, target): (usize, usize),
) {
    let (at_host, at) = (GLOBAL_DIM + POSE_DIM * host, GLOBAL_DIM + POSE_DIM * target);
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
