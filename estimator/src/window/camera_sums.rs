//! The Hessian blocks (`J'J` and `J'r`) of observations by the motions of cameras and the time offset, summed
//! over the landmarks before anything is done with them.
//!
//! Moved alike in `O`, host and observer see the same: so the derivative of a reprojection by the observer's camera is
//! that by the host's with the other sign, and the products of one short row are all of an observation's blocks. They are
//! summed for each pair of cameras. Landmarks come in runs of the same host: the sums of its pairs are moved on when
//! the next host begins.

use super::motions::{
    GLOBALS, LENS, Lifts, MAX_MOTIONS, MotionEquations, MotionRow, POSED, RESIDUAL, TIME_OFFSET, motion_at,
    motion_of_camera, motion_of_frame, motion_of_lens,
};
use super::state::{MAX_FRAMES, POSE_DIM};
use super::tiles::{LANES, add_times};

/// Columns of an observation: motion of the host's camera in `O`, time offset, residual.
pub(super) const COLUMNS: usize = 8;
const AT_TIME: usize = POSE_DIM;
const AT_RESIDUAL: usize = AT_TIME + 1;
/// Most cameras of all frames.
const MAX_CAMERAS: usize = 2 * MAX_FRAMES;

/// Both rows of an observation by its columns.
pub(super) type CameraRows = [[f64; COLUMNS]; 2];
/// Both rows of an observation by the intrinsics of the observing camera.
pub(super) type LensRows = [[f64; LENS]; 2];

/// Products of columns, summed; the upper triangle counts, but for the square of the residual.
#[derive(Clone, Debug)]
struct Products([[f64; COLUMNS]; AT_RESIDUAL]);

impl Products {
    const ZERO: Self = Self([[0.0; COLUMNS]; AT_RESIDUAL]);

    #[inline]
    fn add(&mut self, [a, b]: &CameraRows) {
        for (i, to) in self.0.iter_mut().enumerate() {
            for k in i / LANES * LANES..COLUMNS {
                to[k] += a[i] * a[k] + b[i] * b[k];
            }
        }
    }

    /// Products by the motion, a whole symmetric block.
    fn motion(&self) -> [[f64; POSE_DIM]; POSE_DIM] {
        std::array::from_fn(|i| std::array::from_fn(|k| self.0[i.min(k)][i.max(k)]))
    }
}

/// Products of columns and of intrinsics by those of the intrinsics, summed.
#[derive(Clone, Debug)]
struct LensProducts {
    mixed: [[f64; LENS]; COLUMNS],
    own: [[f64; LENS]; LENS],
}

impl LensProducts {
    const ZERO: Self = Self { mixed: [[0.0; LENS]; COLUMNS], own: [[0.0; LENS]; LENS] };

    #[inline]
    fn add(&mut self, [a, b]: &CameraRows, [la, lb]: &LensRows) {
        for (to, (a, b)) in self.mixed.iter_mut().zip(a.iter().zip(b)) {
            for k in 0..LENS {
                to[k] += a * la[k] + b * lb[k];
            }
        }
        for (to, (a, b)) in self.own.iter_mut().zip(la.iter().zip(lb)) {
            for k in 0..LENS {
                to[k] += a * la[k] + b * lb[k];
            }
        }
    }

    /// Adds what is said of intrinsics, time offset and residual alone.
    fn move_to(&self, equations: &mut MotionEquations, at: usize) {
        for (row, own) in self.own.iter().enumerate() {
            add_times(&mut equations.rows[at + row][at..at + LENS], 1.0, own);
        }
        for (global, mixed) in [TIME_OFFSET, RESIDUAL].into_iter().zip(&self.mixed[AT_TIME..]) {
            add_times(&mut equations.rows[global][at..at + LENS], 1.0, mixed);
        }
    }
}

/// Sums over observations by pairs of cameras, and rows of the normal equations by each camera's motion in `O`.
#[derive(Clone, Debug)]
pub struct CameraSums {
    host: usize,
    /// By the observing camera.
    pairs: Vec<Products>,
    lenses: Vec<LensProducts>,
    is_seen: [bool; MAX_CAMERAS],
    rows: Vec<[MotionRow; POSE_DIM]>,
}

impl Default for CameraSums {
    /// Room for any window.
    fn default() -> Self {
        Self {
            host: 0,
            pairs: vec![Products::ZERO; MAX_CAMERAS],
            lenses: vec![LensProducts::ZERO; MAX_CAMERAS],
            is_seen: [false; MAX_CAMERAS],
            rows: vec![[[0.0; MAX_MOTIONS]; POSE_DIM]; MAX_CAMERAS],
        }
    }
}

impl CameraSums {
    /// Starts anew with the cameras of `frames`, `cameras` of each.
    pub(super) fn reset(&mut self, frames: usize, cameras: usize) {
        let dim = motion_of_frame(frames).next_multiple_of(LANES);
        for row in self.rows[..frames * cameras].iter_mut().flatten() {
            row[..dim].fill(0.0);
        }
    }

    /// The landmarks that follow are hosted by camera `host` (of all).
    pub(super) fn begin_host(&mut self, host: usize, lifts: &Lifts, equations: &mut MotionEquations) {
        if host != self.host {
            self.flush(lifts, equations);
            self.host = host;
        }
    }

