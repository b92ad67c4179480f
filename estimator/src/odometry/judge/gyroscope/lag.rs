//! The delay between images and gyroscope that explains why their turns differ.

use super::angles::{GyroAngles, MAX_TURNS, Turn};
use crate::window::trial::SAME_TURN_RAD;
use heapless::Deque;
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp};

/// Turns by which a delay is looked for, at least and at most.
const MIN_MATCHED: usize = 6;
const MAX_MATCHED: usize = 12;
/// Delays that are tried: up to so many steps of so many nanoseconds either way, and the least that is called one.
const LAG_STEPS: i64 = 60;
const LAG_STEP_NS: i64 = 10_000_000;
const MIN_LAG_STEPS: i64 = 2;
/// At the right delay turns and gyroscope are the same (root of the mean square); at none, and at those of the other sign, they differ by so many
/// times more than there, or than what tracks leave, rad.
const MATCH_CONTRAST: f64 = 1.7;
const MATCH_NOISE_RAD: f64 = 3e-4;

/// Delay of the gyroscope, less its bias, behind the turns that the images saw since `since`, s, if one explains them.
pub(super) fn delay(
    angles: &GyroAngles,
    turns: &Deque<Turn, MAX_TURNS>,
    since: Timestamp,
    bias_gyro: &Vector3<f64>,
) -> Option<f64> {
    let newest = || turns.iter().rev().filter(|turn| turn.from >= since && !turn.skips_frames);
    let (mut best, mut others) = ((f64::INFINITY, 0), [f64::INFINITY; 3]);
    for steps in -LAG_STEPS..=LAG_STEPS {
        let lag_ns = steps * LAG_STEP_NS;
        let differences = newest().filter_map(|turn| angles.difference(turn, lag_ns, bias_gyro));
        let Some(rms) = rms(differences) else { continue };
        if rms < best.0 {
            best = (rms, steps);
        }
        let side = match steps {
            _ if steps <= -MIN_LAG_STEPS => 0,
            _ if steps >= MIN_LAG_STEPS => 2,
            _ => 1,
        };
        others[side] = others[side].at_most(rms);
    }
    let (rms, steps) = best;
    let rivals = if steps < 0 { [others[1], others[2]] } else { [others[0], others[1]] };
    // What cannot be compared for a hole in the samples is no rival.
    let least = MATCH_CONTRAST * rms.at_least(MATCH_NOISE_RAD);
    let is_clear = rivals.iter().all(|rival| *rival >= least);
    let is_found = steps.abs() >= MIN_LAG_STEPS && rms < SAME_TURN_RAD && is_clear;
    is_found.then_some((steps * LAG_STEP_NS) as f64 * 1e-9)
}

/// Root of the mean squared of the first differences; `None` where there are too few.
fn rms(differences: impl Iterator<Item = Vector3<f64>>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for difference in differences.take(MAX_MATCHED) {
        sum += difference.norm_squared();
        count += 1;
    }
    (count >= MIN_MATCHED).then(|| (sum / count as f64).sqrt())
}
