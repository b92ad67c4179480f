//! One camera and the segments of its newest image.

use super::descriptor::{Describer, LineDescriptor};
use super::extractor::{LineExtractor, PARTS};
use super::gates::Expected;
use super::measurement::ImageLine;
use super::segment::{NODES, Segment, SegmentNode};
use crate::points::rig::RigCamera;
use nalgebra::Vector2;
use plumbline_config::options::LinesConfig;
use plumbline_config::{CameraModel, ImageView};

/// Segments that lie within this distance of each other are one edge, px.
const SAME_EDGE_PX: f64 = 1.0;

/// One camera and the segments of its newest image.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) camera: RigCamera,
    pub(super) extractor: LineExtractor,
    pub(super) is_new: bool,
    pub(super) segments: Vec<Segment>,
    pub(super) lines: Vec<ImageLine>,
    pub(super) descriptors: Vec<LineDescriptor>,
    /// Tracks, by their index: where they are expected in the image, and what they looked like.
    pub(super) guides: Vec<(u16, Segment, LineDescriptor)>,
    /// Tracks of the segments that were found there.
    pub(super) followed: Vec<u16>,
}

impl View {
    pub(super) fn new(model: CameraModel, options: &LinesConfig) -> Self {
        let room = options.max_segments;
        Self {
            extractor: LineExtractor::new(model.width_px, model.height_px, options),
            camera: RigCamera::new(model),
            is_new: false,
            segments: Vec::with_capacity(room),
            lines: Vec::with_capacity(room),
            descriptors: Vec::with_capacity(room),
            guides: Vec::with_capacity((1 + PARTS) * room),
            followed: Vec::with_capacity(room),
        }
    }

    /// Finds the segments of an image that tracks are expected to have.
    pub(super) fn follow(&mut self, image: Option<&ImageView<'_>>) {
        self.segments.clear();
        self.lines.clear();
        self.descriptors.clear();
        self.followed.clear();
        let image = image.filter(|image| self.extractor.is_for(image));
        self.is_new = image.is_some();
        let Some(image) = image else { return };
        for k in 0..self.guides.len() {
            let (track, guide, descriptor) = self.guides[k];
            if self.extractor.find_near(image, &guide).is_some_and(|segment| self.add(&segment)) {
                self.followed.push(track);
                self.descriptors.push(descriptor);
            }
        }
    }

    /// Expects a track between two ends, as far as there is room.
    pub(super) fn guide(
        &mut self,
        (track, descriptor): (usize, LineDescriptor),
        [a, b]: [Vector2<f64>; 2],
        strength: f32,
    ) -> Option<()> {
        let mut nodes = [SegmentNode { px: Vector2::zeros(), weight: 1.0 }; NODES];
        for (k, node) in nodes.iter_mut().enumerate() {
            let xy: Vector2<f64> = a + (b - a) * (k as f64 / (NODES - 1) as f64);
            node.px = self.camera.project(&xy.push(1.0))?.0.cast();
        }
        let (start, end) = (nodes[0].px, nodes[NODES - 1].px);
        let segment = Segment { start, end, nodes, strength, support: NODES as f32 };
        self.guides.push((track as u16, segment, descriptor));
        Some(())
    }

    /// Adds the other segments of a part of the image.
    pub(super) fn extract(&mut self, image: Option<&ImageView<'_>>, part: usize) {
        let Some(image) = image.filter(|_| self.is_new) else { return };
        for k in 0..self.extractor.extract_part(image, part, &self.segments).len() {
            let segment = self.extractor.segments()[k];
            self.add(&segment);
        }
    }

    /// Adds a segment if there is room, and its edge has none yet.
    fn add(&mut self, segment: &Segment) -> bool {
        let gate = SAME_EDGE_PX / self.camera.focal_px();
        let line = ImageLine::of(segment, &self.camera).filter(|line| {
            let place = Expected::new(&line.ends_xy, gate);
            self.lines.len() < self.lines.capacity() && !self.lines.iter().any(|other| place.admits(other))
        });
        self.segments.extend(line.map(|_| *segment));
        self.lines.extend(line);
        line.is_some()
    }

    /// Describes the new segments, and anew those in the part of the image that was searched.
    pub(super) fn describe(&mut self, describer: &Describer) {
        let gradients = self.extractor.gradients();
        for (k, segment) in self.segments.iter().enumerate() {
            if k >= self.descriptors.len() {
                self.descriptors.push(describer.describe(gradients, segment));
            } else if self.extractor.is_searched(&segment.middle()) {
                self.descriptors[k] = describer.describe(gradients, segment);
            }
        }
    }
}
