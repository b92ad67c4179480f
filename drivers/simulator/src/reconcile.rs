//! A recorded path made to agree with the inertial samples that were recorded along it.
//!
//! A tracker's path and an inertial sensor know different things. The path is right over seconds, and jumps and shakes from
//! sample to sample (up to 80 mm in one step in EuRoC's machine hall; attitudes of the Vicon rooms by several milliradians).
//! The sensor is right over tenths of a second and drifts. Images for real samples must be seen from where the sensor really
//! was, so the two are joined, each where it is the better one:
//!
//! 1. Jumps of the path are taken out ([`Trajectory::from_poses`]); the clock offset between path and samples is measured by
//!    the angular rates, and removed.
//! 2. The constant biases and the tilt of the path's vertical against gravity (9.5 mrad in EuRoC's V2 sequences) are measured
//!    by the means of the specific force over half a second, and removed.
//! 3. Rates are integrated over the whole flight. What leads from the integral to the path is a slow curve, a spline with
//!    knots [`ATTITUDE_KNOT_S`] apart that ignores outliers: below 0.25 Hz attitudes are those of the path, above it those of
//!    the gyroscope. Forces are integrated twice, and led to the path with knots [`POSITION_KNOT_S`] apart: below 1 Hz
//!    positions are those of the path, above it those of the accelerometer.
//!
//! So the errors of the real sensor that matter to a window of seconds stay what they are: biases, scale, coloured force error
//! up to 1 Hz. What a force error does faster than that (1 mm and less) the path takes over, and the images with it.

use super::spline::Spline;
use super::trajectory::{MotionState, Trajectory};
use nalgebra::{Isometry3, Matrix5, Matrix5x1, Translation3, UnitQuaternion, Vector3};
use plumbline_config::{ImuSample, Timestamp, median};
use plumbline_drivers::StampedPose;

/// Knots of the curve that leads from integrated rates to the attitudes of the path, s.
const ATTITUDE_KNOT_S: f64 = 2.0;
/// Knots of the curve that leads from integrated forces to the positions of the path, s.
const POSITION_KNOT_S: f64 = 0.5;
/// Beyond this an attitude of the path is an outlier, rad.
const ATTITUDE_OUTLIER_RAD: f64 = 0.003;
/// Beyond this a position of the path is an outlier, m.
const POSITION_OUTLIER_M: f64 = 0.003;
/// Rounds in which outliers lose their weight.
const ROUNDS: usize = 8;
/// Specific forces are compared by their means over so many samples.
const FORCE_BLOCK: usize = 100;
/// A mean force beyond this off the model is an outlier, m/s².
const FORCE_OUTLIER_M_S2: f64 = 0.1;
/// Pieces of the flight whose clock offsets are measured apart, samples; the median of them counts.
const OFFSET_BLOCK: usize = 2000;
/// Largest clock offset at which path and samples can be of one flight, s.
const MAX_OFFSET_S: f64 = 0.02;
/// Largest median of the difference between the rates of path and gyroscope, rad/s: those of EuRoC differ by 0.02.
const MAX_RATE_DIFFERENCE_RAD_S: f64 = 0.2;
/// Fewest samples: ten seconds of them.
const MIN_SAMPLES: usize = 2000;

/// The flight that path and samples agree on.
#[derive(Clone, Debug)]
pub(super) struct Reconciled {
    /// The flight, on the time axis of the samples, in a world whose vertical is that of gravity.
    pub(super) flight: Trajectory,
    /// Mean gyroscope bias, rad/s.
    pub(super) bias_gyro: Vector3<f64>,
    /// Mean accelerometer bias, m/s².
    pub(super) bias_accel: Vector3<f64>,
    /// Range of the samples that lie within the path.
    pub(super) within: std::ops::Range<usize>,
}

