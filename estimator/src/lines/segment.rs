//! A line segment in an image.

use super::fit::LineMoments;
use crate::image::patch::whole;
use nalgebra::Vector2;
use plumbline_config::Portable;

/// Places along a segment at which its edge is kept, so that it can be undistorted before it is fitted.
pub const NODES: usize = 8;
/// Pixels of the image to one of the halved image, in either direction.
pub const REDUCTION: usize = 2;

/// A place of the halved image, px, in the image.
pub fn whole_px(px: &Vector2<f32>) -> Vector2<f32> {
    px.map(|v| REDUCTION as f32 * v + 0.5 * (REDUCTION as f32 - 1.0))
}

/// A place of the image, px, in the halved image: the inverse of [`whole_px`].
pub fn halved_px(px: &Vector2<f32>) -> Vector2<f32> {
    px.map(|v| (v - 0.5 * (REDUCTION as f32 - 1.0)) / REDUCTION as f32)
}

/// The mean place of an edge over one part of a segment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SegmentNode {
    /// Mean pixel, with pixel centres at whole numbers.
    pub px: Vector2<f32>,
    /// Edge pixels averaged; 0 where the part has none.
    pub weight: f32,
}

/// A straight edge. It is oriented: looking from start to end the brighter side is on the right in an
/// image whose rows go down, so that the two edges of a bar have opposite directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Start, px.
    pub start: Vector2<f32>,
    /// End, px.
    pub end: Vector2<f32>,
    /// Edge along the segment, in order.
    pub nodes: [SegmentNode; NODES],
    /// Mean gradient across the edge, grey levels per pixel.
    pub strength: f32,
    /// Edge pixels that support it.
    pub support: f32,
}

impl Segment {
    /// Length, px.
    pub fn length(&self) -> f32 {
        (self.end - self.start).norm()
    }

    /// A segment of the halved image in the coordinates of the image.
    pub(super) fn whole(mut self) -> Self {
        (self.start, self.end) = (whole_px(&self.start), whole_px(&self.end));
        self.nodes.iter_mut().for_each(|node| {
            *node = SegmentNode { px: whole_px(&node.px), weight: node.weight * REDUCTION as f32 }
        });
        self.support *= REDUCTION as f32;
        self
    }

    /// Ends, moved along the segment into the rows `from` to `to`, px.
    pub fn ends_within(&self, from: f32, to: f32) -> [Vector2<f32>; 2] {
        let step = self.end - self.start;
        [&self.start, &self.end].map(|end| {
            let off = end.y.at_least(from).at_most(to) - end.y;
            if off == 0.0 { *end } else { end + step * (off / step.y) }
        })
    }

    /// Salience of the segment: long and of high contrast. Of two segments of one length the stronger is more
    /// often an edge of a building, and is found again.
    pub fn salience(&self) -> f32 {
        self.length() * self.strength.sqrt()
    }

    /// Middle, px.
    pub fn middle(&self) -> Vector2<f32> {
        (self.start + self.end) * 0.5
    }

    /// Unit vector from start to end.
    pub fn direction(&self) -> Vector2<f32> {
        let d = self.end - self.start;
        d / d.norm().at_least(f32::MIN_POSITIVE)
    }

    /// The line through edge places by total least squares, from the first to the last of them along
    /// `direction`. `None` for fewer than two places. One shorter than `nodes_from_px` has no nodes.
    pub fn through(places: &[Place], direction: &Vector2<f32>, nodes_from_px: f32) -> Option<Self> {
        let mut moments = LineMoments::default();
        let (mut strength, mut support) = (0.0, 0.0);
        for place in places {
            moments.add(&place.px.cast(), f64::from(place.weight));
            strength += place.strength * place.weight;
            support += place.weight;
        }
        let (centroid, axis) = moments.line().map(|(p, d)| (p.cast::<f32>(), d.cast::<f32>()))?;
        let along = if axis.dot(direction) < 0.0 { -axis } else { axis };
        let (mut first, mut last) = (f32::INFINITY, f32::NEG_INFINITY);
        for place in places {
            let s = along.dot(&(place.px - centroid));
            (first, last) = (s.at_most(first), s.at_least(last));
        }
        let length = last - first;
        if length.is_nan() || length <= 0.0 {
            return None;
        }
        let mut nodes = [SegmentNode::default(); NODES];
        let nodes_per_px = NODES as f32 / length;
        let with_nodes = if length >= nodes_from_px { places } else { &[] };
        for place in with_nodes {
            let part = whole((along.dot(&(place.px - centroid)) - first) * nodes_per_px);
            let node = &mut nodes[(part as usize).min(NODES - 1)];
            node.px += place.px * place.weight;
            node.weight += place.weight;
        }
        for node in nodes.iter_mut().filter(|n| n.weight > 0.0) {
            node.px /= node.weight;
        }
        Some(Self {
            start: centroid + along * first,
            end: centroid + along * last,
            nodes,
            strength: strength / support,
            support,
        })
    }
}

/// A place that an edge passes through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Pixel.
    pub px: Vector2<f32>,
    /// Edge pixels it stands for.
    pub weight: f32,
    /// Gradient there, grey levels per pixel.
    pub strength: f32,
}