    /// Adds an observation by camera `target`.
    #[inline]
    pub(super) fn add(&mut self, target: usize, rows: &CameraRows, by_lens: Option<&LensRows>) {
        self.pairs[target].add(rows);
        if let Some(by_lens) = by_lens {
            self.lenses[target].add(rows, by_lens);
        }
        self.is_seen[target] = true;
    }

    /// Adds all sums to `equations`.
    pub(super) fn finish(&mut self, lifts: &Lifts, equations: &mut MotionEquations) {
        self.flush(lifts, equations);
        let dim = equations.dim.next_multiple_of(LANES);
        for (camera, rows) in self.rows[..lifts.in_o.len()].iter().enumerate() {
            let at = motion_of_frame(camera / lifts.cameras);
            for (k, row) in rows.iter().enumerate() {
                add_times(&mut equations.rows[at + k][GLOBALS..dim], 1.0, &row[GLOBALS..dim]);
                for global in [TIME_OFFSET, RESIDUAL] {
                    equations.rows[global][at + k] += row[global];
                }
                if equations.has_lenses {
                    for (lens, sum) in equations.rows[POSED..GLOBALS].iter_mut().zip(&row[POSED..GLOBALS]) {
                        lens[at + k] += sum;
                    }
                }
            }
            let on_mount = motion_of_camera(camera % lifts.cameras);
            for (row, by) in rows.iter().zip(&lifts.in_o[camera]) {
                for (k, by) in by.iter().enumerate() {
                    add_times(&mut equations.rows[on_mount + k][..dim], *by, &row[..dim]);
                }
            }
        }
    }

    /// Moves the sums of the present host to the rows of its cameras.
    fn flush(&mut self, lifts: &Lifts, equations: &mut MotionEquations) {
        let Self { host, pairs, lenses, is_seen, rows } = self;
        let host = *host;
        for (target, products) in pairs.iter_mut().enumerate() {
            if std::mem::take(&mut is_seen[target]) {
                let time_offset = &mut equations.rows[TIME_OFFSET];
                time_offset[TIME_OFFSET] += products.0[AT_TIME][AT_TIME];
                time_offset[RESIDUAL] += products.0[AT_TIME][AT_RESIDUAL];
                if target != host {
                    add_pair(rows, [host, target], products, lifts);
                }
                if equations.has_lenses {
                    let (at, lens) = (motion_of_lens(target % lifts.cameras), &mut lenses[target]);
                    lens.move_to(equations, at);
                    // A motion of the observer has the opposite sign of one of the host.
                    for (camera, sign) in [(host, 1.0), (target, -1.0)].into_iter().filter(|_| target != host)
                    {
                        for (row, mixed) in rows[camera].iter_mut().zip(&lens.mixed) {
                            add_times(&mut row[at..at + LENS], sign, mixed);
                        }
                    }
                    *lens = LensProducts::ZERO;
                }
                *products = Products::ZERO;
            }
        }
    }
}

/// Rows of host and observer: a motion of either is that of its frame and that on its mount.
fn add_pair(
    rows: &mut [[MotionRow; POSE_DIM]],
    [host, target]: [usize; 2],
    products: &Products,
    lifts: &Lifts,
) {
    let motion = products.motion();
    let [by_host, by_target] = [host, target].map(|camera| times(&motion, &lifts.in_o[camera]));
    // All six before any is read again: they are written in pieces, and would be waited for.
    let globals: [[f64; POSED]; POSE_DIM] = std::array::from_fn(|i| {
        let mut globals = [0.0; POSED];
        add(motion_at(&mut globals, motion_of_camera(host % lifts.cameras)), 1.0, &by_host[i]);
        add(motion_at(&mut globals, motion_of_camera(target % lifts.cameras)), -1.0, &by_target[i]);
        globals[TIME_OFFSET] = products.0[i][AT_TIME];
        globals[RESIDUAL] = products.0[i][AT_RESIDUAL];
        globals
    });
    for ([own, other], sign) in [([host, target], 1.0), ([target, host], -1.0)] {
        let [of_own, of_other] = [own, other].map(|camera| motion_of_frame(camera / lifts.cameras));
        for (i, row) in rows[own].iter_mut().enumerate() {
            add_times(&mut row[..POSED], sign, &globals[i]);
            add(motion_at(row, of_own), 1.0, &motion[i]);
            add(motion_at(row, of_other), -1.0, &motion[i]);
        }
    }
}

/// `a b`.
fn times(a: &[[f64; POSE_DIM]; POSE_DIM], b: &[[f64; POSE_DIM]; POSE_DIM]) -> [[f64; POSE_DIM]; POSE_DIM] {
    a.map(|row| {
        let mut out = [0.0; POSE_DIM];
        for (factor, b) in row.iter().zip(b) {
            for k in 0..POSE_DIM {
                out[k] += factor * b[k];
            }
        }
        out
    })
}

/// `to += sign from`.
#[inline]
fn add(to: &mut [f64; POSE_DIM], sign: f64, from: &[f64; POSE_DIM]) {
    for k in 0..POSE_DIM {
        to[k] += sign * from[k];
    }
}
