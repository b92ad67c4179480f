//! The line front-end: images in, tracked segments out.
//!
//! Segments are found anew in every image, so that they do not drift, and tracked by matching them with those
//! of the frame before, turned by the gyroscope and moved on as they moved last. A track that finds no
//! segment is expected a few frames longer. The left camera leads; without its image no line is seen.

use super::descriptor::{Describer, LineDescriptor};
use super::extractor::{ExtractionFigures, LineExtractor};
use super::gates::{Expected, StereoCandidate, StereoGate};
use super::matching::LineMatcher;
use super::measurement::ImageLine;
use super::segment::Segment;
use crate::estimate::{Stage, StageProbe};
use crate::points::rig::{Baseline, RigCamera};
use crate::shutter::RowTurns;
use crate::work_budget::{Fork, WorkBudget};
use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::options::{LinesConfig, PixelMask};
use plumbline_config::{CameraModel, ImageView};

/// A track is expected for this many frames without being seen.
const MAX_MISSED: u32 = 3;
/// A new track is looked for within this distance, px; one whose motion is known within the second.
const GATE_NEW_PX: f64 = 25.0;
const GATE_KNOWN_PX: f64 = 8.0;
/// Segments along epipolar lines are looked for within this distance of them, px.
const GATE_EPIPOLAR_PX: f64 = 2.5;

/// One tracked line in one frame.
#[derive(Clone, Copy, Debug)]
pub struct LineObservation {
    /// Id of the track: unique since the tracker was made, never used again.
    pub track_id: u32,
    /// The segment in the left and right image, distorted as measured, where seen.
    pub segments: [Option<Segment>; 2],
    /// Segments in ideal normalized coordinates of each camera, where seen.
    pub lines: [Option<ImageLine>; 2],
}

/// Counts of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineFigures {
    /// Extraction figures of the left image.
    pub left: ExtractionFigures,
    /// Left segments that continue a track.
    pub matched: u32,
    /// Images whose budget was spent before their last seed.
    pub cut_short: u32,
}

/// One camera and the segments of its newest image.
#[derive(Clone, Debug)]
struct View {
    camera: RigCamera,
    extractor: LineExtractor,
    is_new: bool,
    segments: Vec<Segment>,
    lines: Vec<ImageLine>,
    descriptors: Vec<LineDescriptor>,
}

impl View {
    fn new(model: CameraModel, options: &LinesConfig) -> Self {
        let room = options.max_segments;
        Self {
            extractor: LineExtractor::new(model.width_px, model.height_px, options),
            camera: RigCamera::new(model),
            is_new: false,
            segments: Vec::with_capacity(room),
            lines: Vec::with_capacity(room),
            descriptors: Vec::with_capacity(room),
        }
    }

    fn extract(&mut self, image: Option<&ImageView<'_>>) {
        self.segments.clear();
        self.lines.clear();
        self.descriptors.clear();
        self.is_new = image.is_some_and(|i| self.extractor.extract(i).is_some());
        if self.is_new {
            for segment in self.extractor.segments() {
                if let Some(line) = ImageLine::of(segment, &self.camera) {
                    self.segments.push(*segment);
                    self.lines.push(line);
                }
            }
        }
    }

    fn describe(&mut self, describer: &Describer) {
        let gradients = self.extractor.gradients();
        self.descriptors.extend(self.segments.iter().map(|s| describer.describe(gradients, s)));
    }
}

/// A line that is followed.
#[derive(Clone, Copy, Debug)]
struct Track {
    id: u32,
    missed: u32,
    /// Ends in the left camera: seen, or expected while it is missed.
    ends_xy: [Vector2<f64>; 2],
    /// Motion across itself in the last frame beyond that of a far edge.
    drift: Option<f64>,
    /// Index of its segment in the left image.
    seen: Option<u16>,
}

/// Tracks line segments through the images of one or two cameras. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct LineTracker {
    views: Vec<View>,
    describer: Describer,
    matcher: LineMatcher,
    tracks: Vec<Track>,
    descriptors: Vec<LineDescriptor>,
    expected: Vec<Option<Expected>>,
    /// The right segments.
    candidates: Vec<StereoCandidate>,
    is_taken: Vec<bool>,
    partner: Vec<Option<u16>>,
    observations: Vec<LineObservation>,
    figures: LineFigures,
    max_tracks: usize,
    next_id: u32,
}

impl LineTracker {
    /// A tracker for one or two cameras (left first).
    #[must_use]
    pub fn new(options: &LinesConfig, cameras: &[CameraModel]) -> Self {
        // Each segment of the frames in which a track may be missed may have begun one.
        let room = (1 + MAX_MISSED as usize) * options.max_segments;
        Self {
            views: cameras.iter().take(2).map(|c| View::new(*c, options)).collect(),
            describer: Describer::default(),
            matcher: LineMatcher::new(options, room),
            tracks: Vec::with_capacity(room),
            descriptors: Vec::with_capacity(room),
            expected: Vec::with_capacity(room),
            candidates: Vec::with_capacity(room),
            is_taken: Vec::with_capacity(room),
            partner: Vec::with_capacity(room),
            observations: Vec::with_capacity(room),
            figures: LineFigures::default(),
            max_tracks: room,
            next_id: 0,
        }
    }

