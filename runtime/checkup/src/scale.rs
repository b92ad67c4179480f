//! The scale of the pair of cameras against that of the accelerometer.
//!
//! Over two seconds the velocity of the IMU is `v_0 + g t + w(t)` with `w`, the integral of the specific force turned by the
//! gyroscope. The images show it times a factor `f`, that of the configured distance between the cameras over the true one:
//!
//! `u(t) = f (v_0 + g t + w(t)) + n`
//!
//! Start, gravity and what biases add over so short a time are a polynomial of second order in `t`; it is taken out of both, and
//! `f` is the regression of what is left of `u` by what is left of `w`. Many such pieces give its standard deviation. A smooth flight
//! leaves too little in two seconds; pieces of four seconds are taken then. A piece that fits the others far worse than they fit each
//! other is left out: a blow, or images that show a motion of something else.

use crate::agreement::Turn;
use crate::statistics::median;
use crate::verdict::{Fitness, Measure};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use plumbline_config::options::rows_from_isometry;
use plumbline_config::{Config, ImuSample, Timestamp};

/// Name of the measure.
pub const NAME: &str = "scale";
/// Length of a piece, s, the shortest that tells the factor; and the fewest rotations in it and pieces.
const PIECES_S: [f64; 2] = [2.0, 4.0];
const MIN_TURNS: usize = 24;
const MIN_PIECES: usize = 3;
/// Root mean square of what is left of `w` in a piece that tells the scale, m/s.
const MIN_MOTION_M_S: f64 = 0.02;
/// Samples further apart end a piece, s.
const MAX_GAP_S: f64 = 0.05;
/// Errors of neighbouring images are not independent: the standard deviation by them is taken this much larger.
const INFLATED: f64 = 2.0;
/// Standard deviation up to which the factor is known.
const KNOWN: f64 = 0.05;
/// Deviation of the factor from 1: minded beyond the first, not fit beyond the second, each with three standard deviations more.
const OFF: (f64, f64) = (0.03, 0.06);

/// A piece is left out where it fits so many times worse than the median one and by so much, m/s. Beyond this share nothing is known.
const OUTLIER: f64 = 4.0;
const OUTLIER_M_S: f64 = 0.05;
const MAX_LEFT_OUT: f64 = 0.4;
/// Weight of a piece for the first guess of the factor, over the median of all.
const MAX_WEIGHT: f64 = 3.0;

/// Sums of a piece: `w w`, `w u`, `u u`, how many numbers, and its beginning.
#[derive(Clone, Copy)]
struct Piece {
    ww: f64,
    wu: f64,
    uu: f64,
    count: f64,
    from: Timestamp,
}

impl Piece {
    /// Root mean square of what the factor leaves, m/s.
    fn left(&self, factor: f64) -> f64 {
        let squares = self.uu - factor * (2.0 * self.wu - factor * self.ww);
        (squares.max(0.0) / self.count).sqrt()
    }
}

/// Factor by which the images show the motion larger than the accelerometer, and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleFactor {
    /// 1 where the distance between the cameras is right.
    pub value: f64,
    /// Factor with all noise in the images, not in the accelerometer: the true one lies between this and `value`.
    pub upper: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// Pieces that tell it, and their length, s.
    pub pieces: (usize, f64),
    /// Pieces that were left out, and the beginning of the first of them, s after the first image.
    pub left_out: Option<(usize, f64)>,
    /// True if these are too many.
    pub is_disputed: bool,
}

/// The factor; `None` where the vehicle hardly accelerated.
#[must_use]
pub fn factor(turns: &[Turn], samples: &[ImuSample], config: &Config) -> Option<ScaleFactor> {
    let pose_b_c = config.camera.first()?.pose_b_c();
    let bias = bias(turns, samples, &pose_b_c, config.rig.time_offset_s)?;
    PIECES_S.into_iter().find_map(|piece_s| factor_of(turns, samples, (&pose_b_c, &bias), config, piece_s))
}

