//! Simple faults of the axes of a sensor, and their costs in a piece: what a fault makes of the motion that images show, against the
//! readings.
//!
//! Images show the rotation `R` of the body and its acceleration `p`, but not gravity `g`. The force along axis `k` is
//! `e_k R^T (p - g)`. Unknown are `-g`, whose length is known, and a bias of each axis; both are chosen so that the fault explains the
//! readings best. Without a fault that is the most favourable direction of gravity: what is left is explained by none.

use super::InertialSensor;
use super::piece::Piece;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Standard deviation of a rate that images show, rad/s, and as a share of the rate.
const RATE_SIGMA: (f64, f64) = (0.015, 0.05);
/// Change of the gyroscope's bias since the beginning that is no fault, rad/s, and as a share of the mean rate: cameras may be turned.
const DRIFT: (f64, f64) = (0.03, 0.4);
/// Standard deviation of a force that images show, m/s², and its growth with the rate, m/s² for a rad/s.
const FORCE_SIGMA: (f64, f64) = (0.2, 0.2);
/// Factor on what the scatter of that says: errors of neighbouring images are not independent.
const INFLATED: f64 = 2.0;
/// Standard deviation of a bias of the accelerometer, and of one that is a fault, m/s².
const BIAS_M_S2: f64 = 0.4;
const ANY_BIAS_M_S2: f64 = 100.0;
/// Standard deviation of the magnitude of gravity, m/s².
const GRAVITY_SIGMA_M_S2: f64 = 0.05;
/// Steps towards the direction of gravity, and the standard deviation of one, m/s²: what a piece does not tell of it stays.
const STEPS: usize = 10;
const STEP_M_S2: f64 = 3.0;

/// What axes read instead of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Noise about a constant.
    Dead,
    /// The negative.
    Negated,
    /// The motion of the other of two axes.
    Exchanged,
    /// Too much or too little by a constant.
    Offset,
}

/// Fault of the axes of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) kind: Kind,
    pub(super) axes: [bool; 3],
}

impl Fault {
    /// Nothing is wrong.
    pub(super) const NONE: Self = Self { kind: Kind::Dead, axes: [false; 3] };

    /// All faults.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let kinds =
            [(Kind::Dead, 1..=3), (Kind::Negated, 1..=1), (Kind::Exchanged, 2..=2), (Kind::Offset, 1..=1)];
        kinds.into_iter().flat_map(|(kind, counts)| {
            let all = (1..8_u8).map(move |bits| Self { kind, axes: [0, 1, 2].map(|k| bits >> k & 1 == 1) });
            all.filter(move |fault| counts.contains(&fault.count()))
        })
    }

    /// Number of axes that it is about.
    pub(super) fn count(self) -> usize {
        self.axes.iter().filter(|axis| **axis).count()
    }

    /// Number of mistakes: of two faults that explain the data alike the one of fewer is meant.
    pub(super) fn mistakes(self) -> f64 {
        match self.kind {
            Kind::Dead => self.count() as f64,
            Kind::Negated => 1.1,
            Kind::Exchanged => 1.2,
            Kind::Offset => 0.9,
        }
    }

    /// Axis of the vehicle that axis `k` of the sensor reads, and its sign; `None` where it reads nothing.
    fn source(self, k: usize) -> Option<(usize, f64)> {
        let other = (0..3).find(|other| *other != k && self.axes[*other]);
        match self.kind {
            _ if !self.axes[k] => Some((k, 1.0)),
            Kind::Dead => None,
            Kind::Negated => Some((k, -1.0)),
            Kind::Exchanged => Some((other?, 1.0)),
            Kind::Offset => Some((k, 1.0)),
        }
    }

    /// True if the constant of axis `k` may be any.
    fn is_constant_free(self, k: usize) -> bool {
        matches!(self.kind, Kind::Dead | Kind::Offset) && self.axes[k]
    }

    /// Mean square of what is left in a piece, in variances; infinite where an axis that it takes for dead measures something.
    pub(super) fn cost(self, piece: &Piece, sensor: InertialSensor, gravity_m_s2: f64) -> f64 {
        let is_alive = |k: usize| self.axes[k] && !piece.silent[sensor as usize][k];
        if self.kind == Kind::Dead && (0..3).any(is_alive) {
            return f64::INFINITY;
        }
        match sensor {
            InertialSensor::Gyroscope => of_gyroscope(piece, self),
            InertialSensor::Accelerometer => of_accelerometer(piece, self, gravity_m_s2),
        }
    }
}

