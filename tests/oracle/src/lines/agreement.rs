//! Agreement of two sets of segments of one image.

use super::Line;
use nalgebra::Vector2;

/// Largest distance of what agrees, px.
pub const WITHIN_PX: f64 = 2.0;
/// Largest angle between what agrees, degrees.
pub const WITHIN_DEG: f64 = 3.0;

/// Share of the length of `lines`, sampled at each pixel, that lies within [`WITHIN_PX`] of one of `others`
/// and within [`WITHIN_DEG`] of its direction; 0 of nothing.
pub fn covered_share(lines: &[Line], others: &[Line]) -> f64 {
    let (mut covered, mut total) = (0.0, 0.0);
    for line in lines {
        total += line.length();
        covered += line.length() * covered_share_of(line, others);
    }
    if total > 0.0 { covered / total } else { 0.0 }
}

/// Share of a single segment that is covered by `others`.
pub fn covered_share_of(line: &Line, others: &[Line]) -> f64 {
    let limit = WITHIN_DEG.to_radians();
    let aligned: Vec<&Line> = others.iter().filter(|other| line.angle(other) <= limit).collect();
    let samples = line.length().ceil().max(1.0) as usize;
    let step = (line.end - line.start) / samples as f64;
    let is_near = |px: &Vector2<f64>| aligned.iter().any(|other| other.distance(px) <= WITHIN_PX);
    let near = (0..samples).filter(|k| is_near(&(line.start + step * (*k as f64 + 0.5)))).count();
    near as f64 / samples as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_and_parallel_is_covered() {
        let line = [Line::new([0.0, 0.0, 100.0, 0.0])];
        let by = |other: [f64; 4]| covered_share(&line, &[Line::new(other)]);
        assert!((by([50.0, 1.0, 0.0, 1.0]) - 0.52).abs() < 0.011);
        assert_eq!(by([0.0, 2.5, 100.0, 2.5]), 0.0);
        assert_eq!(by([0.0, 0.0, 100.0, 6.0]), 0.0);
        assert!(by([0.0, 0.0, 100.0, 4.0]) < 0.6);
        assert_eq!(covered_share(&line, &[]), 0.0);
    }
}