/// Joins `poses` and `samples`, both in order of time.
///
/// # Errors
/// Says why they cannot be of one flight.
pub(super) fn reconcile(
    poses: &[StampedPose],
    samples: &[ImuSample],
    gravity_m_s2: f64,
) -> Result<Reconciled, String> {
    let path = Trajectory::from_poses(poses).ok_or("the path needs at least eight poses in order of time")?;
    let rough = within(samples, path.begin(), path.end());
    let (offset_s, bias_gyro) = offset_and_bias(&path, &samples[rough])?;
    let begin = path.begin().plus_seconds(-offset_s);
    let range = within(samples, begin, path.end().plus_seconds(-offset_s));
    let samples = &samples[range.clone()];
    let recorded: Vec<MotionState> =
        samples.iter().map(|s| path.motion(s.stamp.plus_seconds(offset_s))).collect();
    let attitudes = attitudes(samples, &recorded, &bias_gyro);
    let (bias_accel, tilt) = force_model(samples, &recorded, &attitudes, gravity_m_s2)?;
    let level = levelled(&tilt, gravity_m_s2);
    let attitudes: Vec<_> = attitudes.into_iter().map(|q| level * q).collect();
    let targets: Vec<_> = recorded.iter().map(|m| level * m.pose_w_b.translation.vector).collect();
    let up = Vector3::new(0.0, 0.0, gravity_m_s2);
    let forces: Vec<_> =
        samples.iter().zip(&attitudes).map(|(s, q)| q * (s.accel - bias_accel) - up).collect();
    let positions = positions(samples, &forces, &targets);
    let pose = |((s, p), q): ((&ImuSample, Vector3<f64>), UnitQuaternion<f64>)| StampedPose {
        stamp: s.stamp,
        pose: Isometry3::from_parts(Translation3::from(p), q),
    };
    let joined: Vec<_> = samples.iter().zip(positions).zip(attitudes).map(pose).collect();
    let flight = Trajectory::through(&joined).ok_or("the samples are not in order of time")?;
    Ok(Reconciled { flight, bias_gyro, bias_accel, within: range })
}

/// Indices of the samples from `begin` to `end`.
fn within(samples: &[ImuSample], begin: Timestamp, end: Timestamp) -> std::ops::Range<usize> {
    let from = samples.partition_point(|s| s.stamp < begin);
    from..samples.partition_point(|s| s.stamp <= end).max(from)
}

/// Time of the path minus time of the samples (s), and the mean gyroscope bias.
fn offset_and_bias(path: &Trajectory, samples: &[ImuSample]) -> Result<(f64, Vector3<f64>), String> {
    if samples.len() < MIN_SAMPLES {
        let count = samples.len();
        return Err(format!(
            "{count} samples lie within the path, {MIN_SAMPLES} are needed; is it another flight?"
        ));
    }
    let rate = |s: &ImuSample, by_s: f64| path.motion(s.stamp.plus_seconds(by_s)).omega_b;
    let differences: Vec<_> = samples.iter().map(|s| s.gyro - rate(s, 0.0)).collect();
    let bias = Vector3::from_fn(|axis, _| median(differences.iter().map(|d| d[axis])).unwrap_or(0.0));
    let spread = median(differences.iter().map(|d| (d - bias).norm())).unwrap_or(0.0);
    if spread > MAX_RATE_DIFFERENCE_RAD_S {
        return Err(format!(
            "the rates of path and samples differ by {spread:.2} rad/s; is it another flight?"
        ));
    }
    let step_s = 1e-3;
    let offsets = samples.chunks_exact(OFFSET_BLOCK).zip(differences.chunks_exact(OFFSET_BLOCK));
    let offsets = offsets.map(|(samples, differences)| {
        let (mut above, mut below) = (0.0, 1e-9);
        for (sample, difference) in samples.iter().zip(differences) {
            let slope = (rate(sample, step_s) - rate(sample, -step_s)) / (2.0 * step_s);
            above += slope.dot(&(difference - bias));
            below += slope.norm_squared();
        }
        above / below
    });
    let offset_s = median(offsets).unwrap_or(0.0);
    if offset_s.abs() > MAX_OFFSET_S {
        return Err(format!("the clocks of path and samples differ by {:.1} ms", 1e3 * offset_s));
    }
    Ok((offset_s, bias))
}

/// Attitudes that turn as the gyroscope says, and stay with those of the path.
fn attitudes(
    samples: &[ImuSample],
    recorded: &[MotionState],
    bias: &Vector3<f64>,
) -> Vec<UnitQuaternion<f64>> {
    let mut now = recorded[0].pose_w_b.rotation;
    let mut turned = vec![now];
    for pair in samples.windows(2) {
        let dt = pair[1].stamp.seconds_since(pair[0].stamp);
        let rate = 0.5 * (pair[0].gyro + pair[1].gyro) - bias;
        now *= UnitQuaternion::from_scaled_axis(rate * dt);
        now.renormalize();
        turned.push(now);
    }
    let lead =
        |(m, q): (&MotionState, &UnitQuaternion<f64>)| (m.pose_w_b.rotation * q.inverse()).scaled_axis();
    let leads: Vec<_> = recorded.iter().zip(&turned).map(lead).collect();
    let leads = slow(samples, &leads, ATTITUDE_KNOT_S, ATTITUDE_OUTLIER_RAD);
    turned.iter().zip(leads).map(|(q, lead)| UnitQuaternion::from_scaled_axis(lead) * q).collect()
}

