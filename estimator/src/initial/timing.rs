//! Delay and readout of the images and bias of the gyroscope, by images and gyroscope alone, before anything else is known.
//!
//! Two views of a point and the translation between them lie in one plane, so with the right rotation the
//! normals `n = f_i x R f_j` of all points are orthogonal to one direction: the smallest eigenvalue of
//! `sum n n'` vanishes. The rotation is that of the gyroscope less its bias, over the time of the images, which is that of their
//! stamps and a delay; each direction `f` is turned from the time of its row to that of the frame. The right values make the sum of these
//! eigenvalues over many pairs smallest. Far from the right delay its gradient says nothing: it is searched on a grid first. Source:
//! Kneip and Lynen, "Direct Optimization of Frame-to-Frame Rotation" (2013); He et al., "Rotation-Translation-Decoupled
//! Initialization" (2023), section IV.

use super::turns::Turns;
use super::{GatheredFrame, find_track};
use crate::geometry::{exp_so3, log_so3, right_jacobian};
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, SymmetricEigen, Vector2, Vector3};
use plumbline_config::{Portable, Timestamp};

/// The delay is searched this far from the one that is told, s: as late as three images at 30 Hz in the buffers of a driver.
pub const SEARCHED_S: f64 = 0.12;
/// Step of the search, s: a hand shakes at up to 10 Hz.
const STEP_S: f64 = 0.02;
/// Gauss-Newton steps at a delay of the search, and from the best one.
const STEPS: [usize; 2] = [3, 12];
/// Pairs are this long, s: long enough for parallax, short enough for many common points.
pub const PAIR_SPAN_S: f64 = 0.25;
/// Scale of the Cauchy kernel, in standard deviations of a bearing.
const ROBUST_SIGMAS: f64 = 3.0;
/// Fewest common points of a pair: three times the unknowns of an epipolar geometry.
const MIN_POINTS: usize = 15;
/// Residuals that tell as much as one: errors of a point that is followed over ten frames hang together.
pub const ALIKE: f64 = 10.0;

/// Bias of the gyroscope, rad/s; then [`DELAY`] and [`READOUT`], s.
pub type Unknowns = SVector<f64, 5>;
/// Place of the delay among the unknowns: what is added to the stamps.
pub const DELAY: usize = 3;
/// Place of the readout, beyond that for which the directions are corrected.
pub const READOUT: usize = 4;

/// Values and their standard deviations.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Values.
    pub values: Unknowns,
    /// Standard deviations; [`SEARCHED_S`] for a delay that is searched.
    pub sigmas: Unknowns,
}

/// Values found.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Values found.
    pub found: Known,
    /// Bias of the gyroscope at the delay and readout that are told, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Mean angle by which points move against far ones within a pair, in standard deviations of a bearing.
    pub parallax: f64,
}

/// A point in a pair of frames.
#[derive(Clone, Copy, Debug)]
pub struct Bearing {
    /// Indices of the frames.
    pub frames: [usize; 2],
    /// Camera that saw it in both.
    pub camera: usize,
    /// Directions in the body frames.
    pub f_b: [Vector3<f64>; 2],
    /// Stamps of the frames.
    pub stamps: [Timestamp; 2],
    /// Places of the rows, -1/2 to 1/2.
    pub row: [f64; 2],
}

/// Sums of all pairs at some values of the unknowns.
#[derive(Clone, Debug, Default)]
struct Sums {
    hessian: SMatrix<f64, 5, 5>,
    gradient: Unknowns,
    /// Robust cost, squared standard deviations, and the residuals in it less the directions of translation.
    cost: f64,
    count: f64,
    /// Lengths of the normals, in standard deviations.
    parallax: f64,
}

/// The memory of an estimate, allocated once.
#[derive(Clone, Debug)]
pub struct TimingWorkspace {
    /// Common points of the pairs, those of a pair together.
    pub bearings: Vec<Bearing>,
    normals: Vec<Vector3<f64>>,
    /// Standard deviation of a direction, rad.
    pub sigma_bearing: f64,
}

impl TimingWorkspace {
    /// Room for `frames` of `points` each, whose directions have the standard deviation `sigma_bearing`, rad.
    pub fn new(frames: usize, points: usize, sigma_bearing: f64) -> Self {
        Self {
            bearings: Vec::with_capacity(frames * points),
            normals: Vec::with_capacity(points),
            sigma_bearing,
        }
    }

