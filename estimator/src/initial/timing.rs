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
use crate::geometry::{exp_so3, right_jacobian};
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, SymmetricEigen, Vector2, Vector3};
use plumbline_config::{Portable, Timestamp};
use std::ops::Range;

/// The delay is searched this far from the one that is told, s: as late as three images at 30 Hz in the buffers of a driver.
pub const SEARCHED_S: f64 = 0.12;
/// Standard deviation of what is held, s: nothing.
const HELD_S: f64 = 1e-9;
/// Longest readout that is searched, s: a frame at 25 Hz.
pub const MAX_READOUT_S: f64 = 0.04;
/// Step of the search, s: a hand shakes at up to 10 Hz.
const STEP_S: f64 = 0.02;
/// Gauss-Newton steps at a delay of the search, and from the best one.
const STEPS: [usize; 2] = [3, 12];
/// Pairs are this long, s: long enough for parallax, short enough for many common points.
const PAIR_SPAN_S: f64 = 0.25;
/// Scale of the Cauchy kernel, in standard deviations of a bearing.
const ROBUST_SIGMAS: f64 = 3.0;
/// Fewest common points of a pair: three times the unknowns of an epipolar geometry.
const MIN_POINTS: usize = 15;

/// Place of the delay and of the readout among the unknowns, after the bias.
const DELAY: usize = 3;
const READOUT: usize = 4;
/// Bias of the gyroscope, rad/s, delay and readout, s.
type Unknowns = SVector<f64, 5>;

/// A pair of frames.
#[derive(Clone, Debug)]
struct Pair {
    stamps: [Timestamp; 2],
    /// Range of its bearings within [`TimingWorkspace::bearings`].
    bearings: Range<usize>,
}

/// A point's directions in the body frames of both frames of a pair, and the places of their rows, -1/2 to 1/2.
#[derive(Clone, Copy, Debug)]
struct Bearing {
    f_b: [Vector3<f64>; 2],
    row: [f64; 2],
}

/// Sums of all pairs at some values of the unknowns.
#[derive(Clone, Debug, Default)]
struct Sums {
    hessian: SMatrix<f64, 5, 5>,
    gradient: Unknowns,
    /// Robust cost, squared standard deviations, and the residuals in it less the directions of translation.
    cost: f64,
    count: f64,
}

/// The memory of an estimate, allocated once.
#[derive(Clone, Debug)]
pub struct TimingWorkspace {
    pairs: Vec<Pair>,
    bearings: Vec<Bearing>,
    normals: Vec<Vector3<f64>>,
    /// Delay of the search that Gauss-Newton begins with, s.
    centre_s: f64,
}

/// Values known before, with standard deviations: bias of the gyroscope, rad/s, readout, s, and how well the delay is, s.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Bias.
    pub bias_gyro: (Vector3<f64>, f64),
    /// Readout beyond that which the directions are corrected for.
    pub readout_s: (f64, f64),
    /// Standard deviation of the delay, about zero; infinite where it is searched.
    pub delay_s: f64,
}

/// Values found.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Bias of the gyroscope, rad/s, and its standard deviation, that of all axes together.
    pub bias_gyro: Vector3<f64>,
    /// See there.
    pub bias_sigma: f64,
    /// Delay: what is added to the stamps, and its standard deviation, s.
    pub delay_s: (f64, f64),
    /// Readout and its standard deviation, s.
    pub readout_s: (f64, f64),
    /// Mean squared residual, in squared standard deviations.
    pub variance: f64,
    /// Standard deviations by which a delay of zero contradicts the images.
    pub contradiction: f64,
}

impl TimingWorkspace {
    /// Room for `frames` of `points` each.
    #[must_use]
    pub fn new(frames: usize, points: usize) -> Self {
        let bearings = frames * points;
        Self {
            pairs: Vec::with_capacity(frames),
            bearings: Vec::with_capacity(bearings),
            normals: Vec::with_capacity(points),
            centre_s: 0.0,
        }
    }

