//! Inertial sensors that fail with noise: axes that read nothing, the negative, each other's, or a constant too much.
//!
//! In pieces of two seconds images show how the vehicle turned and accelerated. Each simple fault of a sensor ([`fault`]) says
//! what the sensor then reads, and has a cost in the piece, the mean square of what is left in variances. A sensor fails where
//! pieces one after the other cannot be explained without a fault, and can with it. An axis counts as dead only while its samples
//! are noise alone: a wrong calibration of the cameras makes images show another motion, but no sensor silent. Where another
//! calibration of the cameras explains as much, no sensor is named.

mod fault;
mod moved;
mod piece;
mod words;

pub(crate) use moved::moved;
pub(crate) use words::{judge, reconcile, spoiled};

use crate::agreement::{Turn, agreement};
use crate::plausibility::rotation::assignments;
use InertialSensor::{Accelerometer, Gyroscope};
use fault::Fault;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use piece::Piece;
use plumbline_config::{Config, ImuSample, Timestamp};

/// Lengths of the pieces, s: a smooth motion takes longer ones.
const PIECES_S: [f64; 2] = [2.0, 4.0];
/// Cost of a piece from which it is not explained. Sound recordings, simulated and real, cost up to 1.
const BAD: f64 = 2.5;
/// Sum of the costs of pieces that are enough for a verdict, and the least time that they cover, s.
const ENOUGH: f64 = 12.0;
const MIN_TIME_S: f64 = 4.5;
/// A fault explains a piece where it leaves this share of its cost.
const EXPLAINS: f64 = 0.2;
/// A fault is meant where it explains this share of what the best one explains, and of these the one of least cost, which a mistake
/// increases by so much.
const NEARLY: f64 = 0.7;
const MISTAKE: f64 = 0.4;
/// Tenths of decades of the factors of a wrong baseline.
const BASELINES: std::ops::RangeInclusive<i32> = -13..=10;
/// Error of focal lengths that may be: a larger one hides that axes are dead.
const MAX_FOCAL: f64 = 0.5;

/// An inertial sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum InertialSensor {
    Gyroscope,
    Accelerometer,
}

/// Sensor that fails, how, and since when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Failure {
    sensor: InertialSensor,
    fault: Fault,
    /// Beginning and end of the pieces that show it, s after the first image whose motion is known.
    span_s: [f64; 2],
    /// True if earlier pieces show the sensor without it.
    was_sound: bool,
    /// Motion that images show in the pieces, root mean square: rad/s or m/s².
    motion: f64,
    /// Cost that it explains, and the mean that it leaves in a piece, with that of its mistakes.
    explained: f64,
    score: f64,
}

/// The failures of both sensors.
pub(crate) fn failures(turns: &[Turn], samples: &[ImuSample], config: &Config) -> Vec<Failure> {
    let data = Data { turns, samples, config };
    let of = |sensor| PIECES_S.into_iter().find_map(|piece_s| data.failure(sensor, piece_s));
    let gyroscope = of(Gyroscope);
    // Images that turn otherwise than a sound gyroscope show another acceleration too.
    let is_shown = gyroscope.is_some() || data.unexplained(Gyroscope, PIECES_S[0]) < ENOUGH;
    gyroscope.into_iter().chain(is_shown.then(|| of(Accelerometer)).flatten()).collect()
}

/// What is compared.
#[derive(Clone, Copy)]
struct Data<'a> {
    turns: &'a [Turn],
    samples: &'a [ImuSample],
    config: &'a Config,
}

impl Data<'_> {
    /// The failure of a sensor in pieces of this length, wherever they begin.
    fn failure(self, sensor: InertialSensor, piece_s: f64) -> Option<Failure> {
        let begin = self.turns.first()?.from;
        let shifted = |quarter: u8| {
            let from = begin.plus_seconds(0.25 * f64::from(quarter) * piece_s);
            let turns = &self.turns[self.turns.partition_point(|turn| turn.from < from)..];
            Comparison::of(Self { turns, ..self }, sensor, piece_s).failure(begin)
        };
        let found = shifted(0)?;
        let others = (1..4).filter_map(shifted).filter(|other| other.fault == found.fault);
        let first = least_of_the_best(others.chain([found]).collect(), |failure| failure.span_s[0])?;
        (!self.is_calibration_wrong(sensor, piece_s)).then_some(first)
    }

    fn unexplained(self, sensor: InertialSensor, piece_s: f64) -> f64 {
        Comparison::of(self, sensor, piece_s).unexplained()
    }

    /// True if another calibration of the cameras explains a sensor as well as a fault has to, and the gyroscope no worse: turned a
    /// little with another focal length, turned by right angles, or for the accelerometer with another baseline.
    fn is_calibration_wrong(self, sensor: InertialSensor, piece_s: f64) -> bool {
        let Some(left) = self.config.camera.first() else { return true };
        let rot_b_c = left.pose_b_c().rotation.to_rotation_matrix().into_inner();
        let little = agreement(self.turns, self.samples, self.config).map(|found| {
            let rot_b = UnitQuaternion::from_scaled_axis(-found.rotation_b.0).to_rotation_matrix();
            (rot_b.into_inner(), found.focal.0, 1.0)
        });
        let right_angles = assignments().filter(|axes| axes.determinant() > 0.0).map(|axes| (axes, 0.0, 1.0));
        let factors = BASELINES.filter(|_| sensor == Accelerometer).map(|k| 10_f64.powf(0.1 * f64::from(k)));
        let baselines = factors.map(|factor| (Matrix3::identity(), 0.0, factor));
        let little = little.filter(|(_, focal, _)| focal.abs() <= MAX_FOCAL);
        let limits = [
            (sensor, EXPLAINS * self.unexplained(sensor, piece_s)),
            (Gyroscope, self.unexplained(Gyroscope, piece_s).max(ENOUGH)),
        ];
        little.into_iter().chain(right_angles).chain(baselines).any(|(rot_b, focal, factor)| {
            let rot_c = rot_b_c.transpose() * rot_b * rot_b_c;
            let focal = Vector3::new(1.0 + focal, 1.0 + focal, 1.0);
            let changed = |turn: &Turn| Turn {
                rate_c: rot_c * turn.rate_c.component_mul(&focal),
                velocity_c: rot_c * turn.velocity_c * factor,
                ..*turn
            };
            let turns: Vec<Turn> = self.turns.iter().map(changed).collect();
            let changed = Data { turns: &turns, ..self };
            limits.iter().all(|(sensor, limit)| changed.unexplained(*sensor, piece_s) <= *limit)
        })
    }
}