/// The factor by pieces of this length.
fn factor_of(
    turns: &[Turn],
    samples: &[ImuSample],
    (pose_b_c, bias): (&Isometry3<f64>, &Vector3<f64>),
    config: &Config,
    piece_s: f64,
) -> Option<ScaleFactor> {
    let mut pieces = Vec::new();
    let mut rest = turns;
    while let Some(first) = rest.first() {
        let is_within = |turn: &&Turn| turn.to.seconds_since(first.from) <= piece_s;
        let count = rest.iter().take_while(is_within).count().max(1);
        let (piece, after) = rest.split_at(count);
        if count >= MIN_TURNS {
            pieces.extend(of_piece(piece, samples, pose_b_c, (bias, config.rig.time_offset_s)));
        }
        rest = after;
    }
    let all = pieces.len() as f64;
    let (mut pieces, left_out) = without_outliers(pieces);
    let is_moving = |piece: &Piece| (piece.ww / piece.count).sqrt() >= MIN_MOTION_M_S;
    pieces.retain(is_moving);
    if pieces.len() < MIN_PIECES - usize::from(!left_out.is_empty()) {
        return None;
    }
    let is_disputed = left_out.len() as f64 > MAX_LEFT_OUT * all;
    let (ww, wu) = pieces.iter().fold((0.0, 0.0), |sum, piece| (sum.0 + piece.ww, sum.1 + piece.wu));
    let value = wu / ww;
    let begin = turns.first()?.from;
    let left_out = left_out.first().map(|first| (left_out.len(), first.from.seconds_since(begin)));
    // By what each piece says apart.
    let squares: f64 = pieces.iter().map(|piece| (piece.wu - value * piece.ww).powi(2)).sum();
    let by_pieces = (squares * pieces.len() as f64 / (pieces.len() - 1) as f64).sqrt() / ww;
    // By what is left of all numbers, which are not independent.
    let left: f64 = pieces.iter().map(|piece| piece.uu - value * (2.0 * piece.wu - value * piece.ww)).sum();
    let count: f64 = pieces.iter().map(|piece| piece.count).sum();
    let sigma = by_pieces.max(INFLATED * (left.max(0.0) / count / ww).sqrt());
    let upper = pieces.iter().map(|piece| piece.uu).sum::<f64>() / wu;
    Some(ScaleFactor { value, upper, sigma, pieces: (pieces.len(), piece_s), left_out, is_disputed })
}

/// Pieces that agree on a factor, and those that fit it far worse.
fn without_outliers(pieces: Vec<Piece>) -> (Vec<Piece>, Vec<Piece>) {
    let factor = middle_factor(&pieces);
    let usual = median(&pieces.iter().map(|piece| piece.left(factor)).collect::<Vec<_>>());
    let limit = OUTLIER * usual.max(OUTLIER_M_S / OUTLIER);
    pieces.into_iter().partition(|piece| piece.left(factor) <= limit)
}

/// Median of the factors of single pieces, weighted by their motion.
fn middle_factor(pieces: &[Piece]) -> f64 {
    let most = MAX_WEIGHT * median(&pieces.iter().map(|piece| piece.ww).collect::<Vec<_>>());
    let mut factors: Vec<(f64, f64)> =
        pieces.iter().map(|piece| (piece.wu / piece.ww, piece.ww.min(most))).collect();
    factors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * factors.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut below = 0.0;
    let middle = factors.iter().find(|(_, weight)| {
        below += weight;
        below >= half
    });
    middle.map_or(f64::NAN, |(factor, _)| *factor)
}

/// Bias of the gyroscope by what the images turn less, rad/s.
fn bias(
    turns: &[Turn],
    samples: &[ImuSample],
    pose_b_c: &Isometry3<f64>,
    offset_s: f64,
) -> Option<Vector3<f64>> {
    let differences: Vec<Vector3<f64>> = turns
        .iter()
        .filter_map(|turn| {
            let within = between(samples, turn.from.plus_seconds(offset_s), turn.to.plus_seconds(offset_s));
            let sum: Vector3<f64> = within.iter().map(|sample| sample.gyro).sum();
            (!within.is_empty()).then(|| sum / within.len() as f64 - pose_b_c.rotation * turn.rate_c)
        })
        .collect();
    let axis = |k: usize| median(&differences.iter().map(|difference| difference[k]).collect::<Vec<_>>());
    let bias = Vector3::new(axis(0), axis(1), axis(2));
    bias.iter().all(|value| value.is_finite()).then_some(bias)
}

/// The samples of a time.
pub(crate) fn between(samples: &[ImuSample], from: Timestamp, to: Timestamp) -> &[ImuSample] {
    let begin = samples.partition_point(|sample| sample.stamp < from);
    let end = samples.partition_point(|sample| sample.stamp < to).max(begin);
    &samples[begin..end]
}