    /// Looks from now on only at what the masks of the cameras leave, where there are any.
    pub fn set_masks(&mut self, masks: [Option<&PixelMask>; 2]) {
        for (view, mask) in self.views.iter_mut().zip(masks) {
            mask.into_iter().for_each(|mask| view.extractor.set_mask(mask));
        }
    }

    /// Sets the extrinsics `T_BC` (camera to body coordinates) of each camera, as refined so far.
    pub fn set_extrinsics(&mut self, pose_b_c: &[Isometry3<f64>]) {
        for (view, pose) in self.views.iter_mut().zip(pose_b_c) {
            view.camera.pose_b_c = *pose;
        }
    }

    /// Limits the work on an image from now on.
    pub fn set_budget(&mut self, budget: &WorkBudget) {
        self.views.iter_mut().for_each(|view| view.extractor.set_budget(budget));
    }

    /// Forgets all tracks. Their ids are not used again.
    pub fn reset(&mut self) {
        self.tracks.clear();
        self.descriptors.clear();
        self.observations.clear();
    }

    /// Sets how each camera turns between the rows of the next frame.
    pub fn set_rows(&mut self, rows: &[RowTurns; 2]) {
        self.views.iter_mut().zip(rows).for_each(|(view, rows)| view.camera.rows = *rows);
    }

    /// Counts of the last frame.
    pub fn figures(&self) -> LineFigures {
        self.figures
    }

    /// The lines seen in the last frame, in order of track id.
    pub fn observations(&self) -> &[LineObservation] {
        &self.observations
    }

