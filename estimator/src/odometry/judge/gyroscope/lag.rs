//! The delay between images and gyroscope that explains why their turns differ, or the rotation of cameras that were turned on the body.
//!
//! Samples that are late by `L` make attitudes by the images differ from the integral of the gyroscope by `w L` and a constant, where `w` is
//! the rate of the vehicle. In such sums errors of sightings do not add up. Cameras that are turned by `R` see each turn `v` of the gyroscope as
//! `R v`, however large or small it is.

use super::PLAIN_S;
use super::angles::{GyroAngles, MAX_TURNS, Turn};
use crate::geometry::{exp_so3, log_so3};
use crate::odometry::judge::FRAMES_TO_AGREE;
use crate::window::trial::{CONTRADICTS_SIGMAS, SAME_TURN_RAD};
use heapless::Deque;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Turns on end by which a delay is looked for, at least and at most.
const MIN_MATCHED: usize = 6;
const MAX_MATCHED: usize = 16;
/// Delays that are tried: up to so many steps of so many nanoseconds either way.
const LAG_STEPS: usize = 60;
const LAG_STEP_NS: i64 = 10_000_000;
/// With the delay attitudes differ by so many times less (root of the mean square) than with any of the other sign, and less than with another
/// bias; or by so many times less, whatever the bias. The same for turns and a rotation.
const MATCH_CONTRAST: f64 = 1.5;
const PLAIN_CONTRAST: f64 = 4.0;

/// The newest turns on end that begin after `since`, the newest first.
pub(super) fn on_end(turns: &Deque<Turn, MAX_TURNS>, since: Timestamp) -> impl Iterator<Item = &Turn> {
    let mut end = None;
    let is_next = move |turn: &&Turn| end.replace(turn.from).is_none_or(|end| end == turn.to);
    turns.iter().rev().take_while(move |turn| turn.from > since).take_while(is_next).take(MAX_MATCHED)
}

/// Delay of the gyroscope, less its bias, behind the turns that begin after `since`, s, if one explains them; those below
/// [`PLAIN_S`] are errors of stamps.
pub(super) fn delay(
    angles: &GyroAngles,
    turns: &Deque<Turn, MAX_TURNS>,
    since: Timestamp,
    bias_gyro: &Vector3<f64>,
) -> Option<f64> {
    let newest = || on_end(turns, since);
    let variance = newest().map(|turn| turn.variance).sum::<f64>() / newest().count() as f64;
    let same = SAME_TURN_RAD.squared() + CONTRADICTS_SIGMAS.squared() * variance;
    if scatter(angles, newest(), 0, bias_gyro)? <= same {
        return None;
    }
    let with =
        |steps: i64| scatter(angles, newest(), steps * LAG_STEP_NS, bias_gyro).unwrap_or(f64::INFINITY);
    let by_step: [f64; 2 * LAG_STEPS + 1] = std::array::from_fn(|k| with(k as i64 - LAG_STEPS as i64));
    let least = |side: &[f64]| side.iter().fold(f64::INFINITY, |least, squared| least.at_most(*squared));
    let sides = [&by_step[..LAG_STEPS], &by_step[LAG_STEPS + 1..]].map(least);
    let (squared, other) = (sides[0].at_most(sides[1]), sides[0].at_least(sides[1]));
    let best = by_step.iter().position(|of_step| *of_step == squared)?;
    let (shift, squared) = lowest([by_step.get(best.checked_sub(1)?)?, &squared, by_step.get(best + 1)?]);
    let lag_s = (best as f64 - LAG_STEPS as f64 + shift) * LAG_STEP_NS as f64 * 1e-9;
    // With the bias that turns as far as the images from the first to the last.
    let apart = newest().map_while(|turn| Some((angles.difference(turn, 0, bias_gyro)?, turn.dt_s())));
    let (rad, span_s) = apart.fold((Vector3::zeros(), 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
    let drift = scatter(angles, newest(), 0, &(bias_gyro - rad / span_s))?;
    let is_plain = other > PLAIN_CONTRAST.squared() * squared;
    let is_clear = is_plain || (other > MATCH_CONTRAST.squared() * squared && squared < drift);
    let is_found = squared <= same && other > same && other.is_finite() && is_clear;
    (is_found && lag_s.abs() > PLAIN_S).then_some(lag_s)
}

/// Rotation, rad, that takes what the gyroscope measured of the turns after `since` to what the images show of them, if it explains why these
/// differ and what is wrong with one axis, which any gyroscope may have, does not.
pub(super) fn rotation(
    angles: &GyroAngles,
    turns: &Deque<Turn, MAX_TURNS>,
    since: Timestamp,
    bias_gyro: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    let of_turn = |turn: &Turn| Some([turn.seen - angles.difference(turn, 0, bias_gyro)?, turn.seen]);
    let newest = || on_end(turns, since).take(FRAMES_TO_AGREE as usize).filter_map(of_turn);
    let mut rotation = UnitQuaternion::identity();
    // Gauss-Newton; a third step matters to large rotations alone.
    for _ in 0..3 {
        let (mut square, mut slope) = (Matrix3::identity() * SAME_TURN_RAD.squared(), Vector3::zeros());
        for [measured, seen] in newest() {
            let turned = rotation * measured;
            square += Matrix3::identity() * turned.norm_squared() - turned * turned.transpose();
            slope += turned.cross(&seen);
        }
        rotation = exp_so3(&square.cholesky()?.solve(&slope)) * rotation;
    }
    let differences = || newest().map(|[measured, seen]| seen - measured);
    let largest = differences().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?.normalize();
    let off: f64 = differences().map(|off| off.norm_squared()).sum();
    let across: f64 = differences().map(|off| off.cross(&largest).norm_squared()).sum();
    let left: f64 = newest().map(|[measured, seen]| (seen - rotation * measured).norm_squared()).sum();
    let is_clear = off > PLAIN_CONTRAST.squared() * left && across > MATCH_CONTRAST.squared() * left;
    (newest().count() == FRAMES_TO_AGREE as usize && is_clear).then(|| log_so3(&rotation))
}

/// Place and value of the lowest point of the parabola through values at -1, 0 and 1, of which that at 0 is the least.
fn lowest([before, at, after]: [&f64; 3]) -> (f64, f64) {
    let (slope, curvature) = (0.5 * (after - before), before - 2.0 * at + after);
    if !(curvature > 0.0 && curvature.is_finite()) {
        return (0.0, *at);
    }
    let place = (-slope / curvature).clamp(-1.0, 1.0);
    (place, (at + 0.5 * slope * place).at_least(0.0))
}

/// Mean squared difference, rad², between attitudes by the images and by the gyroscope `lag_ns` later, less a constant, over those of `turns`, the
/// newest first, for which there are samples on end; `None` where these are too few.
fn scatter<'a>(
    angles: &GyroAngles,
    turns: impl Iterator<Item = &'a Turn>,
    lag_ns: i64,
    bias_gyro: &Vector3<f64>,
) -> Option<f64> {
    let (mut off, mut sum, mut squares, mut count) = (Vector3::zeros(), Vector3::zeros(), 0.0, 0);
    // The samples of a later time are not there yet.
    let measured = turns.map(|turn| angles.difference(turn, lag_ns, bias_gyro)).skip_while(Option::is_none);
    for difference in measured.map_while(|difference| difference) {
        off -= difference;
        sum += off;
        squares += off.norm_squared();
        count += 1;
    }
    let attitudes = (count + 1) as f64;
    (count >= MIN_MATCHED).then(|| squares / attitudes - (sum / attitudes).norm_squared())
}
