//! Time offset and rotation between camera and IMU, and the focal lengths, by the rotation that images show.
//!
//! Between two images the camera turned by `omega_c`, the mean rate in its own axes; with the configured extrinsics that is
//! `omega_b = R_bc omega_c`. The gyroscope's mean over the same time, moved by `tau`, is `g(tau)`. With its bias `b` and a
//! small rotation `phi` of the extrinsics:
//!
//! `R_bc diag(1 + k, 1 + k, 1) omega_c = g(tau) - b + phi x g(tau) + n`
//!
//! With focal lengths that are too long by the share `k`, images show less turning by it, but about the optical axis.
//! `tau` is sought on a grid, then all eight unknowns by Gauss-Newton with the Cauchy kernel. Their covariance says whether the
//! motion was enough to know them.

mod judged;

pub(crate) use judged::FOCAL_NAME;
pub use judged::judge;

use crate::statistics::median;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_config::{Config, ImuSample, Timestamp};
use plumbline_estimator::geometry::skew;

/// Fewest rotations that are judged.
const MIN_TURNS: usize = 60;
/// Reach and step of the grid, s.
pub(crate) const REACH_S: f64 = 0.1;
const STEP_S: f64 = 0.002;
/// Steps after the grid.
const STEPS: usize = 10;
/// Residuals of neighbouring images are not independent: standard deviations are taken this much larger.
const INFLATED: f64 = 2.0;
/// Pieces of the recording that are left out in turn: their scatter is the standard deviation of the focal lengths where that is
/// larger than what the fit says.
const PIECES: usize = 8;
/// Steps with a piece left out.
const PIECE_STEPS: usize = 4;
/// Least scatter of the rates that is a motion, rad/s.
const MIN_SCATTER: f64 = 0.05;

/// A rotation that images showed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Stamp of the first image.
    pub from: Timestamp,
    /// Stamp of the second.
    pub to: Timestamp,
    /// Mean rate between, in the left camera's axes, rad/s.
    pub rate_c: Vector3<f64>,
    /// Mean velocity of the camera between, in its axes at the first image, m/s.
    pub velocity_c: Vector3<f64>,
}

/// The gyroscope's rate over time, integrated.
pub(crate) struct Gyro {
    begin: Timestamp,
    times_s: Vec<f64>,
    angles: Vec<Vector3<f64>>,
    rates: Vec<Vector3<f64>>,
}

impl Gyro {
    pub(crate) fn new(samples: &[ImuSample]) -> Option<Self> {
        let begin = samples.first()?.stamp;
        let (mut times_s, mut angles, mut rates) = (Vec::new(), Vec::new(), Vec::<Vector3<f64>>::new());
        let mut angle = Vector3::zeros();
        for sample in samples {
            let time_s = sample.stamp.seconds_since(begin);
            if let (Some(last_s), Some(rate)) = (times_s.last(), rates.last()) {
                let dt_s: f64 = time_s - last_s;
                if dt_s <= 0.0 {
                    continue;
                }
                angle += (rate + sample.gyro) * (0.5 * dt_s);
            }
            times_s.push(time_s);
            angles.push(angle);
            rates.push(sample.gyro);
        }
        Some(Self { begin, times_s, angles, rates })
    }

    /// Integrated angle and rate at a time; `None` outside the samples.
    fn at(&self, time_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let after = self.times_s.partition_point(|t| *t <= time_s);
        let k = after.checked_sub(1).filter(|_| after < self.times_s.len())?;
        let dt_s = time_s - self.times_s[k];
        let share = dt_s / (self.times_s[k + 1] - self.times_s[k]);
        let rate = self.rates[k].lerp(&self.rates[k + 1], share);
        Some((self.angles[k] + (self.rates[k] + rate) * (0.5 * dt_s), rate))
    }

    /// Mean rate during a turn moved by `tau_s`, and its derivative by that.
    pub(crate) fn during(&self, turn: &Turn, tau_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let from_s = turn.from.seconds_since(self.begin) + tau_s;
        let to_s = turn.to.seconds_since(self.begin) + tau_s;
        let ((angle_a, rate_a), (angle_b, rate_b)) = (self.at(from_s)?, self.at(to_s)?);
        let dt_s = to_s - from_s;
        Some(((angle_b - angle_a) / dt_s, (rate_b - rate_a) / dt_s))
    }
}

