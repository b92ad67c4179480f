//! Trajectories by different clocks: the shift of time at which their motions agree.
//!
//! A live flight is stamped by the monotonic clock of its host, a reference by another. Speed and rate of turn are the same in
//! any frame, so they are compared: the shift is that of the largest normalized correlation of both, over all shifts at
//! which at least half of the shorter trajectory has a counterpart, and of a short one nearly all of it.
//!
//! Magnitudes of short flights agree by chance: of cuts of 3 and 10 s from EuRoC two in five were found in another flight. So the
//! directions are compared at that shift too, each turned by the rotation that fits them best ([`agreement`]).

use super::{EvaluateError, Side};
use nalgebra::{Isometry3, Matrix3, Vector3};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;

/// Time between samples of the motion in the first search, s; longer where a trajectory has more than [`MAX_SAMPLES`].
const STEP_S: f64 = 0.1;
const MAX_SAMPLES: f64 = 6_000.0;
/// The motion at a time is that over this time around it, s.
const SPAN_S: f64 = 0.1;
/// Poses further apart than this have no motion between them, s.
const MAX_GAP_S: f64 = 0.5;
/// Steps of the search around the best shift so far, s.
const FINER_S: [f64; 3] = [0.02, 0.004, 0.001];
/// Steps to either side at each of them, beside the step before.
const STEPS: i32 = 6;
/// Smallest correlation of motions that agree.
const MIN_CORRELATION: f64 = 0.7;
/// Smallest agreement of directions: between flights of EuRoC it is up to 0.79 over 5 s, and within one at least 0.94 (0.91 with noise of
/// 5 mm, but for one cut in twenty that hardly moves).
const MIN_AGREEMENT: f64 = 0.88;
/// Root mean squares of speed (m/s) and rate (rad/s) from which on their directions count.
const TELLING: f64 = 0.05;
/// Length, s, below which nearly all of a trajectory must have a counterpart, and its share.
const SHORT_S: f64 = 20.0;
const NEARLY_ALL: f64 = 0.9;
/// A second shift whose correlation is less below the best one than this leaves it open which is right.
const MIN_LEAD: f64 = 0.005;
/// Shifts further apart than this are different ones, s.
const APART_S: f64 = 2.0;

/// Finds what to add to the stamps of `estimate` so that its motion is that of `reference`, s.
///
/// # Errors
/// When a trajectory is too short, or the motions agree at no shift, or at several.
pub fn find_time_offset(estimate: &[StampedPose], reference: &[StampedPose]) -> Result<f64, EvaluateError> {
    let (estimate, reference) = (Path::of(estimate, Side::Estimate)?, Path::of(reference, Side::Reference)?);
    let longest_s = estimate.length_s().max(reference.length_s());
    let step_s = STEP_S.max(longest_s / MAX_SAMPLES);
    let (of_estimate, of_reference) = (estimate.motions(step_s), reference.motions(step_s));
    let shorter = of_estimate.len().min(of_reference.len());
    let of_short = (NEARLY_ALL * (SHORT_S / step_s).min(shorter as f64)) as usize;
    let overlap = (shorter / 2).max(of_short).max(2);
    let lags = -(of_estimate.len() as i64)..=of_reference.len() as i64;
    let scored: Vec<(f64, f64)> = lags
        .filter_map(|lag| Some((lag as f64 * step_s, at_lag(&of_estimate, &of_reference, lag, overlap)?)))
        .collect();
    let nowhere = |correlation| EvaluateError::NoTimeOffset {
        correlation,
        estimate: estimate.ends(),
        reference: reference.ends(),
    };
    let best = *scored.iter().max_by(|a, b| a.1.total_cmp(&b.1)).ok_or_else(|| nowhere(0.0))?;
    let mut shift_s = best.0;
    for (finer_s, coarser_s) in FINER_S.into_iter().zip([step_s, FINER_S[0], FINER_S[1]]) {
        let reach = (coarser_s / finer_s).ceil() as i32 + STEPS;
        let around = (-reach..=reach).map(|k| shift_s + f64::from(k) * finer_s);
        let score = |shift_s: f64| estimate.correlation(&reference, shift_s).map(|c| (shift_s, c));
        let finest = around.filter_map(score).max_by(|a, b| a.1.total_cmp(&b.1));
        shift_s = finest.map_or(shift_s, |(shift_s, _)| shift_s);
    }
    let correlation = estimate.correlation(&reference, shift_s).unwrap_or(best.1);
    if correlation < MIN_CORRELATION {
        return Err(nowhere(correlation));
    }
    let others = scored.iter().filter(|(other_s, _)| (other_s - best.0).abs() > APART_S);
    if let Some(second) = others.max_by(|a, b| a.1.total_cmp(&b.1))
        && second.1 > best.1 - MIN_LEAD
    {
        let between_s = reference.start_s() - estimate.start_s();
        return Err(EvaluateError::SeveralTimeOffsets(shift_s + between_s, second.0 + between_s));
    }
    let agreement = agreement(&estimate, &reference, shift_s);
    if agreement < MIN_AGREEMENT {
        return Err(nowhere(agreement));
    }
    Ok(shift_s + reference.start_s() - estimate.start_s())
}

