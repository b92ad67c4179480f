//! The Hessian blocks of one landmark (its own, and the mixed ones by the motions), summed over its observations.

use super::camera_sums::{CameraRows, LensRows};
use super::eliminate::{Eliminated, MAX_LANDMARK_DIM};
use super::feature::Jacobians;
use super::motions::{
    LENS, POSED, RESIDUAL, TIME_OFFSET, motion_at, motion_of_camera, motion_of_frame, motion_of_lens,
};
use super::quad::Quad;
use super::state::POSE_DIM;
use nalgebra::{SMatrix, Vector2};

/// Columns of a row by globals and landmark: a multiple of the vector width.
const COLUMNS: usize = POSED + MAX_LANDMARK_DIM;
const AT_LANDMARK: usize = POSED;

/// The rows of an observation, weighed.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    /// By the motions of cameras on their mounts, time offset, residual and landmark.
    by_globals: [[f64; COLUMNS]; 2],
    /// By the motion of the host in `O`, time offset, and residual.
    pub(super) by_camera: CameraRows,
}

impl Rows {
    pub(super) const ZERO: Self = Self { by_globals: [[0.0; COLUMNS]; 2], by_camera: [[0.0; 8]; 2] };

    /// Becomes those of an observation whose Jacobians and residual have been weighed, by the cameras of host and observer. In
    /// the camera that hosts it (`is_host`) a landmark has no derivative by motions.
    #[inline(always)]
    pub(super) fn set<const D: usize>(
        &mut self,
        j: &Jacobians<D>,
        r: &Vector2<f64>,
        (host, target): (u8, u8),
        is_host: bool,
    ) {
        for d in 0..2 {
            let (by_globals, by_camera) = (&mut self.by_globals[d], &mut self.by_camera[d]);
            by_globals[..TIME_OFFSET].fill(0.0);
            *by_camera = [0.0; 8];
            if !is_host {
                by_camera[..POSE_DIM].copy_from_slice(&row(&j.camera[d]));
                let [of_host, of_target] = [host, target].map(|k| motion_of_camera(usize::from(k)));
                if host == target {
                    *motion_at(by_globals, of_host) = row(&difference(&j.host[d], &j.target[d]));
                } else {
                    *motion_at(by_globals, of_host) = row(&j.host[d]);
                    *motion_at(by_globals, of_target) = row(&difference(&ZERO, &j.target[d]));
                }
            }
            (by_globals[TIME_OFFSET], by_globals[RESIDUAL]) = (j.time_offset[d], r[d]);
            (by_camera[POSE_DIM], by_camera[POSE_DIM + 1]) = (j.time_offset[d], r[d]);
            for k in 0..D {
                by_globals[AT_LANDMARK + k] = j.landmark[(d, k)];
            }
        }
    }
}

/// No derivative by a motion.
const ZERO: [Quad; 2] = [[0.0; 4]; 2];

/// `a - b`.
#[inline(always)]
fn difference(a: &[Quad; 2], b: &[Quad; 2]) -> [Quad; 2] {
    [0, 1].map(|i| [0, 1, 2, 3].map(|k| a[i][k] - b[i][k]))
}

/// The six columns of a derivative by a motion.
#[inline(always)]
fn row([p, rot]: &[Quad; 2]) -> [f64; POSE_DIM] {
    [p[0], p[1], p[2], rot[0], rot[1], rot[2]]
}

/// Sums over the observations of a landmark.
#[derive(Clone, Debug)]
pub(super) struct LandmarkSums<const D: usize> {
    by_globals: [[f64; COLUMNS]; D],
    by_host: [[f64; POSE_DIM]; D],
    /// By the intrinsics of both cameras.
    by_lens: [[[f64; LENS]; 2]; D],
}

impl<const D: usize> Default for LandmarkSums<D> {
    fn default() -> Self {
        Self {
            by_globals: [[0.0; COLUMNS]; D],
            by_host: [[0.0; POSE_DIM]; D],
            by_lens: [[[0.0; LENS]; 2]; D],
        }
    }
}

impl<const D: usize> LandmarkSums<D> {
    /// Adds an observation from frame `target`.
    #[inline(always)]
    pub(super) fn add(&mut self, rows: &Rows, target: usize, entry: &mut Eliminated<D>) {
        let [a, b] = &rows.by_globals;
        let [c, d] = &rows.by_camera;
        for r in 0..D {
            let (la, lb) = (a[AT_LANDMARK + r], b[AT_LANDMARK + r]);
            for (k, to) in self.by_globals[r].iter_mut().enumerate() {
                *to += la * a[k] + lb * b[k];
            }
            let mut mixed = [0.0; POSE_DIM];
            for (k, mixed) in mixed.iter_mut().enumerate() {
                *mixed = la * c[k] + lb * d[k];
                self.by_host[r][k] += *mixed;
            }
            let to = motion_at(&mut entry.rows[r], motion_of_frame(target));
            for k in 0..POSE_DIM {
                to[k] -= mixed[k];
            }
        }
    }

    /// Adds the derivatives of that observation by the intrinsics of the observing `camera`.
    #[inline(always)]
    pub(super) fn add_lens(&mut self, rows: &Rows, [by_a, by_b]: &LensRows, camera: usize) {
        let [a, b] = &rows.by_globals;
        for r in 0..D {
            let (la, lb) = (a[AT_LANDMARK + r], b[AT_LANDMARK + r]);
            for k in 0..LENS {
                self.by_lens[r][camera][k] += la * by_a[k] + lb * by_b[k];
            }
        }
    }

    /// Moves the sums to the landmark's rows; `host` is its frame. Returns its own block.
    pub(super) fn finish(&self, entry: &mut Eliminated<D>, host: usize) -> SMatrix<f64, D, D> {
        for (row, by_lens) in entry.rows.iter_mut().zip(&self.by_lens) {
            for (camera, by_lens) in by_lens.iter().enumerate() {
                let at = motion_of_lens(camera);
                row[at..at + LENS].copy_from_slice(by_lens);
            }
        }
        for (row, (globals, by_host)) in entry.rows.iter_mut().zip(self.by_globals.iter().zip(&self.by_host))
        {
            row[..POSED].copy_from_slice(&globals[..POSED]);
            let to = motion_at(row, motion_of_frame(host));
            for k in 0..POSE_DIM {
                to[k] += by_host[k];
            }
        }
        SMatrix::from_fn(|i, k| self.by_globals[i][AT_LANDMARK + k])
    }
}