/// Orientation of the body against that at the start of a piece, and the integral of the turned specific force.
struct Inertial {
    times_s: Vec<f64>,
    rotations: Vec<UnitQuaternion<f64>>,
    velocities: Vec<Vector3<f64>>,
}

impl Inertial {
    fn of(samples: &[ImuSample], bias: &Vector3<f64>, begin: Timestamp) -> Option<Self> {
        let mut path = Self { times_s: Vec::new(), rotations: Vec::new(), velocities: Vec::new() };
        let (mut rotation, mut velocity) = (UnitQuaternion::identity(), Vector3::zeros());
        let mut last: Option<(&ImuSample, Vector3<f64>)> = None;
        for sample in samples {
            if let Some((before, force)) = last {
                let dt_s = sample.stamp.seconds_since(before.stamp);
                if !(dt_s > 0.0 && dt_s < MAX_GAP_S) {
                    return None;
                }
                rotation *=
                    UnitQuaternion::from_scaled_axis((0.5 * (before.gyro + sample.gyro) - bias) * dt_s);
                velocity += 0.5 * (force + rotation * sample.accel) * dt_s;
            }
            last = Some((sample, rotation * sample.accel));
            path.times_s.push(sample.stamp.seconds_since(begin));
            path.rotations.push(rotation);
            path.velocities.push(velocity);
        }
        Some(path)
    }

    /// Orientation and velocity at a time; `None` outside the samples.
    fn at(&self, time_s: f64) -> Option<(UnitQuaternion<f64>, Vector3<f64>)> {
        let after = self.times_s.partition_point(|t| *t <= time_s);
        let k = after.checked_sub(1).filter(|_| after < self.times_s.len())?;
        let share = (time_s - self.times_s[k]) / (self.times_s[after] - self.times_s[k]);
        let rotation = self.rotations[k].nlerp(&self.rotations[after], share);
        Some((rotation, self.velocities[k].lerp(&self.velocities[after], share)))
    }

    /// Mean velocity over a time, by Simpson's rule.
    fn mean_velocity(&self, from_s: f64, to_s: f64) -> Option<Vector3<f64>> {
        let [a, b, c] = [from_s, 0.5 * (from_s + to_s), to_s].map(|time_s| self.at(time_s));
        Some((a?.1 + 4.0 * b?.1 + c?.1) / 6.0)
    }
}

fn of_piece(
    turns: &[Turn],
    samples: &[ImuSample],
    pose_b_c: &Isometry3<f64>,
    (bias, offset_s): (&Vector3<f64>, f64),
) -> Option<Piece> {
    let (first, last) = (turns.first()?, turns.last()?);
    let begin = first.from.plus_seconds(offset_s);
    let margin_s = 2.0 * MAX_GAP_S;
    let within = between(samples, begin.plus_seconds(-margin_s), last.to.plus_seconds(offset_s + margin_s));
    let path = Inertial::of(within, bias, begin)?;
    let lever = pose_b_c.translation.vector;
    let (mut times, mut shown, mut measured) = (Vec::new(), Vec::new(), Vec::new());
    for turn in turns {
        let (from_s, to_s) = (turn.from.seconds_since(first.from), turn.to.seconds_since(first.from));
        let ((rot_from, _), (rot_to, _)) = (path.at(from_s)?, path.at(to_s)?);
        let dt_s = to_s - from_s;
        // The camera is not where the IMU is.
        let by_turning = (rot_to * lever - rot_from * lever) / dt_s;
        times.push(0.5 * (from_s + to_s));
        shown.push(rot_from * (pose_b_c.rotation * turn.velocity_c) - by_turning);
        measured.push(path.mean_velocity(from_s, to_s)?);
    }
    let (shown, measured) = (without_trend(&times, &shown)?, without_trend(&times, &measured)?);
    let mut piece = Piece { ww: 0.0, wu: 0.0, uu: 0.0, count: 3.0 * times.len() as f64, from: first.from };
    for (u, w) in shown.iter().zip(&measured) {
        piece.ww += w.norm_squared();
        piece.wu += w.dot(u);
        piece.uu += u.norm_squared();
    }
    Some(piece)
}