/// Agreement of the directions of velocities and of rates when `estimate` begins `shift_s` after `reference`: the smaller of their
/// correlations, each after the rotation that fits best (Wahba's problem). 1 where neither moves enough to tell.
fn agreement(estimate: &Path, reference: &Path, shift_s: f64) -> f64 {
    let step_s = STEP_S.max(reference.length_s() / MAX_SAMPLES);
    let count = (reference.length_s() / step_s) as usize + 1;
    let (mut covariances, mut squares, mut n) = ([Matrix3::zeros(); 2], [[0.0; 2]; 2], 0.0_f64);
    for s in (0..count).map(|k| k as f64 * step_s) {
        let Some((a, b)) = estimate.vectors(s - shift_s).zip(reference.vectors(s)) else { continue };
        n += 1.0;
        for k in 0..2 {
            covariances[k] += a[k] * b[k].transpose();
            squares[k][0] += a[k].norm_squared();
            squares[k][1] += b[k].norm_squared();
        }
    }
    let correlations = (0..2).filter_map(|k| {
        let is_telling = squares[k].iter().all(|square| square / n.max(1.0) > TELLING * TELLING);
        let svd = covariances[k].svd(true, true);
        let (u, v_t) = svd.u.zip(svd.v_t)?;
        let mirrored = (u.determinant() * v_t.determinant()).signum();
        let [first, second, third]: [f64; 3] = svd.singular_values.into();
        is_telling.then(|| (first + second + mirrored * third) / (squares[k][0] * squares[k][1]).sqrt())
    });
    correlations.fold(1.0, f64::min)
}

/// Speed (m/s) and rate of turn (rad/s).
type Motion = [f64; 2];

/// A trajectory in order of time, from its first pose on.
struct Path {
    start_ns: i64,
    poses: Vec<(f64, Isometry3<f64>)>,
}

impl Path {
    fn of(poses: &[StampedPose], side: Side) -> Result<Self, EvaluateError> {
        let first = poses.iter().map(|p| p.stamp).min().ok_or(EvaluateError::Empty(side))?;
        let mut poses: Vec<_> = poses.iter().map(|p| (p.stamp.seconds_since(first), p.pose)).collect();
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        let path = Self { start_ns: first.as_nanos(), poses };
        if path.length_s() < MAX_GAP_S {
            return Err(EvaluateError::TooFew { found: path.poses.len(), needed: 10 });
        }
        Ok(path)
    }

    /// First and last stamp.
    fn ends(&self) -> (Timestamp, Timestamp) {
        let first = Timestamp::from_nanos(self.start_ns);
        (first, first.plus_seconds(self.length_s()))
    }

    fn start_s(&self) -> f64 {
        self.start_ns as f64 * 1e-9
    }

    fn length_s(&self) -> f64 {
        self.poses.last().map_or(0.0, |(s, _)| *s)
    }