    /// Tracks lines into a frame, and returns those seen in it, in order of track id; `rot_prev_cur` takes
    /// coordinates of the current body frame to those of the last call's. An image of the wrong size counts as
    /// missing. Stages are timed by `probe`; which threads of `fork` do the work has no say in the outcome.
    pub fn track(
        &mut self,
        images: &[Option<ImageView<'_>>; 2],
        rot_prev_cur: &UnitQuaternion<f64>,
        fork: &dyn Fork,
        probe: &mut impl StageProbe,
    ) -> &[LineObservation] {
        probe.begin(Stage::LinesExtract);
        each_view(fork, &mut self.views, &|k, view| view.extract(images[k].as_ref()));
        probe.end(Stage::LinesExtract);
        probe.begin(Stage::LinesDescribe);
        each_view(fork, &mut self.views, &|_, view| view.describe(&self.describer));
        probe.end(Stage::LinesDescribe);
        probe.begin(Stage::LinesMatch);
        self.figures = LineFigures {
            left: self.views.first().map(|v| v.extractor.figures()).unwrap_or_default(),
            cut_short: self.views.iter().filter(|v| v.is_new && v.extractor.figures().is_cut_short).count()
                as u32,
            ..LineFigures::default()
        };
        self.expect(rot_prev_cur);
        self.continue_tracks();
        self.begin_tracks();
        self.pair();
        self.observe();
        probe.end(Stage::LinesMatch);
        &self.observations
    }

    /// Ends tracks that proved wrong elsewhere: what they follow gets a new id when it is seen again.
    pub fn drop_tracks(&mut self, track_ids: &[u32]) {
        for &id in track_ids {
            if let Ok(at) = self.tracks.binary_search_by_key(&id, |t| t.id) {
                self.tracks.remove(at);
                self.descriptors.remove(at);
            }
        }
    }

    /// Turns the tracks into this frame: where each is expected.
    fn expect(&mut self, rot_prev_cur: &UnitQuaternion<f64>) {
        let Some(left) = self.views.first() else { return };
        let rot_b_c = left.camera.pose_b_c.rotation;
        let rot_cur_prev = (rot_b_c.inverse() * rot_prev_cur.inverse() * rot_b_c).to_rotation_matrix();
        let focal_px = left.camera.focal_px();
        self.expected.clear();
        for track in &mut self.tracks {
            track.seen = None;
            self.expected.push(turned(&rot_cur_prev, &track.ends_xy).map(|ends_xy| {
                track.ends_xy = ends_xy;
                let direction = (ends_xy[1] - ends_xy[0]).normalize();
                let shift = Vector2::new(-direction.y, direction.x) * track.drift.unwrap_or(0.0);
                let gate_px = if track.drift.is_some() { GATE_KNOWN_PX } else { GATE_NEW_PX };
                Expected::new(&ends_xy.map(|xy| xy + shift), gate_px / focal_px)
            }));
        }
    }

    /// Finds the tracks in the left image. Not inlined, nor is [`Self::pair`]: `make bench-instructions` tells stages apart by
    /// their functions.
    #[inline(never)]
    fn continue_tracks(&mut self) {
        let Self { views, matcher, tracks, descriptors, expected, is_taken, figures, .. } = self;
        let Some(left) = views.first() else { return };
        is_taken.clear();
        is_taken.resize(left.segments.len(), false);
        let admits = |i: usize, j: usize| expected[i].as_ref().is_some_and(|e| e.admits(&left.lines[j]));
        for &(i, j) in matcher.pairs(descriptors, &left.descriptors, admits) {
            let (i, j) = (usize::from(i), usize::from(j));
            let track = &mut tracks[i];
            let line = &left.lines[j];
            track.drift = Some(
                Expected::new(&track.ends_xy, 0.0).offset_of(&line.ends_xy) / f64::from(1 + track.missed),
            );
            track.ends_xy = line.ends_xy;
            track.seen = Some(j as u16);
            descriptors[i] = left.descriptors[j];
            is_taken[j] = true;
            figures.matched += 1;
        }
        let mut kept = 0;
        for i in 0..tracks.len() {
            let mut track = tracks[i];
            track.missed = if track.seen.is_some() { 0 } else { track.missed + 1 };
            if track.missed <= MAX_MISSED && expected[i].is_some() {
                (tracks[kept], descriptors[kept]) = (track, descriptors[i]);
                kept += 1;
            }
        }
        tracks.truncate(kept);
        descriptors.truncate(kept);
    }

    /// Every left segment that continues no track begins one.
    fn begin_tracks(&mut self) {
        let Some(left) = self.views.first() else { return };
        for (j, line) in left.lines.iter().enumerate().filter(|(j, _)| !self.is_taken[*j]) {
            if self.tracks.len() == self.max_tracks {
                break;
            }
            self.tracks.push(Track {
                id: self.next_id,
                missed: 0,
                ends_xy: line.ends_xy,
                drift: None,
                seen: Some(j as u16),
            });
            self.descriptors.push(left.descriptors[j]);
            self.next_id += 1;
        }
    }

    /// Finds the left segments in the right image.
    #[inline(never)]
    fn pair(&mut self) {
        let Self { views, matcher, candidates, partner, .. } = self;
        let Some(left) = views.first() else { return };
        partner.clear();
        partner.resize(left.segments.len(), None);
        let Some(right) = views.get(1).filter(|v| v.is_new) else { return };
        let gate = StereoGate {
            baseline: Baseline::between(&left.camera, &right.camera),
            gate: GATE_EPIPOLAR_PX / right.camera.focal_px(),
        };
        candidates.clear();
        candidates.extend(right.lines.iter().map(|line| gate.candidate(line)));
        let mut expected = (usize::MAX, None);
        let admits = |i: usize, j: usize| {
            if expected.0 != i {
                expected = (i, gate.expect(&left.lines[i]));
            }
            expected.1.is_some_and(|e| gate.admits(&e, &candidates[j]))
        };
        for &(i, j) in matcher.pairs(&left.descriptors, &right.descriptors, admits) {
            partner[usize::from(i)] = Some(j);
        }
    }

    /// Writes down what this frame's images show.
    fn observe(&mut self) {
        self.observations.clear();
        let Some(left) = self.views.first() else { return };
        for track in &self.tracks {
            let Some(j) = track.seen.map(usize::from) else { continue };
            let mut seen = LineObservation {
                track_id: track.id,
                segments: [Some(left.segments[j]), None],
                lines: [Some(left.lines[j]), None],
            };
            if let (Some(k), Some(right)) = (self.partner[j].map(usize::from), self.views.get(1)) {
                (seen.segments[1], seen.lines[1]) = (Some(right.segments[k]), Some(right.lines[k]));
            }
            self.observations.push(seen);
        }
    }
}

/// Does the same for each camera, side by side where there are cores for it.
fn each_view(fork: &dyn Fork, views: &mut [View], work: &(dyn Fn(usize, &mut View) + Sync)) {
    match views {
        [left, right] => fork.join(&mut || work(0, left), &mut || work(1, right)),
        views => views.iter_mut().enumerate().for_each(|(k, view)| work(k, view)),
    }
}

/// Ends of a far edge after a rotation of the camera; `None` out of its sight.
fn turned(rot_cur_prev: &Rotation3<f64>, ends_xy: &[Vector2<f64>; 2]) -> Option<[Vector2<f64>; 2]> {
    let turn = |xy: &Vector2<f64>| {
        let q = rot_cur_prev * Vector3::new(xy.x, xy.y, 1.0);
        (q.z > 0.1).then(|| q.xy() / q.z)
    };
    Some([turn(&ends_xy[0])?, turn(&ends_xy[1])?])
}