/// Residuals of the values from a polynomial of second order.
fn without_trend(times_s: &[f64], values: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
    let middle = 0.5 * (times_s.first()? + times_s.last()?);
    let powers = |t: f64| Vector3::new(1.0, t - middle, (t - middle) * (t - middle));
    let (mut normal, mut right) = (Matrix3::zeros(), Matrix3::zeros());
    for (t, value) in times_s.iter().zip(values) {
        normal += powers(*t) * powers(*t).transpose();
        right += powers(*t) * value.transpose();
    }
    let fit = normal.cholesky()?.solve(&right);
    Some(times_s.iter().zip(values).map(|(t, value)| value - fit.transpose() * powers(*t)).collect())
}

/// Judges the scale. Focal lengths that are off (`focal` is the verdict on them) make images show another motion.
#[must_use]
pub fn judge(turns: &[Turn], samples: &[ImuSample], config: &Config, focal: Fitness) -> Measure {
    const MOVE: &str =
        "fly, or move the vehicle by hand to and fro by half a metre, twice a second, for ten seconds";
    let Some(found) = factor(turns, samples, config) else {
        return Measure::missing(NAME, "the vehicle hardly accelerated while images showed its motion", MOVE);
    };
    let ScaleFactor { value, upper, sigma, pieces: (pieces, piece_s), .. } = found;
    let baseline = baseline_m(config);
    let without = found.left_out.map_or_else(String::new, |(count, from_s)| {
        format!(
            ", without {count} in which they contradict each other (the first from {from_s:.0} s after the first image: a blow, or a step of \
             the accelerometer)"
        )
    });
    let words = format!(
        "images show the motion {value:.3} times as large as the accelerometer, within {sigma:.3}, in {pieces} pieces of {piece_s} \
         s{without}"
    );
    let figures = [("factor", value), ("sigma", sigma), ("baseline_m", baseline)];
    let verdict = Fitness::within((value - 1.0).abs(), OFF.0 + 3.0 * sigma, OFF.1 + 3.0 * sigma);
    if verdict > Fitness::Good && (value..upper).contains(&1.0) {
        let cure = "readings of the accelerometer scatter by more than its motion: look at its vibration first, then measure again";
        return Measure::new(NAME, Fitness::Uncertain, words, cure, &figures);
    }
    if found.is_disputed || sigma > KNOWN * value.abs().max(1.0) && verdict != Fitness::NotFit {
        return Measure::new(NAME, Fitness::Uncertain, words, MOVE, &figures);
    }
    if verdict > Fitness::Good && focal > Fitness::Good {
        let cure = "correct the focal lengths first, then measure again: while they are off, depth and baseline are no measurement";
        return Measure::new(NAME, verdict, words, cure, &figures);
    }
    let is_factor = value > 0.05 && value < 20.0;
    let condition =
        if focal == Fitness::Uncertain { "if the focal lengths are right (uncertain here): " } else { "" };
    let cure = match repaired(config, value).filter(|_| is_factor) {
        Some(line) => format!(
            "{condition}the distance between the cameras (baseline) is probably {:.4} m, not {baseline:.4} m: set {line} of the second \
             [[camera]], or calibrate the cameras again; or the accelerometer's scale is wrong",
            baseline / value
        ),
        None => "images and accelerometer do not show one motion: look at the axes of the IMU, at `camera.pose_b_c`, and at stamps"
            .to_owned(),
    };
    Measure::new(NAME, verdict, words, cure, &figures)
}

fn baseline_m(config: &Config) -> f64 {
    let [left, right] = config.camera.as_slice() else { return f64::NAN };
    (left.pose_b_c().inverse() * right.pose_b_c()).translation.vector.norm()
}

/// The line of the configuration for the right camera, whose distance from the left one is divided by `factor`.
fn repaired(config: &Config, factor: f64) -> Option<String> {
    let [left, right] = config.camera.as_slice() else { return None };
    let mut pose = right.pose_b_c();
    let from = left.pose_b_c().translation.vector;
    pose.translation.vector = from + (pose.translation.vector - from) / factor;
    let number = |value: &f64| format!("{value:.9}");
    let row = |row: &[f64; 4]| format!("[{}]", row.iter().map(number).collect::<Vec<_>>().join(", "));
    let rows: Vec<String> = rows_from_isometry(&pose).iter().map(row).collect();
    Some(format!("`pose_b_c = [{}]`", rows.join(", ")))
}
