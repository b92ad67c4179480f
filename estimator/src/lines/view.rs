//! One camera and the segments of its newest image.

use super::descriptor::{Describer, LineDescriptor};
use super::extractor::LineExtractor;
use super::gates::Expected;
use super::measurement::ImageLine;
use super::segment::{NODES, Segment, SegmentNode};
use crate::points::rig::RigCamera;
use nalgebra::Vector2;
use plumbline_config::options::LinesConfig;
use plumbline_config::{CameraModel, ImageView};

/// Lines are sought in one of so many frames, and a track that is not seen is expected in so many.
pub(super) const SEARCH_EVERY: u32 = 3;
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
    /// Where tracks, by their index, are expected in the image.
    pub(super) guides: Vec<(u16, Segment)>,
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
            guides: Vec::with_capacity((1 + SEARCH_EVERY as usize) * room),
            followed: Vec::with_capacity(room),
        }
    }

    /// Finds the segments of an image that tracks are expected to have.
    pub(super) fn follow(&mut self, image: Option<&ImageView<'_>>) {
        self.segments.clear();
        self.lines.clear();
        self.followed.clear();
        let image = image.filter(|image| self.extractor.is_for(image));
        self.is_new = image.is_some();
        let Some(image) = image else { return };
        for k in 0..self.guides.len() {
            let (track, guide) = self.guides[k];
            if self.extractor.find_near(image, &guide).is_some_and(|segment| self.add(&segment)) {
                self.followed.push(track);
            }
        }
    }

    /// Expects a track between two ends, as far as there is room.
    pub(super) fn guide(&mut self, track: usize, [a, b]: [Vector2<f64>; 2], strength: f32) -> Option<()> {
        let mut nodes = [SegmentNode { px: Vector2::zeros(), weight: 1.0 }; NODES];
        for (k, node) in nodes.iter_mut().enumerate() {
            let xy: Vector2<f64> = a + (b - a) * (k as f64 / (NODES - 1) as f64);
            node.px = self.camera.project(&xy.push(1.0))?.0.cast();
        }
        let (start, end) = (nodes[0].px, nodes[NODES - 1].px);
        self.guides.push((track as u16, Segment { start, end, nodes, strength, support: NODES as f32 }));
        Some(())
    }

    /// Adds all other segments of the image.
    pub(super) fn extract(&mut self, image: Option<&ImageView<'_>>) {
        let image = image.filter(|_| self.is_new);
        for k in 0..image.and_then(|image| self.extractor.extract(image)).map_or(0, <[_]>::len) {
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

    pub(super) fn describe(&mut self, describer: &Describer) {
        let gradients = self.extractor.gradients();
        self.descriptors.clear();
        self.descriptors.extend(self.segments.iter().map(|s| describer.describe(gradients, s)));
    }
}