    /// Pairs every frame with the first that is [`PAIR_SPAN_S`] later. `rot_b_c` takes directions from each camera to the body, `row` says
    /// how far down the image of a camera a place is, -1/2 to 1/2, and `delay_s` is what the stamps of a frame lack.
    pub fn find_pairs(
        &mut self,
        frames: &[GatheredFrame],
        rot_b_c: &[Matrix3<f64>; 2],
        row: impl Fn(usize, &Vector2<f64>) -> f64,
        delay_s: impl Fn(&GatheredFrame) -> f64,
    ) {
        self.pairs.clear();
        self.bearings.clear();
        for (i, first) in frames.iter().enumerate() {
            let is_later =
                |other: &&GatheredFrame| other.time.stamp.seconds_since(first.time.stamp) >= PAIR_SPAN_S;
            let Some(second) = frames[i + 1..].iter().find(is_later) else { continue };
            let begin = self.bearings.len();
            self.bearings.extend(first.tracks.iter().filter_map(|t| {
                let other = find_track(second, t.track_id)?;
                (0..2).find_map(|c| {
                    let both = [t.measured[c]?.xy, other.measured[c]?.xy];
                    let unit = |xy: Vector2<f64>| rot_b_c[c] * Vector3::new(xy.x, xy.y, 1.0).normalize();
                    Some(Bearing { f_b: both.map(unit), row: both.map(|xy| row(c, &xy)) })
                })
            }));
            if self.bearings.len() - begin < MIN_POINTS {
                self.bearings.truncate(begin);
                continue;
            }
            let stamps = [first, second].map(|frame| frame.time.stamp.plus_seconds(delay_s(frame)));
            self.pairs.push(Pair { stamps, bearings: begin..self.bearings.len() });
        }
    }

    /// The values at which the epipolar geometry of the pairs agrees best; `None` without enough common points. `sigma_bearing` is the
    /// standard deviation of a bearing, rad.
    #[must_use]
    pub fn estimate(&mut self, turns: &Turns, known: &Known, sigma_bearing: f64) -> Option<Timing> {
        let told = self.descend(turns, known, Some(0.0), STEPS[1], sigma_bearing)?;
        let mut best = (told.1.mean_cost(), 0.0);
        let steps = if known.delay_s.is_finite() { 0 } else { (SEARCHED_S / STEP_S).round() as i32 };
        for delay_s in (-steps..=steps).map(|k| f64::from(k) * STEP_S) {
            if let Some((_, sums)) = self.descend(turns, known, Some(delay_s), STEPS[0], sigma_bearing)
                && sums.mean_cost() < best.0
            {
                best = (sums.mean_cost(), delay_s);
            }
        }
        let free = Known { delay_s: known.delay_s.at_most(SEARCHED_S), ..*known };
        self.centre_s = best.1;
        let (x, sums) = self.descend(turns, &free, None, STEPS[1], sigma_bearing)?;
        let variance = sums.mean_cost().at_least(1.0);
        let covariance = sums.hessian.cholesky()?.inverse() * variance;
        let variance_of = |k: usize| covariance[(k, k)].at_least(0.0);
        let excess = (told.1.mean_cost() - sums.mean_cost()).at_least(0.0) * sums.count;
        Some(Timing {
            bias_gyro: x.fixed_rows::<3>(0).into_owned(),
            bias_sigma: (0..3).map(variance_of).sum::<f64>().sqrt(),
            delay_s: (x[DELAY], variance_of(DELAY).sqrt()),
            readout_s: (x[READOUT], variance_of(READOUT).sqrt()),
            variance,
            contradiction: (excess / variance).sqrt(),
        })
    }

    /// Gauss-Newton from what is known; the delay is held where it is given.
    fn descend(
        &mut self,
        turns: &Turns,
        known: &Known,
        held_s: Option<f64>,
        steps: usize,
        sigma_bearing: f64,
    ) -> Option<(Unknowns, Sums)> {
        let ((bias, bias_sigma), (readout_s, readout_sigma_s)) = (known.bias_gyro, known.readout_s);
        let delay_sigma_s = if held_s.is_some() { HELD_S } else { known.delay_s };
        let sigmas = Unknowns::new(bias_sigma, bias_sigma, bias_sigma, delay_sigma_s, readout_sigma_s);
        let information = sigmas.map(|sigma| 1.0 / (sigma * sigma));
        let centre = Unknowns::new(bias.x, bias.y, bias.z, held_s.unwrap_or(self.centre_s), readout_s);
        let mut x = centre;
        let mut sums = self.sums(turns, &x, sigma_bearing);
        for _ in 0..steps {
            sums.hessian += SMatrix::from_diagonal(&information);
            sums.gradient += information.component_mul(&(x - centre));
            x -= sums.hessian.cholesky()?.solve(&sums.gradient);
            sums = self.sums(turns, &x, sigma_bearing);
        }
        sums.hessian += SMatrix::from_diagonal(&information);
        let is_sound = sums.count > 0.0 && x.iter().all(|x| x.is_finite());
        is_sound.then_some((x, sums))
    }