/// Best agreement.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// `t_imu = t_camera + offset`, s, and its standard deviation.
    pub offset_s: (f64, f64),
    /// Rotation that the configured extrinsics lack, in the body's axes, rad, and the standard deviation of the worst axis.
    pub rotation_b: (Vector3<f64>, f64),
    /// Share by which the configured focal lengths are too long, and its standard deviation.
    pub focal: (f64, f64),
    /// Disagreement that is left without a change of the time offset, over that with it (all else fit in both).
    pub offset_gain: f64,
    /// Residual that the configured extrinsics leave at the best offset, rad/s, median.
    pub residual_rad_s: f64,
    /// Scatter of the rates, rad/s.
    pub scatter_rad_s: f64,
    /// Scatter of the rates about the axis of least turning, rad/s.
    pub least_scatter_rad_s: f64,
}

type Normal = (SMatrix<f64, 8, 8>, SVector<f64, 8>, f64, f64);

struct Problem<'a> {
    turns: &'a [Turn],
    gyro: &'a Gyro,
    rot_b_c: UnitQuaternion<f64>,
}

impl Problem<'_> {
    /// Residuals `omega_b - (g - b + phi x g)` at `x = (phi, b, tau, k)` with their derivatives.
    fn residuals(&self, x: &SVector<f64, 8>) -> Vec<(Vector3<f64>, SMatrix<f64, 3, 8>)> {
        let (phi, bias) = (x.fixed_rows::<3>(0).into_owned(), x.fixed_rows::<3>(3).into_owned());
        let residual = |turn: &Turn| {
            let (rate, by_tau) = self.gyro.during(turn, x[6])?;
            let across_c = Vector3::new(turn.rate_c.x, turn.rate_c.y, 0.0);
            let r = self.rot_b_c * (turn.rate_c + across_c * x[7]) - (rate - bias + phi.cross(&rate));
            let mut jacobian = SMatrix::<f64, 3, 8>::zeros();
            jacobian.fixed_columns_mut::<3>(0).copy_from(&skew(&rate));
            jacobian.fixed_columns_mut::<3>(3).copy_from(&Matrix3::identity());
            jacobian.fixed_columns_mut::<1>(6).copy_from(&-(by_tau + phi.cross(&by_tau)));
            jacobian.fixed_columns_mut::<1>(7).copy_from(&(self.rot_b_c * across_c));
            Some((r, jacobian))
        };
        self.turns.iter().filter_map(residual).collect()
    }

    /// Bias and cost (median of the residuals' norms) for no rotation and this offset.
    fn cost(&self, tau_s: f64) -> Option<(f64, Vector3<f64>)> {
        let mut x = SVector::<f64, 8>::zeros();
        x[6] = tau_s;
        let residuals = self.residuals(&x);
        if residuals.len() < MIN_TURNS {
            return None;
        }
        let axis = |k: usize| median(&residuals.iter().map(|(r, _)| r[k]).collect::<Vec<_>>());
        let middle = Vector3::new(axis(0), axis(1), axis(2));
        let sizes: Vec<f64> = residuals.iter().map(|(r, _)| (r - middle).norm()).collect();
        Some((median(&sizes), -middle))
    }

    /// Normal equations, the scale of the residuals, and the sum of weights.
    fn linearize(&self, x: &SVector<f64, 8>) -> Normal {
        let residuals = self.residuals(x);
        let sizes: Vec<f64> = residuals.iter().map(|(r, _)| r.norm()).collect();
        let scale = (2.0 * median(&sizes)).max(1e-4);
        let mut sums: Normal = (SMatrix::zeros(), SVector::zeros(), 0.0, 0.0);
        for (r, jacobian) in &residuals {
            let weight = 1.0 / (1.0 + r.norm_squared() / (scale * scale));
            sums.0 += jacobian.transpose() * jacobian * weight;
            sums.1 += jacobian.transpose() * r * weight;
            sums.2 += weight * r.norm_squared() / 3.0;
            sums.3 += weight;
        }
        sums
    }
}