    /// Pairs every frame with the first that is [`PAIR_SPAN_S`] later. `rot_b_c` takes directions from each camera to the body, `row` says
    /// how far down the image of a camera a place is, -1/2 to 1/2.
    pub fn find_pairs(
        &mut self,
        frames: &[GatheredFrame],
        rot_b_c: &[Matrix3<f64>; 2],
        row: impl Fn(usize, &Vector2<f64>) -> f64,
    ) {
        self.bearings.clear();
        for (i, first) in frames.iter().enumerate() {
            let stamp = first.time.stamp;
            let is_later = |other: &GatheredFrame| other.time.stamp.seconds_since(stamp) >= PAIR_SPAN_S;
            let Some(j) = (i + 1..frames.len()).find(|j| is_later(&frames[*j])) else { break };
            let second = &frames[j];
            let stamps = [stamp, second.time.stamp];
            self.bearings.extend(first.tracks.iter().filter_map(|t| {
                let other = find_track(second, t.track_id)?;
                (0..2).find_map(|camera| {
                    let both = [t.measured[camera]?.xy, other.measured[camera]?.xy];
                    let unit = |xy: Vector2<f64>| rot_b_c[camera] * Vector3::new(xy.x, xy.y, 1.0).normalize();
                    let (f_b, row) = (both.map(unit), both.map(|xy| row(camera, &xy)));
                    Some(Bearing { frames: [i, j], camera, f_b, stamps, row })
                })
            }));
        }
    }

    /// The values at which the epipolar geometry of the pairs agrees best; `None` without enough common points.
    pub fn estimate(&mut self, turns: &Turns, known: &Known) -> Option<Timing> {
        let (mut held, mut free, mut least) = (*known, *known, f64::INFINITY);
        (held.sigmas[DELAY], held.sigmas[READOUT]) = (1e-9, 1e-9);
        let (told, _) = self.descend(turns, &held, STEPS[1])?;
        let steps = if known.sigmas[DELAY] < SEARCHED_S { 0 } else { (SEARCHED_S / STEP_S).round() as i32 };
        for delay_s in (-steps..=steps).map(|k| f64::from(k) * STEP_S) {
            held.values[DELAY] = delay_s;
            if let Some((_, sums)) = self.descend(turns, &held, STEPS[0])
                && sums.mean_cost() < least
            {
                (least, free.values[DELAY]) = (sums.mean_cost(), delay_s);
            }
        }
        let (values, sums) = self.descend(turns, &free, STEPS[1])?;
        let variance = sums.mean_cost().at_least(1.0);
        let variances = sums.hessian.cholesky()?.inverse().diagonal() * variance;
        let sigmas = variances.map(|variance| variance.at_least(0.0).sqrt());
        Some(Timing {
            found: Known { values, sigmas },
            bias_gyro: told.fixed_rows::<3>(0).into_owned(),
            parallax: sums.parallax / sums.count,
        })
    }

    /// Gauss-Newton from what is known.
    fn descend(&mut self, turns: &Turns, known: &Known, steps: usize) -> Option<(Unknowns, Sums)> {
        let information = known.sigmas.map(|sigma| 1.0 / (sigma * sigma));
        let mut x = known.values;
        let mut sums = self.sums(turns, &x);
        for _ in 0..steps {
            sums.hessian += SMatrix::from_diagonal(&information);
            sums.gradient += information.component_mul(&(x - known.values));
            x -= sums.hessian.cholesky()?.solve(&sums.gradient);
            sums = self.sums(turns, &x);
        }
        sums.hessian += SMatrix::from_diagonal(&information);
        let is_sound = sums.count > 0.0 && x.iter().all(|x| x.is_finite());
        is_sound.then_some((x, sums))
    }

    fn sums(&mut self, turns: &Turns, x: &Unknowns) -> Sums {
        let mut sums = Sums::default();
        let pairs = self.bearings.chunk_by(|a, b| a.stamps == b.stamps);
        for pair in pairs.filter(|pair| pair.len() >= MIN_POINTS) {
            sums.add(pair, turns, x, self.sigma_bearing, &mut self.normals);
        }
        sums
    }
}

impl Sums {
    /// Mean cost of a residual.
    fn mean_cost(&self) -> f64 {
        self.cost / self.count.at_least(1.0)
    }