    fn sums(&mut self, turns: &Turns, x: &Unknowns, sigma_bearing: f64) -> Sums {
        let mut sums = Sums::default();
        let Self { pairs, bearings, normals, .. } = self;
        for pair in pairs.iter() {
            pair.add_to(&mut sums, turns, &bearings[pair.bearings.clone()], x, sigma_bearing, normals);
        }
        sums
    }
}

impl Sums {
    /// Mean cost of a residual.
    fn mean_cost(&self) -> f64 {
        self.cost / self.count.at_least(1.0)
    }
}

impl Pair {
    /// Adds the normal equations of the residuals `t' [f_i]x R f_j`, with the direction of translation `t` (the eigenvector of the smallest
    /// eigenvalue) eliminated.
    fn add_to(
        &self,
        sums: &mut Sums,
        turns: &Turns,
        bearings: &[Bearing],
        x: &Unknowns,
        sigma_bearing: f64,
        normals: &mut Vec<Vector3<f64>>,
    ) {
        let [Some(first), Some(second)] = self.stamps.map(|at| turns.at(at.plus_seconds(x[DELAY]))) else {
            return;
        };
        let bias = x.fixed_rows::<3>(0).into_owned();
        let by_bias = first.to_by_bias(&second);
        let phi = by_bias * bias;
        let rot = (first.rot.inverse() * second.rot * exp_so3(&phi)).to_rotation_matrix().into_inner();
        let rates = [first.gyro_b - bias, second.gyro_b - bias];
        let by_delay = rates[1] - rot.tr_mul(&rates[0]);
        let rot_by_bias = right_jacobian(&phi) * by_bias;
        let turned =
            |b: &Bearing| [0, 1].map(|k| b.f_b[k] + rates[k].cross(&b.f_b[k]) * (x[READOUT] * b.row[k]));
        normals.clear();
        normals.extend(bearings.iter().map(|b| {
            let [f_i, f_j] = turned(b);
            f_i.cross(&(rot * f_j)) / sigma_bearing
        }));
        let Some((t, across)) = translation(normals) else { return };

        let mut h = SMatrix::<f64, 7, 7>::zeros();
        let mut g = SVector::<f64, 7>::zeros();
        for (b, n) in bearings.iter().zip(normals.iter()) {
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
            sums.cost += ROBUST_SIGMAS * ROBUST_SIGMAS * libm::log1p(e * e / (ROBUST_SIGMAS * ROBUST_SIGMAS));
        }
        sums.count += bearings.len() as f64 - 2.0;
        let h_tt = h.fixed_view::<2, 2>(5, 5) + Matrix2::identity() * 1e-9;
        let Some(inverse) = h_tt.try_inverse() else { return };
        let h_xt = h.fixed_view::<5, 2>(0, 5);
        sums.hessian += h.fixed_view::<5, 5>(0, 0) - h_xt * inverse * h_xt.transpose();
        sums.gradient += g.fixed_rows::<5>(0) - h_xt * (inverse * g.fixed_rows::<2>(5));
    }
}

/// Robust weight of a residual.
fn weight(e: f64) -> f64 {
    1.0 / (1.0 + e * e / (ROBUST_SIGMAS * ROBUST_SIGMAS))
}

/// Direction of translation by the normals of all points, and two directions across it. Outliers lose weight in a second and third look.
fn translation(normals: &[Vector3<f64>]) -> Option<(Vector3<f64>, [Vector3<f64>; 2])> {
    let mut found = None;
    for _ in 0..3 {
        let mut sum = Matrix3::zeros();
        for n in normals {
            let weight = found.map_or(1.0, |(t, _): (Vector3<f64>, _)| weight(t.dot(n)));
            sum += n * n.transpose() * weight;
        }
        let eigen = SymmetricEigen::try_new(sum, f64::EPSILON, 64)?;
        let smallest = eigen.eigenvalues.imin();
        let axis = |k: usize| eigen.eigenvectors.column((smallest + k) % 3).into_owned();
        found = Some((axis(0), [axis(1), axis(2)]));
    }
    found
}
