//! Pieces of a recording: what images and inertial samples say about the same moments.

use super::{Data, InertialSensor};
use crate::agreement::{Gyro, Turn};
use crate::scale::between;
use crate::statistics::median;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{ImuSample, Timestamp};

/// Pieces of a smaller share of their length are not looked at, nor such of fewer moments.
const MIN_SHARE: f64 = 0.6;
const MIN_MOMENTS: usize = 8;
/// Images further apart end a piece, s.
const MAX_GAP_S: f64 = 0.15;
/// An acceleration is the slope of the velocities within this time on either side, s.
const SLOPE_S: f64 = 0.11;
/// Length of a mean of samples, s, and the means that are needed to tell noise.
const MEAN_S: f64 = 0.1;
const MIN_MEANS: usize = 8;
/// Standard deviation of the means over that of white noise, up to which it is noise alone: a few means tell it to a quarter, and a
/// filter in the sensor makes neighbours alike.
const WHITE: f64 = 2.0;
/// Scatter of readings that is as good as none, rad/s and m/s².
pub(super) const FLOORS: (f64, f64) = (0.002, 0.02);

/// One moment of a piece.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Rate in the body by the images, and by the gyroscope, rad/s.
    pub(super) shown_rate: Vector3<f64>,
    pub(super) rate: Vector3<f64>,
    /// Rotation from the body to what it was at the beginning of the piece.
    pub(super) rot_0_b: Matrix3<f64>,
    /// Acceleration of the IMU by the images, in the body, m/s².
    pub(super) shown_acceleration: Vector3<f64>,
    /// Variance of one component of it, by how the velocities scatter about their slope.
    pub(super) variance: f64,
    /// Specific force by the accelerometer, over the same time, m/s².
    pub(super) force: Vector3<f64>,
}

/// Part of a recording.
#[derive(Debug)]
pub(super) struct Piece {
    pub(super) from: Timestamp,
    pub(super) to: Timestamp,
    pub(super) moments: Vec<Moment>,
    /// Axes of gyroscope and accelerometer whose readings are noise alone.
    pub(super) silent: [[bool; 3]; 2],
    /// What the gyroscope reads too much in the first third of the recording, rad/s, median.
    pub(super) bias: Vector3<f64>,
}

/// The pieces of this length in which images show the motion without a gap.
pub(super) fn pieces(data: Data<'_>, piece_s: f64) -> Vec<Piece> {
    let (Some(left), Some(gyro)) = (data.config.camera.first(), Gyro::new(data.samples)) else {
        return Vec::new();
    };
    let mut found = Vec::<Piece>::new();
    let mut rest = data.turns;
    while let Some(first) = rest.first() {
        let goes_on = |pair: &&[Turn]| {
            pair[1].to.seconds_since(first.from) <= piece_s
                && pair[1].from.seconds_since(pair[0].to) <= MAX_GAP_S
        };
        let (turns, after) = rest.split_at(1 + rest.windows(2).take_while(goes_on).count());
        let piece = Piece::of(Data { turns, ..data }, &gyro, &left.pose_b_c());
        found.extend(piece.filter(|piece| piece.to.seconds_since(piece.from) >= MIN_SHARE * piece_s));
        rest = after;
    }
    let early = || found[..found.len().div_ceil(3)].iter().flat_map(|piece| &piece.moments);
    let off = |k: usize| early().map(|moment| moment.rate[k] - moment.shown_rate[k]).collect::<Vec<_>>();
    let bias = Vector3::from_fn(|k, _| median(&off(k)));
    found.iter_mut().for_each(|piece| piece.bias = bias);
    found
}

impl Piece {
    /// Mean over the moments.
    pub(super) fn mean(&self, of: impl Fn(&Moment) -> f64) -> f64 {
        self.moments.iter().map(of).sum::<f64>() / self.moments.len() as f64
    }

    /// Mean square of the motion that images show.
    pub(super) fn motion_squared(&self, sensor: InertialSensor) -> f64 {
        self.mean(|moment| match sensor {
            InertialSensor::Gyroscope => moment.shown_rate.norm_squared(),
            InertialSensor::Accelerometer => moment.shown_acceleration.norm_squared(),
        })
    }

    fn of(Data { turns, samples, config }: Data<'_>, gyro: &Gyro, pose_b_c: &Isometry3<f64>) -> Option<Self> {
        let (from, to, offset_s) = (turns.first()?.from, turns.last()?.to, config.rig.time_offset_s);
        let within = |from: Timestamp, to: Timestamp| {
            between(samples, from.plus_seconds(offset_s), to.plus_seconds(offset_s))
        };
        let path = path(turns, pose_b_c);
        let moment = |(turn, step): (&Turn, &Step)| {
            let (acceleration_0, variance) = slope(&path, step.at)?;
            let near = within(step.at.plus_seconds(-SLOPE_S), step.at.plus_seconds(SLOPE_S));
            Some(Moment {
                shown_rate: pose_b_c.rotation * turn.rate_c,
                rate: gyro.during(turn, offset_s)?.0,
                rot_0_b: step.rot_0_b.to_rotation_matrix().into_inner(),
                shown_acceleration: step.rot_0_b.inverse() * acceleration_0,
                variance,
                force: (!near.is_empty()).then(|| mean(near.iter().map(|sample| sample.accel)))?,
            })
        };
        let moments: Vec<Moment> = turns.iter().zip(&path).filter_map(moment).collect();
        let samples = within(from, to);
        let silent = [
            silent(samples, |sample| sample.gyro / FLOORS.0),
            silent(samples, |sample| sample.accel / FLOORS.1),
        ];
        (moments.len() >= MIN_MOMENTS).then_some(Self { from, to, moments, silent, bias: Vector3::zeros() })
    }
}