    /// Adds the normal equations of the residuals `t' [f_i]x R f_j` of a pair, with the direction of translation `t` (the eigenvector of the
    /// smallest eigenvalue) eliminated.
    fn add(
        &mut self,
        pair: &[Bearing],
        turns: &Turns,
        x: &Unknowns,
        sigma_bearing: f64,
        normals: &mut Vec<Vector3<f64>>,
    ) {
        let [from, to] = pair[0].stamps;
        let [Some(first), Some(second)] = [from, to].map(|at| turns.at(at.plus_seconds(x[DELAY]))) else {
            return;
        };
        let bias = x.fixed_rows::<3>(0).into_owned();
        let rot = first.rot.inverse() * second.rot;
        // The bias acts in the axes of the second frame; in the mean they are half a turn before.
        let dt_s = to.seconds_since(from);
        let by_bias = exp_so3(&(log_so3(&rot) * -0.5)).to_rotation_matrix().into_inner() * -dt_s;
        let phi = by_bias * bias;
        let rot = (rot * exp_so3(&phi)).to_rotation_matrix().into_inner();
        let rates = [first.gyro_b - bias, second.gyro_b - bias];
        let by_delay = rates[1] - rot.tr_mul(&rates[0]);
        let rot_by_bias = right_jacobian(&phi) * by_bias;
        let turned =
            |b: &Bearing| [0, 1].map(|k| b.f_b[k] + rates[k].cross(&b.f_b[k]) * (x[READOUT] * b.row[k]));
        normals.clear();
        normals.extend(pair.iter().map(|b| {
            let [f_i, f_j] = turned(b);
            f_i.cross(&(rot * f_j)) / sigma_bearing
        }));
        let Some((t, across)) = translation(normals) else { return };

        let mut h = SMatrix::<f64, 7, 7>::zeros();
        let mut g = SVector::<f64, 7>::zeros();
        for (b, n) in pair.iter().zip(normals.iter()) {
            let e = t.dot(n);
            let weight = weight(e);
            let [f_i, f_j] = turned(b);
            // t . (f_i x R f_j): by a turn of R on the right, and by those of both directions.
            let by_turn = f_j.cross(&rot.tr_mul(&t.cross(&f_i))) / sigma_bearing;
            let by_rows = [0, 1].map(|k| rates[k].cross(&b.f_b[k]) * b.row[k]);
            let by_readout = t.dot(&(by_rows[0].cross(&(rot * f_j)) + f_i.cross(&(rot * by_rows[1]))));
            let mut row = SVector::<f64, 7>::zeros();
            row.fixed_rows_mut::<3>(0).copy_from(&rot_by_bias.tr_mul(&by_turn));
            row[DELAY] = by_delay.dot(&by_turn);
            row[READOUT] = by_readout / sigma_bearing;
            row.fixed_rows_mut::<2>(5).copy_from(&Vector2::new(across[0].dot(n), across[1].dot(n)));
            h += row * row.transpose() * weight;
            g += row * (e * weight);
            self.cost += cost(e);
            self.parallax += n.norm();
        }
        self.count += pair.len() as f64 - 2.0;
        let h_tt = h.fixed_view::<2, 2>(5, 5) + Matrix2::identity() * 1e-9;
        let Some(inverse) = h_tt.try_inverse() else { return };
        let h_xt = h.fixed_view::<5, 2>(0, 5);
        self.hessian += (h.fixed_view::<5, 5>(0, 0) - h_xt * inverse * h_xt.transpose()) / ALIKE;
        self.gradient += (g.fixed_rows::<5>(0) - h_xt * (inverse * g.fixed_rows::<2>(5))) / ALIKE;
    }
}

/// Robust weight of a residual, in standard deviations.
pub fn weight(e: f64) -> f64 {
    1.0 / (1.0 + e.squared() / ROBUST_SIGMAS.squared())
}

/// Robust cost of a residual, in squared standard deviations.
pub fn cost(e: f64) -> f64 {
    ROBUST_SIGMAS.squared() * libm::log1p(e.squared() / ROBUST_SIGMAS.squared())
}

/// Direction of translation by the normals of all points, and two directions across it. Outliers lose weight in a second and third look.
fn translation(normals: &[Vector3<f64>]) -> Option<(Vector3<f64>, [Vector3<f64>; 2])> {
    let mut found: Option<(Vector3<f64>, _)> = None;
    for _ in 0..3 {
        let weighted = |n: &Vector3<f64>| n * n.transpose() * found.map_or(1.0, |(t, _)| weight(t.dot(n)));
        let sum = normals.iter().fold(Matrix3::zeros(), |sum, n| sum + weighted(n));
        let eigen = SymmetricEigen::try_new(sum, f64::EPSILON, 64)?;
        let smallest = eigen.eigenvalues.imin();
        let axis = |k: usize| eigen.eigenvectors.column((smallest + k) % 3).into_owned();
        found = Some((axis(0), [axis(1), axis(2)]));
    }
    found
}