fn of_gyroscope(piece: &Piece, fault: Fault) -> f64 {
    let variance =
        RATE_SIGMA.0.powi(2) + RATE_SIGMA.1.powi(2) * piece.motion_squared(InertialSensor::Gyroscope);
    let drift = DRIFT.0 + DRIFT.1 * Vector3::from_fn(|k, _| piece.mean(|moment| moment.shown_rate[k])).norm();
    let of_axis = |k: usize| {
        let left: Vec<f64> = piece
            .moments
            .iter()
            .map(|moment| {
                moment.rate[k] - fault.source(k).map_or(0.0, |(axis, sign)| sign * moment.shown_rate[axis])
            })
            .collect();
        let mean = left.iter().sum::<f64>() / left.len() as f64;
        let drift = if fault.is_constant_free(k) { f64::INFINITY } else { drift };
        let bias = mean.max(piece.bias[k] - drift).min(piece.bias[k] + drift);
        left.iter().map(|left| (left - bias).powi(2)).sum::<f64>() / left.len() as f64 / variance
    };
    (0..3).map(of_axis).sum()
}

/// With the bias and the magnitude of gravity.
fn of_accelerometer(piece: &Piece, fault: Fault, gravity_m_s2: f64) -> f64 {
    let form = form(piece, fault);
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let starts = axes.iter().flat_map(|axis| [*axis, -axis]).map(|axis| axis * gravity_m_s2);
    starts.map(|start| least(&form, start, gravity_m_s2)).fold(f64::INFINITY, f64::min)
}

/// Quadratic form of the residuals in `(-g, bias, 1)`, with what is known of the biases.
fn form(piece: &Piece, fault: Fault) -> SMatrix<f64, 7, 7> {
    let noise = piece.mean(|moment| moment.variance);
    let variance = FORCE_SIGMA.0.powi(2)
        + FORCE_SIGMA.1.powi(2) * piece.motion_squared(InertialSensor::Gyroscope)
        + INFLATED.powi(2) * noise;
    let mut form = SMatrix::zeros();
    for k in 0..3 {
        let sigma = if fault.is_constant_free(k) { ANY_BIAS_M_S2 } else { BIAS_M_S2 };
        form[(3 + k, 3 + k)] = sigma.powi(-2);
        for moment in &piece.moments {
            let mut row = SVector::<f64, 7>::zeros();
            (row[3 + k], row[6]) = (1.0, -moment.force[k]);
            if let Some((axis, sign)) = fault.source(k) {
                row[6] += sign * moment.shown_acceleration[axis];
                row.fixed_rows_mut::<3>(0).copy_from(&(moment.rot_0_b.column(axis) * sign));
            }
            form += row * row.transpose() / (variance * piece.moments.len() as f64);
        }
    }
    form
}

/// The least value of the form near a gravity: its magnitude draws the solution, one linear step after the other.
fn least(form: &SMatrix<f64, 7, 7>, start: Vector3<f64>, gravity_m_s2: f64) -> f64 {
    let (mut up, mut least) = (start, f64::INFINITY);
    let weights = [GRAVITY_SIGMA_M_S2, STEP_M_S2].map(|sigma: f64| sigma.powi(-2));
    for _ in 0..STEPS {
        let Some(along) = up.try_normalize(1e-6) else { break };
        let mut h = form.fixed_view::<6, 6>(0, 0).into_owned();
        let mut b = -form.fixed_view::<6, 1>(0, 6);
        let mut of_gravity = h.fixed_view_mut::<3, 3>(0, 0);
        of_gravity += along * along.transpose() * weights[0] + Matrix3::identity() * weights[1];
        let mut drawn = b.fixed_rows_mut::<3>(0);
        drawn += along * (gravity_m_s2 * weights[0]) + up * weights[1];
        let Some(x) = h.cholesky().map(|h| h.solve(&b)) else { break };
        up = x.fixed_rows::<3>(0).into_owned();
        let off = (up.norm() - gravity_m_s2) / GRAVITY_SIGMA_M_S2;
        let x = x.push(1.0);
        least = least.min(x.dot(&(form * x)) + off * off);
    }
    least
}