    /// The pose at a time, between those around it.
    fn at(&self, s: f64) -> Option<Isometry3<f64>> {
        let next = self.poses.partition_point(|(t, _)| *t <= s);
        let ((t0, before), (t1, after)) = (self.poses.get(next.checked_sub(1)?)?, self.poses.get(next)?);
        if t1 - t0 > MAX_GAP_S {
            return None;
        }
        before.try_lerp_slerp(after, (s - t0) / (t1 - t0), 1e-12)
    }

    /// Velocity in the frame of the trajectory, m/s, and rate of turn in the body, rad/s.
    fn vectors(&self, s: f64) -> Option<[Vector3<f64>; 2]> {
        let (before, after) = (self.at(s - 0.5 * SPAN_S)?, self.at(s + 0.5 * SPAN_S)?);
        let way_m = after.translation.vector - before.translation.vector;
        let turn_rad = before.rotation.rotation_to(&after.rotation);
        let vectors = [way_m / SPAN_S, before.rotation.inverse() * turn_rad.scaled_axis() / SPAN_S];
        vectors.iter().flatten().all(|x| x.is_finite()).then_some(vectors)
    }

    fn motion(&self, s: f64) -> Option<Motion> {
        let (before, after) = (self.at(s - 0.5 * SPAN_S)?, self.at(s + 0.5 * SPAN_S)?);
        let way_m = (after.translation.vector - before.translation.vector).norm();
        let motion = [way_m / SPAN_S, before.rotation.angle_to(&after.rotation) / SPAN_S];
        motion.iter().all(|x| x.is_finite()).then_some(motion)
    }

    /// Motions at whole steps.
    fn motions(&self, step_s: f64) -> Vec<Option<Motion>> {
        let count = (self.length_s() / step_s) as usize + 1;
        (0..count).map(|k| self.motion(k as f64 * step_s)).collect()
    }

    /// Correlation with `other` when this begins so much after it.
    fn correlation(&self, other: &Self, shift_s: f64) -> Option<f64> {
        let step_s = STEP_S.max(other.length_s() / MAX_SAMPLES);
        let count = (other.length_s() / step_s) as usize + 1;
        let times = (0..count).map(|k| k as f64 * step_s);
        correlation(times.filter_map(|s| Some((self.motion(s - shift_s)?, other.motion(s)?))), 2)
    }
}

/// Correlation when sample 0 of `a` falls on sample `lag` of `b`; `None` for fewer than `overlap` samples.
fn at_lag(a: &[Option<Motion>], b: &[Option<Motion>], lag: i64, overlap: usize) -> Option<f64> {
    let from = usize::try_from(lag).unwrap_or(0);
    let skipped = usize::try_from(-lag).unwrap_or(0);
    let pairs = a.iter().skip(skipped).zip(b.iter().skip(from));
    correlation(pairs.filter_map(|(a, b)| Some(((*a)?, (*b)?))), overlap)
}

/// Normalized correlation of motions less their means; `None` for fewer than `overlap`, and where nothing moves.
fn correlation(pairs: impl Iterator<Item = (Motion, Motion)>, overlap: usize) -> Option<f64> {
    let (mut n, mut sums) = (0usize, [[0.0; 5]; 2]);
    for (a, b) in pairs {
        n += 1;
        for (sum, (x, y)) in sums.iter_mut().zip(a.into_iter().zip(b)) {
            for (to, value) in sum.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                *to += value;
            }
        }
    }
    if n < overlap {
        return None;
    }
    let about_mean = |[x, y, xx, yy, xy]: [f64; 5]| {
        let n = n as f64;
        [xx - x * x / n, yy - y * y / n, xy - x * y / n]
    };
    let [first, second] = sums.map(about_mean);
    let [xx, yy, xy] = [0, 1, 2].map(|k| first[k] + second[k]);
    let correlation = xy / (xx * yy).sqrt();
    correlation.is_finite().then_some(correlation)
}

