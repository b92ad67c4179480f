//! Broken segments are joined: figure 4 of the paper.
//!
//! Around each segment, clearest first, its outer rectangle is drawn, widened by a margin across and along.
//! Segments with an end or their middle inside join its set; those whose direction differs from it by more
//! than the mean of the differences leave it again; the rest become one line by total least squares. The
//! mean is held between a floor, as it would halve a set that is parallel within noise, and a ceiling, as
//! a single member would always pass; members whose ends are off the joint line by more than the margin
//! leave as well. Segments of opposite direction are the two edges of one bar, and stay apart: the paper
//! does not say so, but a line between them would be the edge of nothing.

use super::filter::clearest_first;
use super::segment::{NODES, Place, Segment};
use nalgebra::Vector2;
use plumbline_config::Portable;
use plumbline_config::options::LinesConfig;

/// Most segments that become one.
const MAX_MEMBERS: usize = 16;
/// Ceiling of the angle threshold, degrees.
const MAX_ANGLE_DEG: f32 = 5.0;
/// Fits of one set, each without the members that were off the one before.
const MAX_FITS: usize = 3;

/// Joins segments.
#[derive(Clone, Debug)]
pub struct Merger {
    across_px: f32,
    along_px: f32,
    min_angle: f32,
    is_gone: Vec<bool>,
    places: Vec<Place>,
}

impl Merger {
    /// With everything allocated that the options ask for.
    #[must_use]
    pub fn new(options: &LinesConfig) -> Self {
        Self {
            across_px: options.merge_across_px as f32,
            along_px: options.merge_along_px as f32,
            min_angle: options.merge_angle_deg.to_radians() as f32,
            is_gone: Vec::with_capacity(options.max_raw),
            places: Vec::with_capacity((MAX_MEMBERS + 1) * (NODES + 2)),
        }
    }

    /// Joins `segments` (clearest first) into `merged` (clearest first).
    pub fn merge(&mut self, segments: &[Segment], merged: &mut Vec<Segment>) {
        self.is_gone.clear();
        self.is_gone.resize(segments.len(), false);
        for k in 0..segments.len() {
            if !self.is_gone[k] {
                self.is_gone[k] = true;
                merged.push(self.joined(segments, k));
            }
        }
        clearest_first(merged);
    }

    /// Segment `k` with all that belongs to it.
    fn joined(&mut self, segments: &[Segment], k: usize) -> Segment {
        // With the angle to segment `k`, rad.
        let mut members = heapless::Vec::<(usize, f32), MAX_MEMBERS>::new();
        let rectangle = Rectangle::around(&segments[k], self.across_px, self.along_px);
        for (other, segment) in segments.iter().enumerate().skip(k + 1) {
            if !self.is_gone[other]
                && let Some(angle) = rectangle.admits(segment)
            {
                let _ = members.push((other, angle));
            }
        }
        if members.is_empty() {
            return segments[k];
        }
        let mean = members.iter().map(|m| m.1).sum::<f32>() / members.len() as f32;
        let limit = mean.at_most(MAX_ANGLE_DEG.to_radians()).at_least(self.min_angle);
        members.retain(|m| m.1 <= limit);
        for _ in 0..MAX_FITS {
            let Some(joint) = self.fit(segments, k, &members) else { break };
            let is_off = |segment: &Segment| {
                let (direction, middle) = (joint.direction(), joint.middle());
                let off = |px: &Vector2<f32>| direction.perp(&(px - middle)).abs() > self.across_px;
                off(&segment.start) || off(&segment.end)
            };
            let before = members.len();
            members.retain(|m| !is_off(&segments[m.0]));
            if members.len() == before {
                if before == 0 || is_off(&segments[k]) {
                    break;
                }
                members.iter().for_each(|m| self.is_gone[m.0] = true);
                return joint;
            }
        }
        segments[k]
    }

