//! The adaptive length threshold of the paper.

use super::segment::Segment;

/// Equation 1 of PLI-VINS (Zhao et al. 2022): the more segments an image has, the longer they must be, px.
#[must_use]
pub fn min_length_px(count: usize, width: usize, height: usize) -> f32 {
    let (n, longer, shorter) = (count as f32, width.max(height) as f32, width.min(height) as f32);
    n / (3.0 * n + longer) * shorter
}

/// Orders segments by [`Segment::salience`], and those of equal salience by their place: the order of
/// everything that follows.
pub fn clearest_first(segments: &mut [Segment]) {
    segments.sort_unstable_by(|a, b| {
        b.salience()
            .total_cmp(&a.salience())
            .then(a.start.y.total_cmp(&b.start.y))
            .then(a.start.x.total_cmp(&b.start.x))
            .then(a.end.x.total_cmp(&b.end.x))
    });
}
