//! Relative pose errors: what an odometry does over a given distance, without any alignment.
//!
//! For poses `i`, `j` that are `delta` apart, with `Q` the reference and `P` the estimate,
//! `E = (Q_i⁻¹ Q_j)⁻¹ (P_i⁻¹ P_j)` (Sturm et al. 2012, equation 1). Which poses count as `delta` apart is
//! evo's rule for frames and metres, found on the estimate; seconds are ours, by the same pattern.

use super::{Delta, EvaluateError, Pairs, Statistics};
use plumbline_drivers::StampedPose;
use serde::Serialize;

/// In the all-pairs mode a distance may be off by this share (evo's default).
const RELATIVE_TOLERANCE: f64 = 0.1;
/// A time span this little short counts as reached, s: stamps of a 20 Hz camera jitter by microseconds.
const TIME_SLACK_S: f64 = 1e-3;

/// Statistics of relative errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RelativeErrors {
    /// Distance between the poses.
    pub delta: Delta,
    /// True if each pose begins a pair, false if pairs follow one another.
    pub all_pairs: bool,
    /// Length of the translation of `E`, m.
    pub translation_m: Statistics,
    /// Angle of the rotation of `E`, degrees.
    pub rotation_deg: Statistics,
}

/// Relative errors of poses `delta` apart; consecutive pairs, or one from each pose with `all_pairs`.
///
/// # Errors
/// When `delta` is not above zero, or no poses are that far apart.
pub fn relative_errors(
    pairs: &Pairs,
    delta: Delta,
    all_pairs: bool,
) -> Result<RelativeErrors, EvaluateError> {
    let indices = index_pairs(&pairs.estimate, delta, all_pairs)?;
    let (mut translations_m, mut rotations_deg) = (Vec::new(), Vec::new());
    for (i, j) in indices {
        let error = relative_error(pairs, i, j);
        translations_m.push(error.translation.vector.norm());
        rotations_deg.push(error.rotation.angle().to_degrees());
    }
    let statistics = Statistics::of(&translations_m).zip(Statistics::of(&rotations_deg));
    let (translation_m, rotation_deg) = statistics.ok_or(EvaluateError::NoPairs(delta))?;
    Ok(RelativeErrors { delta, all_pairs, translation_m, rotation_deg })
}

/// `E` of the poses `i` and `j`.
fn relative_error(pairs: &Pairs, i: usize, j: usize) -> nalgebra::Isometry3<f64> {
    let motion = |poses: &[StampedPose]| poses[i].pose.inv_mul(&poses[j].pose);
    motion(&pairs.reference).inv_mul(&motion(&pairs.estimate))
}

fn index_pairs(
    poses: &[StampedPose],
    delta: Delta,
    all_pairs: bool,
) -> Result<Vec<(usize, usize)>, EvaluateError> {
    let positive = match delta {
        Delta::Frames(n) => n > 0,
        Delta::Metres(d) | Delta::Seconds(d) => d.is_finite() && d > 0.0,
    };
    if !positive {
        return Err(EvaluateError::BadDelta(delta));
    }
    Ok(match delta {
        Delta::Frames(n) => by_frames(poses.len(), n, all_pairs),
        Delta::Metres(d) if all_pairs => nearest_pairs(&travelled_m(poses), d),
        Delta::Metres(d) => by_path(poses, d),
        Delta::Seconds(t) if all_pairs => nearest_pairs(&elapsed_s(poses), t),
        Delta::Seconds(t) => by_time(&elapsed_s(poses), t),
    })
}

fn by_frames(count: usize, delta: usize, all_pairs: bool) -> Vec<(usize, usize)> {
    let step = if all_pairs { 1 } else { delta };
    (0..count.saturating_sub(delta)).step_by(step).map(|i| (i, i + delta)).collect()
}

/// Path from the first pose to each, m.
pub(super) fn travelled_m(poses: &[StampedPose]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut travelled = Vec::with_capacity(poses.len());
    for (i, pose) in poses.iter().enumerate() {
        if let Some(last) = i.checked_sub(1).and_then(|i| poses.get(i)) {
            sum += (pose.pose.translation.vector - last.pose.translation.vector).norm();
        }
        travelled.push(sum);
    }
    travelled
}

fn elapsed_s(poses: &[StampedPose]) -> Vec<f64> {
    let Some(first) = poses.first() else { return Vec::new() };
    poses.iter().map(|p| p.stamp.seconds_since(first.stamp)).collect()
}

/// A pair ends, and the next begins, where the path since the beginning reaches `delta_m`. The path is
/// summed anew for each pair, as evo does: the difference of two long sums rounds otherwise.
fn by_path(poses: &[StampedPose], delta_m: f64) -> Vec<(usize, usize)> {
    let (mut pairs, mut begin, mut path) = (Vec::new(), 0, 0.0);
    for (i, two) in poses.windows(2).enumerate() {
        path += (two[1].pose.translation.vector - two[0].pose.translation.vector).norm();
        if path >= delta_m {
            pairs.push((begin, i + 1));
            (begin, path) = (i + 1, 0.0);
        }
    }
    pairs
}

fn by_time(elapsed_s: &[f64], delta_s: f64) -> Vec<(usize, usize)> {
    let (mut pairs, mut begin) = (Vec::new(), 0);
    for (i, t) in elapsed_s.iter().enumerate() {
        if t - elapsed_s[begin] >= delta_s - TIME_SLACK_S && i > begin {
            pairs.push((begin, i));
            begin = i;
        }
    }
    pairs
}

/// For each pose the later one whose distance along `coordinate` (not decreasing) is nearest to `delta`,
/// where it is near enough.
fn nearest_pairs(coordinate: &[f64], delta: f64) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    for (i, start) in coordinate.iter().enumerate() {
        let later = &coordinate[i + 1..];
        let off = |k: usize| (later[k] - start - delta).abs();
        let above = later.partition_point(|x| x - start < delta);
        // Of poses at one place the first counts.
        let below = above.checked_sub(1).map(|k| later.partition_point(|x| *x < later[k]));
        let candidates = below.into_iter().chain((above < later.len()).then_some(above));
        let best = candidates.min_by(|&a, &b| off(a).total_cmp(&off(b)));
        if let Some(k) = best.filter(|&k| off(k) <= delta * RELATIVE_TOLERANCE) {
            pairs.push((i, i + 1 + k));
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use plumbline_config::Timestamp;

    fn line(xs: &[f64]) -> Vec<StampedPose> {
        let pose = |(i, &x): (usize, &f64)| StampedPose {
            stamp: Timestamp::from_nanos(i as i64 * 50_000_000),
            pose: Isometry3::translation(x, 0.0, 0.0),
        };
        xs.iter().enumerate().map(pose).collect()
    }

    #[test]
    fn seconds_forgive_jitter() {
        assert_eq!(by_time(&[0.0, 0.5, 0.999_999_9, 1.5, 2.0, 2.1], 1.0), [(0, 2), (2, 4)]);
    }

    #[test]
    fn deltas_without_sense_or_pairs_are_refused() {
        let pairs = Pairs { estimate: line(&[0.0, 1.0]), reference: line(&[0.0, 1.0]) };
        for delta in [Delta::Frames(0), Delta::Metres(0.0), Delta::Metres(f64::NAN), Delta::Seconds(-1.0)] {
            assert!(matches!(relative_errors(&pairs, delta, false), Err(EvaluateError::BadDelta(_))));
        }
        let error = relative_errors(&pairs, Delta::Metres(5.0), true).unwrap_err();
        assert!(error.to_string().contains("no two poses are 5 m apart"));
    }
}
