//! Gates for segments of the same edge: from frame to frame, and from left to right.
//!
//! Coordinates are normalized ones of the camera that looks. Directions are those of oriented edges: the
//! bright side tells the two edges of a bar apart.

use super::measurement::ImageLine;
use crate::points::rig::Baseline;
use crate::points::stereo::NEAREST_M;
use nalgebra::{Vector2, Vector3};
use plumbline_config::Portable;

/// Cosine of the largest angle between a prediction and a segment (10 degrees).
const MIN_COS: f64 = 0.984_8;
/// Cosine of the largest angle between the views of the two cameras (20 degrees).
const MIN_COS_STEREO: f64 = 0.939_7;
/// Two segments of one edge overlap by at least this share of the shorter.
const MIN_OVERLAP: f64 = 0.3;
/// Smallest sine between a segment and the epipolar lines by which its depth shows.
const MIN_EPIPOLAR_SINE: f64 = 0.1;
/// Rays that part by less than this are parallel within noise, 1/m.
const INVERSE_DEPTH_MARGIN: f64 = 0.02;

/// Expected place of an edge.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    start: Vector2<f64>,
    direction: Vector2<f64>,
    length: f64,
    /// Largest distance of a segment's middle from the line.
    gate: f64,
}

impl Expected {
    /// Between these ends (normalized coordinates), within `gate` (the same unit).
    pub fn new(ends_xy: &[Vector2<f64>; 2], gate: f64) -> Self {
        let d = ends_xy[1] - ends_xy[0];
        let length = d.norm().at_least(f64::MIN_POSITIVE);
        Self { start: ends_xy[0], direction: d / length, length, gate }
    }

    /// Signed distance of a segment's middle from the expected line, normalized coordinates.
    pub fn offset_of(&self, ends_xy: &[Vector2<f64>; 2]) -> f64 {
        self.direction.perp(&((ends_xy[0] + ends_xy[1]) * 0.5 - self.start))
    }

    /// True if a segment may be the edge.
    pub fn admits(&self, segment: &ImageLine) -> bool {
        self.direction.dot(&segment.direction) > MIN_COS
            && self.offset_of(&segment.ends_xy).abs() <= self.gate
            && overlap(&self.start, &self.direction, self.length, &segment.ends_xy) >= MIN_OVERLAP
    }
}

/// Share of the shorter of two segments that lies beside the other.
fn overlap(start: &Vector2<f64>, direction: &Vector2<f64>, length: f64, ends: &[Vector2<f64>; 2]) -> f64 {
    let [a, b] = ends.map(|end| direction.dot(&(end - start)));
    let (low, high) = (a.at_most(b), a.at_least(b));
    (high.at_most(length) - low.at_least(0.0)) / (high - low).at_most(length).at_least(f64::MIN_POSITIVE)
}

/// A left segment as the right camera may see it.
#[derive(Clone, Copy, Debug)]
pub struct StereoExpected {
    /// Directions of the two ends at infinity.
    far: [Vector3<f64>; 2],
    direction: Vector2<f64>,
}

/// A right segment, ready to be compared.
#[derive(Clone, Copy, Debug)]
pub struct StereoCandidate {
    segment: ImageLine,
    /// Unit normal of the plane through the segment and the camera.
    plane: Vector3<f64>,
    /// Component of the baseline along it, m.
    baseline: f64,
    /// The segment is aslant to the epipolar lines, so that its depth shows.
    is_aslant: bool,
}

/// The way from the left camera to the right, and what may be seen over it.
#[derive(Clone, Copy, Debug)]
pub struct StereoGate {
    /// From the left to the right.
    pub baseline: Baseline,
    /// Largest distance across epipolar lines of a segment along them, normalized coordinates.
    pub gate: f64,
}

impl StereoGate {
    /// A left segment, ready to be compared; `None` behind the right camera.
    pub fn expect(&self, line: &ImageLine) -> Option<StereoExpected> {
        let far = line.ends_xy.map(|xy| self.baseline.rotation * Vector3::new(xy.x, xy.y, 1.0));
        if far.iter().any(|q| q.z < 0.1) {
            return None;
        }
        let d = far[1].xy() / far[1].z - far[0].xy() / far[0].z;
        Some(StereoExpected { far, direction: d / d.norm().at_least(f64::MIN_POSITIVE) })
    }