#[cfg(test)]
mod tests {
    use super::super::test_noise::Noise;
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    /// A flight that never repeats itself, seen from `from_s` for `length_s` at `rate_hz`, with noise of millimetres.
    fn flight(from_s: f64, length_s: f64, rate_hz: f64, seed: u64) -> Vec<StampedPose> {
        let mut noise = Noise::new(seed);
        let count = (length_s * rate_hz) as usize;
        let pose = |k: usize| {
            let t = from_s + k as f64 / rate_hz;
            let wave = |f: f64| (f * t + 0.013 * t * t).sin();
            let p = Vector3::new(wave(0.7), 1.5 * wave(0.43), 0.3 * wave(1.3));
            let p = p + Vector3::from_fn(|_, _| 0.001 * noise.normal());
            let rotation =
                UnitQuaternion::from_euler_angles(0.2 * wave(0.9), 0.1 * wave(1.1), 1.2 * wave(0.31));
            let pose = Isometry3::from_parts(Translation3::from(p), rotation);
            StampedPose { stamp: Timestamp::from_nanos((t * 1e9).round() as i64), pose }
        };
        (0..count).map(pose).collect()
    }

    /// The estimate in another frame, its clock behind by `offset_s`.
    fn by_another_clock(mut poses: Vec<StampedPose>, offset_s: f64) -> Vec<StampedPose> {
        let frame = Isometry3::new(Vector3::new(4.0, -2.0, 1.0), Vector3::new(0.0, 0.0, 2.1));
        for p in &mut poses {
            p.pose = frame * p.pose;
            p.stamp = p.stamp.plus_seconds(-offset_s);
        }
        poses
    }

    #[test]
    fn the_shift_between_two_clocks_is_found_to_milliseconds() {
        let reference = flight(0.0, 60.0, 200.0, 1);
        for (from_s, length_s, offset_s) in [(0.0, 60.0, 0.0), (10.0, 30.0, -4321.1234), (12.34, 40.0, 1.7e9)]
        {
            let estimate = by_another_clock(flight(from_s, length_s, 20.0, 2), offset_s);
            let found_s = find_time_offset(&estimate, &reference).unwrap();
            assert!((found_s - offset_s).abs() < 0.004, "{found_s} {offset_s}");
        }
        // The reference may be the shorter one.
        let (estimate, reference) = (flight(0.0, 60.0, 20.0, 1), flight(25.0, 20.0, 100.0, 2));
        assert!(
            (find_time_offset(&by_another_clock(estimate, 77.7), &reference).unwrap() - 77.7).abs() < 0.004
        );
    }

    #[test]
    fn speeds_that_agree_in_other_directions_give_no_shift() {
        let reference = flight(0.0, 40.0, 100.0, 1);
        // Mirrored: every speed and rate of turn is the same.
        let mirrored = flight(5.0, 30.0, 20.0, 2).into_iter().map(|mut p| {
            let (mut position, mut turn) = (p.pose.translation.vector, p.pose.rotation.scaled_axis());
            (position.x, turn.y, turn.z) = (-position.x, -turn.y, -turn.z);
            p.pose = Isometry3::new(position, turn);
            p
        });
        let mirrored: Vec<StampedPose> = mirrored.collect();
        let error = find_time_offset(&mirrored, &reference).unwrap_err();
        assert!(matches!(error, EvaluateError::NoTimeOffset { .. }), "{error}");
        assert!(error.to_string().contains("from 5.000000000 to 34.950000000 s"), "{error}");
    }

    #[test]
    fn motions_that_agree_nowhere_or_twice_give_no_shift() {
        let (reference, other) = (flight(0.0, 40.0, 100.0, 1), flight(500.0, 40.0, 20.0, 2));
        assert!(matches!(find_time_offset(&other, &reference), Err(EvaluateError::NoTimeOffset { .. })));
        let mut twice = flight(0.0, 20.0, 100.0, 1);
        let again = twice.clone().into_iter().map(|p| StampedPose { stamp: p.stamp.plus_seconds(25.0), ..p });
        twice.extend(again);
        let once = flight(0.0, 20.0, 20.0, 2);
        assert!(matches!(find_time_offset(&once, &twice), Err(EvaluateError::SeveralTimeOffsets(..))));
    }
}
