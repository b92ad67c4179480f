//! Which part of a recording was at rest: the longest stretch in which nothing moves.
//!
//! Half seconds are looked at one by one. One is steady when its means are those of the half second before: it neither
//! turned nor tilted nor set off. It is at rest when, besides, it scatters no more than steady ones do by their median, times
//! [`SCATTER`]: nobody pushed it. So a vehicle that stands with its rotors on is at rest, and [`RestInterval::is_shaken`].

use nalgebra::Vector3;
use plumbline_config::{ImuSample, median};
use std::ops::Range;

/// Length of the pieces, s.
const PIECE_S: f64 = 0.5;
/// Pieces that scatter so many times as much as the steady ones were pushed.
const SCATTER: f64 = 5.0;
/// Part of the pieces that is taken for quiet.
const QUIET_PART: f64 = 0.2;
/// No sensor of a drone scatters like this by itself: rad/s, m/s².
const OWN_SCATTER: [f64; 2] = [0.02, 0.2];
/// No gyroscope that is any good has such a bias, rad/s.
const MOST_BIAS_RAD_S: f64 = 0.2;
/// A piece whose mean rate is further from that of the piece before turns, rad/s.
const MOST_STEP_RAD_S: f64 = 0.02;
/// A piece whose mean acceleration is further from that of the piece before has moved or tilted, m/s².
const MOST_STEP_M_S2: f64 = 0.1;
/// Samples further apart than this interrupt a rest, s.
const LONGEST_GAP_S: f64 = 0.1;

/// The rest that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct RestInterval {
    /// The samples of the longest rest.
    pub range: Range<usize>,
    /// Their distance, s: the median of the recording.
    pub dt_s: f64,
    /// Beginning of the rest, s after the first sample.
    pub begin_s: f64,
    /// Length of the rest, s.
    pub length_s: f64,
    /// Length of the recording, s.
    pub recording_s: f64,
    /// Part of the recording that is at rest, this one or another.
    pub still_part: f64,
    /// Samples that are missing in the rest.
    pub missing: usize,
    /// Scatter within half a second at rest, by its median: gyroscope rad/s, accelerometer m/s².
    pub scatter: [f64; 2],
    /// Scatter of the quietest fifth of the recording: gyroscope rad/s, accelerometer m/s².
    pub quiet: [f64; 2],
}

impl RestInterval {
    /// True if it scatters more than a sensor does by itself.
    #[must_use]
    pub fn is_shaken(&self) -> bool {
        (0..2).any(|k| self.scatter[k] > OWN_SCATTER[k])
    }
}

/// Statement about one piece.
#[derive(Clone, Copy, Debug)]
struct Piece {
    mean: [Vector3<f64>; 2],
    scatter: [f64; 2],
    has_gap: bool,
}

/// The longest rest among `samples`, which are in order of time; `None` for less than two pieces.
#[must_use]
pub fn longest_rest(samples: &[ImuSample]) -> Option<RestInterval> {
    let dt_s = median(samples.windows(2).map(|pair| pair[1].stamp.seconds_since(pair[0].stamp)))?;
    let size = ((PIECE_S / dt_s).round() as usize).max(4);
    let pieces: Vec<Piece> = samples.chunks_exact(size).map(|chunk| piece(chunk, dt_s)).collect();
    if pieces.len() < 2 || dt_s <= 0.0 {
        return None;
    }
    let quiet = [0, 1].map(|k| quantile(pieces.iter().map(|p| p.scatter[k]), QUIET_PART).unwrap_or(0.0));
    let is_steady = |k: usize| {
        let (piece, before) = (&pieces[k], if k > 0 { &pieces[k - 1] } else { &pieces[1] });
        let steps = [0, 1].map(|s| (piece.mean[s] - before.mean[s]).norm());
        !piece.has_gap
            && piece.mean[0].norm() < MOST_BIAS_RAD_S
            && steps[0] < MOST_STEP_RAD_S
            && steps[1] < MOST_STEP_M_S2
    };
    let steady: Vec<usize> = (0..pieces.len()).filter(|k| is_steady(*k)).collect();
    let usual = [0, 1].map(|s| median(steady.iter().map(|k| pieces[*k].scatter[s])).unwrap_or(0.0));
    let is_still = |k: usize| is_steady(k) && (0..2).all(|s| pieces[k].scatter[s] <= SCATTER * usual[s]);
    let still: Vec<bool> = (0..pieces.len()).map(is_still).collect();
    let stretch = longest_run(&still);
    // The last piece of a rest to the end goes on to the last sample.
    let end =
        if stretch.end == pieces.len() && !stretch.is_empty() { samples.len() } else { stretch.end * size };
    let range = stretch.start * size..end.min(samples.len());
    let since = |k: usize| samples[k.min(samples.len() - 1)].stamp.seconds_since(samples[0].stamp);
    let length_s = range.len() as f64 * dt_s;
    let spanned = if range.is_empty() { 0.0 } else { since(range.end - 1) - since(range.start) + dt_s };
    Some(RestInterval {
        dt_s,
        begin_s: since(range.start),
        length_s,
        recording_s: since(samples.len() - 1),
        still_part: still.iter().filter(|s| **s).count() as f64 / still.len() as f64,
        missing: ((spanned - length_s) / dt_s).round().max(0.0) as usize,
        scatter: [0, 1].map(|s| median(pieces[stretch.clone()].iter().map(|p| p.scatter[s])).unwrap_or(0.0)),
        quiet,
        range,
    })
}