/// Orientation and velocity in the middle of a turn, in the axes of the beginning of its piece.
struct Step {
    at: Timestamp,
    rot_0_b: UnitQuaternion<f64>,
    velocity_0: Vector3<f64>,
}

/// The path of the IMU that images show.
fn path(turns: &[Turn], pose_b_c: &Isometry3<f64>) -> Vec<Step> {
    let lever = pose_b_c.translation.vector;
    let mut rot_0_b = UnitQuaternion::identity();
    let step = |(k, turn): (usize, &Turn)| {
        let (rate, dt_s) = (pose_b_c.rotation * turn.rate_c, turn.to.seconds_since(turn.from));
        let from = rot_0_b;
        let after = |seconds: f64| from * UnitQuaternion::from_scaled_axis(rate * seconds);
        let next_s = turns.get(k + 1).map_or(dt_s, |next| next.from.seconds_since(turn.from));
        rot_0_b = after(next_s);
        // The camera is not where the IMU is.
        let by_turning = (after(dt_s) * lever - from * lever) / dt_s;
        Step {
            at: turn.from.plus_seconds(0.5 * dt_s),
            rot_0_b: after(0.5 * dt_s),
            velocity_0: from * (pose_b_c.rotation * turn.velocity_c) - by_turning,
        }
    };
    turns.iter().enumerate().map(step).collect()
}

/// Acceleration at a time, the slope of the velocities around it, with its variance; `None` at the ends.
fn slope(path: &[Step], at: Timestamp) -> Option<(Vector3<f64>, f64)> {
    let around = path.iter().map(|step| (step.at.seconds_since(at), step.velocity_0));
    let around: Vec<_> = around.filter(|(after_s, _)| after_s.abs() <= SLOPE_S).collect();
    let is_inside = around.first()?.0 < 0.0 && around.last()?.0 > 0.0;
    let (slope, left, squares) = line(&around);
    let scatter = left.sum() / (3.0 * (around.len() as f64 - 2.0));
    is_inside.then_some((slope, scatter / squares))
}

/// Axes whose readings are noise alone; a scatter of 1 is as good as none.
///
/// Half the mean square of the differences from sample to sample is the variance `s²` of a white noise, and hardly knows of a motion.
/// Means of `n` samples of such a noise scatter about a straight line with the variance `s² / n`; those of a sensor that measures
/// a motion scatter by the motion too.
fn silent(samples: &[ImuSample], of: impl Fn(&ImuSample) -> Vector3<f64>) -> [bool; 3] {
    let Some((scatter, white)) = scatter(samples, of) else { return [false; 3] };
    [0, 1, 2].map(|k| scatter[k] <= limit_of_noise(white[k]))
}

/// Variance up to which means are those of noise alone.
pub(super) fn limit_of_noise(white: f64) -> f64 {
    WHITE * WHITE * (white + 0.25)
}

/// Variance of the means of each axis about a straight line, and that of white noise; `None` of too few samples.
pub(super) fn scatter(
    samples: &[ImuSample],
    of: impl Fn(&ImuSample) -> Vector3<f64>,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let [first, .., last] = samples else { return None };
    let readings: Vec<Vector3<f64>> = samples.iter().map(of).collect();
    let steps = readings.len() as f64 - 1.0;
    let each = ((MEAN_S * steps / last.stamp.seconds_since(first.stamp)).round() as usize).max(1);
    let of_mean = |(k, chunk): (usize, &[Vector3<f64>])| (k as f64, mean(chunk.iter().copied()));
    let means: Vec<_> = readings.chunks_exact(each).enumerate().map(of_mean).collect();
    let squares: Vector3<f64> =
        readings.windows(2).map(|pair| (pair[1] - pair[0]).map(|step| step * step)).sum();
    let white = squares * (0.5 / steps / each as f64);
    (means.len() >= MIN_MEANS).then(|| (line(&means).1 / (means.len() as f64 - 2.0), white))
}

fn mean(values: impl ExactSizeIterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let count = values.len() as f64;
    values.sum::<Vector3<f64>>() / count
}

/// Slope of the straight line through points, the squares that it leaves by axis, and those of the times about their mean.
fn line(points: &[(f64, Vector3<f64>)]) -> (Vector3<f64>, Vector3<f64>, f64) {
    let middle = points.iter().map(|(t, _)| t).sum::<f64>() / points.len() as f64;
    let mean = mean(points.iter().map(|(_, value)| *value));
    let squares: f64 = points.iter().map(|(t, _)| (t - middle).powi(2)).sum();
    let slope = points.iter().map(|(t, value)| value * (t - middle)).sum::<Vector3<f64>>() / squares;
    let left = |(t, value): &(f64, Vector3<f64>)| (value - mean - slope * (t - middle)).map(|off| off * off);
    (slope, points.iter().map(left).sum(), squares)
}
