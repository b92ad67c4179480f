//! The Hessian blocks (`J'J` and `J'r`) of one landmark, summed over its observations, in rows as wide as the vector
//! unit likes.
//!
//! Every observation touches the time offset, the landmark, and the host's and the observer's camera alike
//! ([`super::camera_poses`]): one product of two short rows is all of its blocks. Those of the host are summed in one
//! small dense matrix and moved to the normal equations once per landmark; those of the camera that made the
//! observation go there at once.

use super::camera_poses::Lifts;
use super::dense::NormalEquations;
use super::eliminate::{Eliminated, MAX_LANDMARK_DIM};
use super::feature::Jacobians;
use super::state::{CAMERA_HEADING, CAMERA_TIME_OFFSET, HEADING, POSE_DIM, unknown_of_camera};
use nalgebra::{SMatrix, Vector2};

/// Columns of an observation: camera, time offset, landmark, residual. They are a multiple of the vector width.
const COLUMNS: usize = 12;
const AT_TIME: usize = POSE_DIM;
const AT_LANDMARK: usize = AT_TIME + 1;
const AT_RESIDUAL: usize = AT_LANDMARK + MAX_LANDMARK_DIM;

/// `J'J` and `J'r` of observations, by the host's camera, the time offset and the landmark.
#[derive(Clone, Debug)]
pub(super) struct Blocks<const D: usize>([[f64; COLUMNS]; AT_RESIDUAL]);

impl<const D: usize> Default for Blocks<D> {
    fn default() -> Self {
        Self([[0.0; COLUMNS]; AT_RESIDUAL])
    }
}

impl<const D: usize> Blocks<D> {
    /// The products of two rows.
    pub(super) fn of(rows: &[[f64; COLUMNS]; 2]) -> Self {
        let mut blocks = Self::default();
        for (i, to) in blocks.0[..AT_LANDMARK + D].iter_mut().enumerate() {
            let (a, b) = (rows[0][i], rows[1][i]);
            for (k, to) in to.iter_mut().enumerate() {
                *to = a * rows[0][k] + b * rows[1][k];
            }
        }
        blocks
    }

    /// Adds those of another observation.
    pub(super) fn add(&mut self, other: &Self) {
        for (to, from) in self.0[..AT_LANDMARK + D].iter_mut().zip(&other.0) {
            add_to(to, from);
        }
    }

    /// The landmark's own block.
    pub(super) fn landmark(&self) -> SMatrix<f64, D, D> {
        SMatrix::from_fn(|i, k| self.0[AT_LANDMARK + i][AT_LANDMARK + k])
    }

    /// Moves the sums over all observations to the equations of the cameras and, lifted, to the landmark's rows; `host`
    /// is its camera.
    pub(super) fn flush(
        &self,
        cameras: &mut NormalEquations,
        (entry, lifts): (&mut Eliminated<D>, &Lifts),
        host: usize,
    ) {
        let at = unknown_of_camera(host);
        for i in 0..POSE_DIM {
            add_to(&mut cameras.row_mut(at + i)[..POSE_DIM - i], &self.0[i][i..POSE_DIM]);
            cameras.gradient_mut()[at + i] += self.0[i][AT_RESIDUAL];
        }
        let time = &self.0[AT_TIME];
        let row = cameras.row_mut(CAMERA_TIME_OFFSET);
        row[0] += time[AT_TIME];
        add_to(&mut row[at - CAMERA_TIME_OFFSET..][..POSE_DIM], &time[..POSE_DIM]);
        cameras.gradient_mut()[CAMERA_TIME_OFFSET] += time[AT_RESIDUAL];
        for (k, row) in entry.by_visual.iter_mut().enumerate() {
            let blocks = &self.0[AT_LANDMARK + k];
            lifts.add_lifted(host, &std::array::from_fn(|k| blocks[k]), row);
            lifts.add_time_offset(blocks[AT_TIME], row);
            entry.gradient[k] = blocks[AT_RESIDUAL];
        }
    }

    /// Adds the blocks of `target`, the camera that made one observation, to those of the host.
    pub(super) fn add_target(
        &self,
        cameras: &mut NormalEquations,
        (entry, lifts): (&mut Eliminated<D>, &Lifts),
        (host, target): (usize, usize),
    ) {
        let at = unknown_of_camera(target);
        let (first, second) = (unknown_of_camera(host.min(target)), unknown_of_camera(host.max(target)));
        for (i, blocks) in self.0[..POSE_DIM].iter().enumerate() {
            add_to(&mut cameras.row_mut(at + i)[..POSE_DIM - i], &blocks[i..POSE_DIM]);
            // It is symmetric: the same in either order.
            let row = &mut cameras.row_mut(first + i)[second - first - i..];
            subtract_from(&mut row[..POSE_DIM], &blocks[..POSE_DIM]);
            cameras.gradient_mut()[at + i] -= blocks[AT_RESIDUAL];
        }
        let row = cameras.row_mut(CAMERA_TIME_OFFSET);
        subtract_from(&mut row[at - CAMERA_TIME_OFFSET..][..POSE_DIM], &self.0[AT_TIME][..POSE_DIM]);
        for (row, blocks) in entry.by_visual.iter_mut().zip(&self.0[AT_LANDMARK..]) {
            lifts.add_lifted(target, &std::array::from_fn(|k| -blocks[k]), row);
        }
    }
}

/// Adds the blocks of the Manhattan world's heading, from two rows of a landmark of the camera `host`.
pub(super) fn add_heading<const D: usize>(
    cameras: &mut NormalEquations,
    entry: &mut Eliminated<D>,
    rows: &[[f64; COLUMNS]; 2],
    heading: &Vector2<f64>,
    host: usize,
) {
    let mixed = |k: usize| heading[0] * rows[0][k] + heading[1] * rows[1][k];
    let row = cameras.row_mut(CAMERA_HEADING);
    row[0] += heading.norm_squared();
    for (k, to) in row[unknown_of_camera(host) - CAMERA_HEADING..][..POSE_DIM].iter_mut().enumerate() {
        *to += mixed(k);
    }
    cameras.gradient_mut()[CAMERA_HEADING] += mixed(AT_RESIDUAL);
    for (k, row) in entry.by_visual.iter_mut().enumerate() {
        row[HEADING] += mixed(AT_LANDMARK + k);
    }
}

fn add_to(to: &mut [f64], from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from;
    }
}

fn subtract_from(to: &mut [f64], from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to -= from;
    }
}

/// The two rows of an observation, times `scale`. In the camera that hosts it (`is_host_free` is false) a landmark
/// has no derivative by the camera's pose.
pub(super) fn rows<const D: usize>(
    j: &Jacobians<D>,
    r: &Vector2<f64>,
    scale: f64,
    is_host_free: bool,
) -> [[f64; COLUMNS]; 2] {
    let mut rows = [[0.0; COLUMNS]; 2];
    for (d, row) in rows.iter_mut().enumerate() {
        if is_host_free {
            for (k, to) in row[..POSE_DIM].iter_mut().enumerate() {
                *to = j.camera[(d, k)] * scale;
            }
        }
        row[AT_TIME] = j.time_offset[d] * scale;
        for k in 0..D {
            row[AT_LANDMARK + k] = j.landmark[(d, k)] * scale;
        }
        row[AT_RESIDUAL] = r[d] * scale;
    }
    rows
}

#[cfg(test)]
#[path = "hessian_blocks_tests.rs"]
mod tests;