/// The failure of least value, of those that explain nearly as much as the best one.
fn least_of_the_best(found: Vec<Failure>, value: impl Fn(&Failure) -> f64) -> Option<Failure> {
    let most = found.iter().map(|failure| failure.explained).fold(0.0, f64::max);
    let nearly = found.into_iter().filter(|failure| failure.explained >= NEARLY * most);
    nearly.min_by(|a, b| value(a).total_cmp(&value(b)))
}

/// Pieces of a recording, and their costs without a fault of a sensor.
struct Comparison {
    sensor: InertialSensor,
    gravity_m_s2: f64,
    pieces: Vec<Piece>,
    without: Vec<f64>,
}

impl Comparison {
    fn of(data: Data<'_>, sensor: InertialSensor, piece_s: f64) -> Self {
        let (pieces, gravity_m_s2) = (piece::pieces(data, piece_s), data.config.imu.gravity_m_s2);
        let mut found = Self { sensor, gravity_m_s2, pieces, without: Vec::new() };
        found.without = found.costs(Fault::NONE);
        found
    }

    /// Cost of the pieces that are not explained without a fault.
    fn unexplained(&self) -> f64 {
        self.without.iter().filter(|cost| **cost >= BAD).sum()
    }

    fn costs(&self, fault: Fault) -> Vec<f64> {
        self.pieces.iter().map(|piece| fault.cost(piece, self.sensor, self.gravity_m_s2)).collect()
    }

    /// The fault that explains what is not explained without one.
    fn failure(&self, begin: Timestamp) -> Option<Failure> {
        let best = |fault: Fault| {
            let with = self.costs(fault);
            let is_contradicted = |k: &usize| with[*k] >= BAD && with[*k] > EXPLAINS * self.without[*k];
            let all: Vec<usize> = (0..with.len()).collect();
            let runs = all.split(is_contradicted).filter_map(|run| self.failure_in(run, fault, &with, begin));
            runs.max_by(|a, b| a.explained.total_cmp(&b.explained))
        };
        let is_sound = self.unexplained() < ENOUGH;
        let found = Fault::all().filter(|_| !is_sound).filter_map(best).collect();
        least_of_the_best(found, |failure| failure.score)
    }

    /// The failure in pieces one after the other with these costs, where they are enough for a verdict.
    fn failure_in(&self, run: &[usize], fault: Fault, with: &[f64], begin: Timestamp) -> Option<Failure> {
        let shown: Vec<usize> = run.iter().copied().filter(|k| self.without[*k] >= BAD).collect();
        let (first, last) = (*shown.first()?, *shown.last()?);
        let sum = |of: &dyn Fn(usize) -> f64| shown.iter().map(|k| of(*k)).sum::<f64>();
        let (without, left, count) = (sum(&|k| self.without[k]), sum(&|k| with[k]), shown.len() as f64);
        let seconds = sum(&|k| self.pieces[k].to.seconds_since(self.pieces[k].from));
        let is_enough = without - left >= ENOUGH && left <= EXPLAINS * without && seconds >= MIN_TIME_S;
        is_enough.then(|| Failure {
            sensor: self.sensor,
            fault,
            span_s: [self.pieces[first].from, self.pieces[last].to].map(|at| at.seconds_since(begin)),
            was_sound: (0..first).any(|k| self.without[k] < BAD && with[k] >= BAD),
            motion: (sum(&|k| self.pieces[k].motion_squared(self.sensor)) / count).sqrt(),
            explained: without - left,
            score: left / count + MISTAKE * fault.mistakes(),
        })
    }
}

#[cfg(test)]
mod tests;