fn piece(samples: &[ImuSample], dt_s: f64) -> Piece {
    let values = |k: usize| samples.iter().map(move |s| if k == 0 { s.gyro } else { s.accel });
    let count = samples.len() as f64;
    let mean = [0, 1].map(|k| values(k).sum::<Vector3<f64>>() / count);
    let scatter = [0, 1].map(|k| {
        let squares: f64 = values(k).map(|v| (v - mean[k]).norm_squared()).sum();
        (squares / (3.0 * count)).sqrt()
    });
    let longest = LONGEST_GAP_S.max(2.5 * dt_s);
    let has_gap = samples.windows(2).any(|pair| pair[1].stamp.seconds_since(pair[0].stamp) > longest);
    Piece { mean, scatter, has_gap }
}

/// The longest run of `true`.
fn longest_run(flags: &[bool]) -> Range<usize> {
    let (mut best, mut begin) = (0..0, 0);
    for (k, flag) in flags.iter().enumerate() {
        if !flag {
            begin = k + 1;
        } else if k + 1 - begin > best.len() {
            best = begin..k + 1;
        }
    }
    best
}

fn quantile(values: impl Iterator<Item = f64>, part: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(((sorted.len() as f64 * part) as usize).min(sorted.len().saturating_sub(1))).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;

    /// Samples at 200 Hz with a little scatter; `moves` says how it turns at a time, rad/s.
    fn samples(seconds: f64, moves: impl Fn(f64) -> f64) -> Vec<ImuSample> {
        let sample = |k: usize| {
            let t = k as f64 * 0.005;
            let scatter = if k.is_multiple_of(2) { 1e-3 } else { -1e-3 };
            ImuSample {
                stamp: Timestamp::from_nanos(k as i64 * 5_000_000),
                gyro: Vector3::new(0.004 + scatter, moves(t), -scatter),
                accel: Vector3::new(10.0 * scatter, 0.0, 9.7 - 10.0 * scatter),
            }
        };
        (0..(seconds * 200.0) as usize).map(sample).collect()
    }

    #[test]
    fn a_recording_at_rest_is_at_rest_from_its_first_sample_to_its_last() {
        let recorded = samples(10.2, |_| 0.0);
        let rest = longest_rest(&recorded).unwrap();
        assert_eq!(rest.range, 0..recorded.len());
        assert!((rest.still_part - 1.0).abs() < 1e-9 && rest.missing == 0, "{rest:?}");
        assert!((rest.length_s - 10.2).abs() < 0.01 && rest.begin_s == 0.0 && !rest.is_shaken());
    }

    #[test]
    fn what_moves_is_left_out_and_the_longest_rest_is_taken() {
        let moves = |t: f64| if (4.0..6.0).contains(&t) { 0.5 * (7.0 * t).sin() } else { 0.0 };
        let rest = longest_rest(&samples(20.0, moves)).unwrap();
        assert!((rest.begin_s - 6.0).abs() < 0.51 && (rest.length_s - 14.0).abs() < 0.51, "{rest:?}");
        assert!((rest.still_part - 0.9).abs() < 0.06);
    }

    #[test]
    fn a_slow_even_turn_is_no_rest() {
        let moves = |t: f64| if t < 5.0 { 0.1 } else { 0.0 };
        let rest = longest_rest(&samples(20.0, moves)).unwrap();
        assert!((rest.begin_s - 5.0).abs() < 0.51, "{rest:?}");
    }

    #[test]
    fn a_flight_holds_no_rest() {
        let rest = longest_rest(&samples(20.0, |t| 0.3 * (0.9 * t).sin() + 0.1 * (9.0 * t).sin())).unwrap();
        assert!(rest.length_s < 1.6, "{rest:?}");
    }

    #[test]
    fn a_vehicle_that_stands_with_its_rotors_on_is_at_rest_and_shaken() {
        let rest = longest_rest(&samples(20.0, |t| 0.1 * (400.0 * t).sin())).unwrap();
        assert!(rest.length_s > 19.0 && rest.is_shaken(), "{rest:?}");
    }

    #[test]
    fn a_gap_ends_a_rest() {
        let mut recorded = samples(20.0, |_| 0.0);
        recorded.drain(1250..1350);
        let rest = longest_rest(&recorded).unwrap();
        assert!((rest.begin_s - 7.0).abs() < 0.6 && rest.missing == 0, "{rest:?}");
        // A sample now and then is counted.
        let mut recorded = samples(20.0, |_| 0.0);
        recorded.remove(2000);
        let rest = longest_rest(&recorded).unwrap();
        assert_eq!((rest.range.len(), rest.missing), (3999, 1));
    }

    #[test]
    fn next_to_nothing_is_no_recording() {
        assert_eq!(longest_rest(&samples(0.6, |_| 0.0)), None);
        assert_eq!(longest_rest(&[]), None);
    }
}
