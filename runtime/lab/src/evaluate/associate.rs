//! Which pose of the estimate belongs to which of the reference: the nearest in time.
//!
//! The rule is that of `evo.core.sync.associate_trajectories`: each pose of the shorter trajectory takes
//! the nearest of the longer one, if that is near enough; one pose may be taken twice. Also evo's
//! arithmetic, seconds as `f64`, is kept on purpose: where a stamp lies half way between two others, or
//! just at the limit, its rounding decides, and the figures are to be the same.

use super::{EvaluateError, Side};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;

/// Poses of both trajectories that belong together, index by index.
#[derive(Clone, Debug, PartialEq)]
pub struct Pairs {
    /// Poses of the estimate.
    pub estimate: Vec<StampedPose>,
    /// Poses of the reference.
    pub reference: Vec<StampedPose>,
}

impl Pairs {
    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.estimate.len()
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.estimate.is_empty()
    }
}

/// Pairs the poses of `estimate` and `reference` by nearest stamps, at most `max_difference_s` apart.
///
/// # Errors
/// When a trajectory is empty or holds a number that is not finite, or no stamps are near each other.
pub fn associate(
    estimate: &[StampedPose],
    reference: &[StampedPose],
    max_difference_s: f64,
) -> Result<Pairs, EvaluateError> {
    let estimate_span = checked_span(estimate, Side::Estimate)?;
    let reference_span = checked_span(reference, Side::Reference)?;
    let estimate_is_longer = estimate.len() > reference.len();
    let (short, long) = if estimate_is_longer { (reference, estimate) } else { (estimate, reference) };
    let matches = match_stamps(&seconds(short), &seconds(long), max_difference_s);
    if matches.is_empty() {
        let (estimate, reference) = (estimate_span, reference_span);
        return Err(EvaluateError::NoCommonStamps { estimate, reference, max_difference_s });
    }
    let of_short = matches.iter().map(|&(i, _)| short[i]).collect();
    let of_long = matches.iter().map(|&(_, j)| long[j]).collect();
    let (estimate, reference) = if estimate_is_longer { (of_long, of_short) } else { (of_short, of_long) };
    Ok(Pairs { estimate, reference })
}

fn checked_span(poses: &[StampedPose], side: Side) -> Result<(Timestamp, Timestamp), EvaluateError> {
    let finite = |p: &StampedPose| {
        p.pose.translation.vector.iter().chain(p.pose.rotation.coords.iter()).all(|x| x.is_finite())
    };
    if let Some(index) = poses.iter().position(|p| !finite(p)) {
        return Err(EvaluateError::NotFinite { side, index });
    }
    let stamps = || poses.iter().map(|p| p.stamp);
    stamps().min().zip(stamps().max()).ok_or(EvaluateError::Empty(side))
}

/// Stamps as the `f64` nearest to their decimal text, which is what evo reads from a file.
fn seconds(poses: &[StampedPose]) -> Vec<f64> {
    let one = |p: &StampedPose| p.stamp.to_string().parse().unwrap_or(p.stamp.as_nanos() as f64 * 1e-9);
    poses.iter().map(one).collect()
}

/// Index pairs of `matching_time_indices` of evo.
fn match_stamps(short: &[f64], long: &[f64], max_difference: f64) -> Vec<(usize, usize)> {
    let sorted = long.is_sorted();
    let nearest = |t: f64| {
        if sorted { nearest_sorted(long, t, max_difference) } else { nearest_any(long, t, max_difference) }
    };
    short.iter().enumerate().filter_map(|(i, &t)| Some((i, nearest(t)?))).collect()
}

fn nearest_any(stamps: &[f64], t: f64, max_difference: f64) -> Option<usize> {
    let difference = |i: usize| (stamps[i] - t).abs();
    // The first of several equally near ones.
    let best = (0..stamps.len()).min_by(|&a, &b| difference(a).total_cmp(&difference(b)))?;
    (difference(best) <= max_difference).then_some(best)
}

fn nearest_sorted(stamps: &[f64], t: f64, max_difference: f64) -> Option<usize> {
    let (first, last) = (*stamps.first()?, *stamps.last()?);
    if t < first - max_difference || t > last + max_difference {
        return None;
    }
    let upper = stamps.partition_point(|&s| s <= t).min(stamps.len() - 1);
    let above = stamps[upper] - t;
    let below = if upper > 0 { t - stamps[upper - 1] } else { f64::INFINITY };
    if above <= max_difference && above < below {
        Some(upper)
    } else if below <= max_difference && below <= above {
        Some(upper - 1)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;

    fn poses(stamps_ms: &[i64]) -> Vec<StampedPose> {
        let one = |&t: &i64| StampedPose {
            stamp: Timestamp::from_nanos(t * 1_000_000),
            pose: Isometry3::translation(t as f64, 0.0, 0.0),
        };
        stamps_ms.iter().map(one).collect()
    }

    #[test]
    fn what_cannot_be_compared_is_said() {
        let some = poses(&[0, 50]);
        assert!(matches!(associate(&[], &some, 0.01), Err(EvaluateError::Empty(Side::Estimate))));
        let message = associate(&some, &poses(&[9000]), 0.01).unwrap_err().to_string();
        assert!(message.contains("from 0.000000000 to 0.050000000 s"), "{message}");
        let mut bad = some.clone();
        bad[1].pose.translation.y = f64::NAN;
        let error = associate(&some, &bad, 0.01).unwrap_err();
        assert!(matches!(error, EvaluateError::NotFinite { side: Side::Reference, index: 1 }));
    }
}