/// Positions that accelerate by `forces`, and stay with `targets`.
fn positions(samples: &[ImuSample], forces: &[Vector3<f64>], targets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let (mut p, mut v) = (targets[0], Vector3::zeros());
    let mut moved = vec![p];
    for (pair, force) in samples.windows(2).zip(forces.windows(2)) {
        let dt = pair[1].stamp.seconds_since(pair[0].stamp);
        p += v * dt + (force[0] / 3.0 + force[1] / 6.0) * (dt * dt);
        v += (force[0] + force[1]) * (0.5 * dt);
        moved.push(p);
    }
    let leads: Vec<_> = targets.iter().zip(&moved).map(|(target, p)| target - p).collect();
    let leads = slow(samples, &leads, POSITION_KNOT_S, POSITION_OUTLIER_M);
    moved.iter().zip(leads).map(|(p, lead)| p + lead).collect()
}

/// The slow part of `values` at the samples: a spline with knots `step_s` apart, which values further than `outlier` from it
/// pull no more than those at that distance (Huber).
fn slow(samples: &[ImuSample], values: &[Vector3<f64>], step_s: f64, outlier: f64) -> Vec<Vector3<f64>> {
    let times: Vec<f64> = samples.iter().map(|s| s.stamp.seconds_since(samples[0].stamp)).collect();
    let end_s = times[times.len() - 1];
    let mut clipped: Vec<(f64, [f64; 3])> =
        times.iter().zip(values).map(|(t, v)| (*t, (*v).into())).collect();
    let mut curve = Spline::fit(&clipped, end_s, step_s);
    for _ in 0..ROUNDS {
        for ((t, target), value) in clipped.iter_mut().zip(values) {
            let near = Vector3::from(curve.jet(*t).value);
            *target = (near + limited(value - near, outlier)).into();
        }
        curve = Spline::fit(&clipped, end_s, step_s);
    }
    times.iter().map(|t| curve.jet(*t).value.into()).collect()
}

/// `v`, no longer than `limit`.
fn limited(v: Vector3<f64>, limit: f64) -> Vector3<f64> {
    let norm = v.norm();
    if norm > limit { v * (limit / norm) } else { v }
}

/// The accelerometer's mean bias `b`, and the horizontal force `w` that the path's world has too much for its vertical to be
/// that of gravity: `R f - g - a = R b + w`, fitted to the means of both sides.
fn force_model(
    samples: &[ImuSample],
    recorded: &[MotionState],
    attitudes: &[UnitQuaternion<f64>],
    gravity_m_s2: f64,
) -> Result<(Vector3<f64>, Vector3<f64>), String> {
    let up = Vector3::new(0.0, 0.0, gravity_m_s2);
    let share = 1.0 / FORCE_BLOCK as f64;
    let blocks = (0..samples.len() / FORCE_BLOCK).map(|block| {
        let (mut turn, mut force) = (nalgebra::Matrix3::zeros(), Vector3::zeros());
        for k in block * FORCE_BLOCK..(block + 1) * FORCE_BLOCK {
            turn += share * attitudes[k].to_rotation_matrix().into_inner();
            force += share * (attitudes[k] * samples[k].accel - up - recorded[k].a_w_b);
        }
        (turn, force)
    });
    let blocks: Vec<_> = blocks.collect();
    let (mut bias, mut tilt) = (Vector3::zeros(), Vector3::zeros());
    for round in 0..=ROUNDS {
        let limit = if round == 0 { f64::INFINITY } else { FORCE_OUTLIER_M_S2 };
        let (mut left, mut right) = (Matrix5::zeros(), Matrix5x1::zeros());
        for (turn, force) in &blocks {
            let expected = turn * bias + tilt;
            let target = expected + limited(force - expected, limit);
            let mut row = nalgebra::Matrix3x5::zeros();
            row.fixed_view_mut::<3, 3>(0, 0).copy_from(turn);
            row[(0, 3)] = 1.0;
            row[(1, 4)] = 1.0;
            left += row.transpose() * row;
            right += row.transpose() * target;
        }
        let solved =
            left.cholesky().ok_or("the flight does not turn enough to tell bias from tilt")?.solve(&right);
        bias = solved.fixed_rows::<3>(0).into();
        tilt = Vector3::new(solved[3], solved[4], 0.0);
    }
    Ok((bias, tilt))
}

/// The rotation that makes the force of a body at rest vertical again.
fn levelled(tilt: &Vector3<f64>, gravity_m_s2: f64) -> UnitQuaternion<f64> {
    let up = Vector3::new(tilt.x, tilt.y, gravity_m_s2);
    UnitQuaternion::rotation_between(&up, &Vector3::z()).unwrap_or_default()
}

#[cfg(test)]
#[path = "reconcile_tests.rs"]
mod tests;