    /// One line through segment `k` and its members.
    fn fit(&mut self, segments: &[Segment], k: usize, members: &[(usize, f32)]) -> Option<Segment> {
        self.places.clear();
        add_places(&segments[k], &mut self.places);
        for &(other, _) in members {
            add_places(&segments[other], &mut self.places);
        }
        Segment::through(&self.places, &segments[k].direction(), 0.0)
    }
}

/// The nodes of a segment with its ends, which keep it as long as it was.
fn add_places(segment: &Segment, places: &mut Vec<Place>) {
    let strength = segment.strength;
    for end in [segment.start, segment.end] {
        places.push(Place { px: end, weight: 0.5, strength });
    }
    let nodes = segment.nodes.iter().filter(|n| n.weight > 0.0);
    places.extend(nodes.map(|node| Place { px: node.px, weight: node.weight, strength }));
}

/// The outer rectangle of a segment.
#[derive(Clone, Copy, Debug)]
struct Rectangle {
    middle: Vector2<f32>,
    direction: Vector2<f32>,
    half_length: f32,
    half_width: f32,
}

impl Rectangle {
    fn around(segment: &Segment, across_px: f32, along_px: f32) -> Self {
        Self {
            middle: segment.middle(),
            direction: segment.direction(),
            half_length: 0.5 * segment.length() + along_px,
            half_width: across_px,
        }
    }

    fn contains(&self, px: &Vector2<f32>) -> bool {
        let d = px - self.middle;
        (self.direction.dot(&d).abs() <= self.half_length)
            & (self.direction.perp(&d).abs() <= self.half_width)
    }

    /// Angle to a segment with an end or its middle inside, rad; `None` for others, and for those of
    /// opposite direction.
    fn admits(&self, segment: &Segment) -> Option<f32> {
        // All three without a branch: where most are outside, which one is not is anybody's guess.
        let [start, end, middle] =
            [segment.start, segment.end, segment.middle()].map(|px| self.contains(&px));
        if !(start | end | middle) {
            return None;
        }
        let direction = segment.direction();
        let cos = self.direction.dot(&direction);
        (cos > 0.0).then(|| libm::atan2f(self.direction.perp(&direction).abs(), cos))
    }
}

#[cfg(test)]
mod tests {
    use super::super::segment::SegmentNode;
    use super::*;

    fn segment(start: (f32, f32), end: (f32, f32)) -> Segment {
        let (start, end) = (Vector2::from([start.0, start.1]), Vector2::from([end.0, end.1]));
        let nodes = std::array::from_fn(|k| {
            let s = (k as f32 + 0.5) / NODES as f32;
            SegmentNode { px: start + (end - start) * s, weight: (end - start).norm() / NODES as f32 }
        });
        Segment { start, end, nodes, strength: 10.0, support: (end - start).norm() }
    }

    fn merge(segments: &[Segment]) -> Vec<Segment> {
        let mut sorted = segments.to_vec();
        clearest_first(&mut sorted);
        let mut merged = Vec::with_capacity(8);
        Merger::new(&LinesConfig::default()).merge(&sorted, &mut merged);
        merged
    }

    #[test]
    fn pieces_of_one_edge_become_one() {
        let merged = merge(&[segment((100.0, 50.0), (200.0, 60.0)), segment((205.0, 60.4), (260.0, 66.0))]);
        assert_eq!(merged.len(), 1);
        assert!((merged[0].start - Vector2::new(100.0, 50.0)).norm() < 1.0);
        assert!((merged[0].end - Vector2::new(260.0, 66.0)).norm() < 1.0);
    }

    #[test]
    fn neighbours_of_another_direction_or_beyond_the_margin_stay() {
        let base = segment((100.0, 50.0), (200.0, 50.0));
        for other in [
            // At an angle, far off, and the other edge of a bar.
            segment((150.0, 50.0), (190.0, 90.0)),
            segment((120.0, 56.0), (180.0, 56.0)),
            segment((230.0, 50.0), (290.0, 50.0)),
            segment((180.0, 51.5), (120.0, 51.5)),
        ] {
            assert_eq!(merge(&[base, other]).len(), 2, "{other:?}");
        }
    }
}