impl Problem<'_> {
    /// Solution after some steps from `x`, with the time offset of `x` where that is fixed.
    fn solved(&self, mut x: SVector<f64, 8>, steps: usize, is_offset_fixed: bool) -> Option<SVector<f64, 8>> {
        for _ in 0..steps {
            let (mut h, mut b, ..) = self.linearize(&x);
            if is_offset_fixed {
                h.fixed_rows_mut::<1>(6).fill(0.0);
                h.fixed_columns_mut::<1>(6).fill(0.0);
                (h[(6, 6)], b[6]) = (1.0, 0.0);
            }
            x -= h.cholesky()?.solve(&b);
        }
        Some(x)
    }

    /// Median of the residuals' norms.
    fn disagreement(&self, x: &SVector<f64, 8>) -> f64 {
        median(&self.residuals(x).iter().map(|(r, _)| r.norm()).collect::<Vec<_>>())
    }

    /// Standard deviation of the focal lengths' error by the scatter of solutions with a piece of the recording left out. It holds for
    /// residuals that depend on each other, which the covariance of the fit takes for independent.
    fn focal_sigma(&self, x: &SVector<f64, 8>) -> Option<f64> {
        let piece = self.turns.len().div_ceil(PIECES);
        let without = |k: usize| {
            let (from, to) = (k * piece, ((k + 1) * piece).min(self.turns.len()));
            let turns = [self.turns.get(..from)?, self.turns.get(to..)?].concat();
            Problem { turns: &turns, gyro: self.gyro, rot_b_c: self.rot_b_c }.solved(*x, PIECE_STEPS, false)
        };
        let found = (0..PIECES).map(|k| Some(without(k)?[7])).collect::<Option<Vec<f64>>>()?;
        let mean = found.iter().sum::<f64>() / PIECES as f64;
        let squares: f64 = found.iter().map(|share| (share - mean) * (share - mean)).sum();
        Some((squares * (PIECES as f64 - 1.0) / PIECES as f64).sqrt())
    }
}

/// Time offset and rotation that agree best; `None` without enough motion that images and gyroscope saw.
#[must_use]
pub fn agreement(turns: &[Turn], samples: &[ImuSample], config: &Config) -> Option<Agreement> {
    let rot_b_c = config.camera.first()?.pose_b_c().rotation;
    let gyro = Gyro::new(samples)?;
    let problem = Problem { turns, gyro: &gyro, rot_b_c };
    let (_, scatter) = crate::statistics::mean_and_spread(turns.iter().map(|turn| turn.rate_c));
    let moved = turns.len() >= MIN_TURNS && scatter >= MIN_SCATTER;
    if !moved {
        return None;
    }
    let mut best: Option<(f64, f64, Vector3<f64>)> = None;
    let steps = (REACH_S / STEP_S).round() as i32;
    for k in -steps..=steps {
        let tau_s = config.rig.time_offset_s + f64::from(k) * STEP_S;
        if let Some((cost, bias)) = problem.cost(tau_s)
            && best.is_none_or(|(least, ..)| cost < least)
        {
            best = Some((cost, tau_s, bias));
        }
    }
    let (cost, tau_s, bias) = best?;
    let mut x = SVector::<f64, 8>::zeros();
    x.fixed_rows_mut::<3>(3).copy_from(&bias);
    x[6] = tau_s;
    x = problem.solved(x, STEPS, false)?;
    let mut as_configured = x;
    as_configured[6] = config.rig.time_offset_s;
    let as_configured = problem.solved(as_configured, STEPS, true)?;
    let (h, _, squares, weights) = problem.linearize(&x);
    let variance = squares / weights.max(1.0);
    let covariance = h.cholesky()?.inverse() * (variance * INFLATED * INFLATED);
    let rotation = covariance.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues().max();
    Some(Agreement {
        offset_s: (x[6], covariance[(6, 6)].max(0.0).sqrt()),
        rotation_b: (x.fixed_rows::<3>(0).into_owned(), rotation.max(0.0).sqrt()),
        focal: (x[7], covariance[(7, 7)].max(0.0).sqrt().max(problem.focal_sigma(&x)?)),
        offset_gain: problem.disagreement(&as_configured) / problem.disagreement(&x).max(1e-6),
        residual_rad_s: cost,
        scatter_rad_s: scatter,
        least_scatter_rad_s: least_scatter(turns),
    })
}

/// Scatter of the rates about the axis of least turning, rad/s.
fn least_scatter(turns: &[Turn]) -> f64 {
    let (mean, _) = crate::statistics::mean_and_spread(turns.iter().map(|turn| turn.rate_c));
    let squares = |turn: &Turn| (turn.rate_c - mean) * (turn.rate_c - mean).transpose();
    let covariance = turns.iter().map(squares).sum::<Matrix3<f64>>() / turns.len().max(1) as f64;
    covariance.symmetric_eigenvalues().min().max(0.0).sqrt()
}