    /// A right segment, ready to be compared.
    pub fn candidate(&self, line: &ImageLine) -> StereoCandidate {
        let [a, b] = line.ends_xy.map(|xy| Vector3::new(xy.x, xy.y, 1.0));
        let plane = a.cross(&b).normalize();
        let baseline = self.baseline.translation.dot(&plane);
        let is_aslant = (baseline / self.baseline.translation.norm()).abs() > MIN_EPIPOLAR_SINE;
        StereoCandidate { segment: *line, plane, baseline, is_aslant }
    }

    /// Inverse depths at the ends of a left segment, 1/m, if the right one may be the same edge: the planes of both meet in front of the
    /// cameras, where both see it. They are 0 for an edge along the epipolar lines.
    pub fn meet(&self, left: &StereoExpected, right: &StereoCandidate) -> Option<[f64; 2]> {
        let StereoCandidate { segment, plane, baseline, is_aslant } = right;
        if left.direction.dot(&segment.direction) < MIN_COS_STEREO {
            return None;
        }
        let (mut seen, mut rhos) = ([Vector2::zeros(); 2], [0.0; 2]);
        for ((to, at), q) in seen.iter_mut().zip(&mut rhos).zip(&left.far) {
            // The ray `q + rho t` meets the right plane.
            let rho = if *is_aslant {
                -q.dot(plane) / baseline
            } else if q.dot(plane).abs() <= self.gate * q.z {
                0.0
            } else {
                return None;
            };
            if !(-INVERSE_DEPTH_MARGIN..=1.0 / NEAREST_M).contains(&rho) {
                return None;
            }
            let met = q + self.baseline.translation * rho;
            if met.z < 0.1 {
                return None;
            }
            (*to, *at) = (met.xy() / met.z, rho);
        }
        let length = (seen[1] - seen[0]).norm();
        let direction = (seen[1] - seen[0]) / length.at_least(f64::MIN_POSITIVE);
        (overlap(&seen[0], &direction, length, &segment.ends_xy) >= MIN_OVERLAP).then_some(rhos)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn line(a: (f64, f64), b: (f64, f64)) -> ImageLine {
        ImageLine::between([Vector2::new(a.0, a.1), Vector2::new(b.0, b.1)], [450.0; 2])
    }

    #[test]
    fn an_edge_is_expected_where_it_was_and_in_its_sense() {
        let expected = Expected::new(&[Vector2::new(0.0, 0.0), Vector2::new(0.0, 0.4)], 0.03);
        let admits = |line: &ImageLine| expected.admits(line);
        assert!(admits(&line((0.01, 0.05), (0.02, 0.5))));
        assert!(!admits(&line((0.01, 0.5), (0.02, 0.05))), "the other edge of the bar");
        assert!(!admits(&line((0.05, 0.05), (0.05, 0.5))), "too far off");
        assert!(!admits(&line((0.0, 0.5), (0.0, 0.9))), "beyond its end");
        assert!((expected.offset_of(&line((0.01, 0.1), (0.01, 0.2)).ends_xy) + 0.01).abs() < 1e-12);
    }

    #[test]
    fn views_of_one_edge_at_a_possible_depth_are_admitted() {
        let translation = Vector3::new(-0.11, 0.0, 0.0);
        let gate =
            StereoGate { baseline: Baseline { rotation: Rotation3::identity(), translation }, gate: 0.005 };
        let admits = |l: &ImageLine, r: &ImageLine| {
            gate.expect(l).is_some_and(|e| gate.meet(&e, &gate.candidate(r)).is_some())
        };
        let left = line((0.1, -0.2), (0.12, 0.3));
        // Two metres away: 0.055 to the left.
        assert!(admits(&left, &line((0.045, -0.2), (0.065, 0.3))));
        assert!(!admits(&left, &line((0.2, -0.2), (0.22, 0.3))), "behind the cameras");
        assert!(!admits(&left, &line((-0.7, -0.2), (-0.68, 0.3))), "nearer than anything");
        // Along the epipolar lines depth does not show, the height does.
        let level = line((-0.2, 0.1), (0.3, 0.1));
        assert!(admits(&level, &line((-0.25, 0.102), (0.25, 0.102))));
        assert!(!admits(&level, &line((-0.25, 0.12), (0.25, 0.12))));
    }
}
