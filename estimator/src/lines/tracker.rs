//! The line front-end: images in, tracked segments out.
//!
//! Tracks are looked for in every image where they must be: by depth and predicted motion where both cameras saw a line aslant to its
//! epipolar lines, else by the turn and their motion of the last frame. Other segments are sought in one of [`PARTS`] parts of the
//! images, in turns; they continue tracks that were missed, by their looks, or begin new ones. The edge is found anew in every image, so
//! that nothing drifts. A track that finds no segment is expected until its part has been searched again. The left camera leads; without
//! its image no line is seen.

use super::descriptor::{Describer, LineDescriptor};
use super::extractor::{ExtractionFigures, PARTS};
use super::gates::{Expected, StereoCandidate, StereoGate};
use super::matching::LineMatcher;
use super::measurement::ImageLine;
use super::segment::Segment;
use super::view::View;
use crate::estimate::{Stage, StageProbe};
use crate::points::rig::Baseline;
use crate::shutter::RowTurns;
use crate::work_budget::{Fork, WorkBudget};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2};
use plumbline_config::options::{LinesConfig, PixelMask};
use plumbline_config::{CameraModel, ImageView};

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
    /// Mean gradient of its segments, where seen, grey levels per pixel.
    strength: [Option<f32>; 2],
    /// Inverse depths of its ends in the left camera, 1/m, where both see it; 0 where it lies along epipolar lines.
    rho: [f64; 2],
}

impl Track {
    /// Goes on as segment `j` of the left image.
    fn see(&mut self, j: usize, left: &View) {
        let line = &left.lines[j];
        let moved = Expected::new(&self.ends_xy, 0.0).offset_of(&line.ends_xy);
        self.drift = Some(moved / f64::from(1 + self.missed));
        (self.ends_xy, self.seen) = (line.ends_xy, Some(j as u16));
        (self.strength, self.rho) = ([Some(left.segments[j].strength), None], [0.0; 2]);
    }
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
    /// Part of the images that is searched next.
    part: usize,
}

impl LineTracker {
    /// A tracker for one or two cameras (left first).
    #[must_use]
    pub fn new(options: &LinesConfig, cameras: &[CameraModel]) -> Self {
        // Each segment of the frames in which a track may be missed may have begun one.
        let room = (1 + PARTS) * options.max_segments;
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
            part: 0,
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
    /// coordinates of the current body frame to those of the last call's, and so does `motion`, where it is known. An image of the
    /// wrong size counts as missing. Stages are timed by `probe`; which threads of `fork` do the work has no say in the outcome.
    pub fn track(
        &mut self,
        images: &[Option<ImageView<'_>>; 2],
        rot_prev_cur: &UnitQuaternion<f64>,
        motion: Option<&Isometry3<f64>>,
        fork: &dyn Fork,
        probe: &mut impl StageProbe,
    ) -> &[LineObservation] {
        probe.begin(Stage::LinesExtract);
        self.expect(rot_prev_cur, motion);
        let part = self.part;
        self.part = (part + 1) % PARTS;
        each_view(fork, &mut self.views, &|k, view| {
            view.follow(images[k].as_ref());
            view.extract(images[k].as_ref(), part);
        });
        probe.end(Stage::LinesExtract);
        probe.begin(Stage::LinesDescribe);
        each_view(fork, &mut self.views, &|_, view| view.describe(&self.describer));
        let figures = |view: &View| view.extractor.figures();
        self.figures.left = self.views.first().map(figures).unwrap_or_default();
        let cut_short = self.views.iter().filter(|v| v.is_new && figures(v).is_cut_short);
        self.figures.cut_short = cut_short.count() as u32;
        probe.end(Stage::LinesDescribe);
        probe.begin(Stage::LinesMatch);
        self.continue_followed();
        self.continue_tracks();
        self.begin_tracks();
        self.pair();
        self.observe();
        self.end_tracks();
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

    /// Turns the tracks into this frame: where each is expected, and as far as its motion is known, where each camera must see it.
    fn expect(&mut self, rot_prev_cur: &UnitQuaternion<f64>, motion: Option<&Isometry3<f64>>) {
        let Some(left) = self.views.first() else { return };
        let (pose_b_left, focal_px) = (left.camera.pose_b_c, left.camera.focal_px());
        let turn = Isometry3::from_parts(Translation3::identity(), *rot_prev_cur);
        self.expected.clear();
        self.views.iter_mut().for_each(|view| view.guides.clear());
        for (i, (track, descriptor)) in self.tracks.iter_mut().zip(&self.descriptors).enumerate() {
            track.seen = None;
            let motion = motion.filter(|_| track.rho != [0.0; 2]);
            let drift = if motion.is_some() { Some(0.0) } else { track.drift };
            for (view, strength) in self.views.iter_mut().zip(track.strength) {
                let pose_cur_prev = (motion.unwrap_or(&turn) * view.camera.pose_b_c).inverse() * pose_b_left;
                let ends_xy = carried(&pose_cur_prev, &track.ends_xy, &track.rho);
                if let (Some(ends_xy), Some(drift), Some(strength)) = (ends_xy, drift, strength) {
                    view.guide((i, *descriptor), drifted(&ends_xy, drift), strength);
                }
            }
            let turned = (turn * pose_b_left).inverse() * pose_b_left;
            self.expected.push(carried(&turned, &track.ends_xy, &[0.0; 2]).map(|ends_xy| {
                track.ends_xy = ends_xy;
                let gate_px = if track.drift.is_some() { GATE_KNOWN_PX } else { GATE_NEW_PX };
                Expected::new(&drifted(&ends_xy, track.drift.unwrap_or(0.0)), gate_px / focal_px)
            }));
        }
    }

    /// Tracks go on where they were followed to.
    fn continue_followed(&mut self) {
        let Self { views, tracks, descriptors, is_taken, figures, .. } = self;
        let Some(left) = views.first() else { return };
        is_taken.clear();
        for (j, &i) in left.followed.iter().enumerate() {
            let i = usize::from(i);
            tracks[i].see(j, left);
            descriptors[i] = left.descriptors[j];
        }
        is_taken.resize(left.followed.len(), true);
        figures.matched = left.followed.len() as u32;
    }

    /// Finds the tracks that were missed. Not inlined, nor is [`Self::pair`]: `make bench-instructions` tells stages apart by their
    /// functions.
    #[inline(never)]
    fn continue_tracks(&mut self) {
        let Self { views, matcher, tracks, descriptors, expected, is_taken, figures, .. } = self;
        let Some(left) = views.first() else { return };
        is_taken.resize(left.segments.len(), false);
        let admits = |i: usize, j: usize| {
            let is_open = tracks[i].seen.is_none() && !is_taken[j];
            is_open && expected[i].as_ref().is_some_and(|e| e.admits(&left.lines[j]))
        };
        for &(i, j) in matcher.pairs(descriptors, &left.descriptors, admits) {
            let (i, j) = (usize::from(i), usize::from(j));
            tracks[i].see(j, left);
            descriptors[i] = left.descriptors[j];
            is_taken[j] = true;
            figures.matched += 1;
        }
    }

    /// Ends tracks that were missed for too long, or are out of sight.
    fn end_tracks(&mut self) {
        let Self { tracks, descriptors, expected, .. } = self;
        let mut kept = 0;
        for i in 0..tracks.len() {
            let mut track = tracks[i];
            track.missed = if track.seen.is_some() { 0 } else { track.missed + 1 };
            if track.seen.is_some() || track.missed as usize <= PARTS && expected[i].is_some() {
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
                strength: [Some(left.segments[j].strength), None],
                rho: [0.0; 2],
            });
            self.descriptors.push(left.descriptors[j]);
            self.next_id += 1;
        }
    }

    /// Finds the left segments in the right image: by the tracks that were followed there, and by their looks. Notes their depth.
    #[inline(never)]
    fn pair(&mut self) {
        let Self { views, tracks, matcher, candidates, partner, .. } = self;
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
        for (k, &i) in right.followed.iter().enumerate() {
            let Some(j) = tracks[usize::from(i)].seen.map(usize::from) else { continue };
            partner[j] = Some(k as u16);
        }
        let mut expected = (usize::MAX, None);
        let admits = |i: usize, j: usize| {
            if expected.0 != i {
                expected = (i, gate.expect(&left.lines[i]).filter(|_| partner[i].is_none()));
            }
            j >= right.followed.len() && expected.1.is_some_and(|e| gate.meet(&e, &candidates[j]).is_some())
        };
        for &(i, j) in matcher.pairs(&left.descriptors, &right.descriptors, admits) {
            partner[usize::from(i)] = Some(j);
        }
        for track in tracks {
            let Some(j) = track.seen.map(usize::from) else { continue };
            let Some(k) = partner[j].map(usize::from) else { continue };
            let met = gate.expect(&left.lines[j]).and_then(|e| gate.meet(&e, &candidates[k]));
            match met {
                Some(rho) => (track.rho, track.strength[1]) = (rho, Some(right.segments[k].strength)),
                None => partner[j] = None,
            }
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

/// Ends that moved across their line.
fn drifted(ends_xy: &[Vector2<f64>; 2], drift: f64) -> [Vector2<f64>; 2] {
    let direction = (ends_xy[1] - ends_xy[0]).normalize();
    ends_xy.map(|xy| xy + Vector2::new(-direction.y, direction.x) * drift)
}

/// Ends with these inverse depths by another camera; `None` out of its sight.
fn carried(pose: &Isometry3<f64>, ends_xy: &[Vector2<f64>; 2], rho: &[f64; 2]) -> Option<[Vector2<f64>; 2]> {
    let carry = |k: usize| {
        let q = pose.rotation * ends_xy[k].push(1.0) + pose.translation.vector * rho[k];
        (q.z > 0.1).then(|| q.xy() / q.z)
    };
    Some([carry(0)?, carry(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work_budget::InTurn;
    use plumbline_config::options::LinesConfig;
    use plumbline_config::{Config, GrayImage};

    /// A dark bar, upright and 20 px wide, from column `at` on, in the middle, where the lens hardly bends it.
    fn bar(at: usize) -> GrayImage {
        let is_bar = |k: usize| (at..at + 20).contains(&(k % 752)) && (180..300).contains(&(k / 752));
        let pixels = (0..752 * 480).map(|k| if is_bar(k) { 40 } else { 180 });
        GrayImage::from_pixels(752, 480, pixels.collect()).expect("size")
    }

    #[test]
    fn a_line_that_moves_on_is_followed_once_its_motion_is_known() {
        let model = Config::preset("sim").expect("is good").camera[0].model();
        let mut tracker = LineTracker::new(&LinesConfig::default(), &[model]);
        let mut ids = Vec::new();
        // With a speed that changes by a pixel a frame.
        for (k, at) in [300, 303, 307, 312, 318, 325].into_iter().enumerate() {
            let (image, still) = (bar(at), UnitQuaternion::identity());
            let seen = tracker.track(&[Some(image.view()), None], &still, None, &InTurn, &mut ());
            ids.push(seen.iter().map(|line| line.track_id).collect::<Vec<_>>());
            let columns = seen.iter().filter_map(|line| line.segments[0]).map(|segment| segment.middle().x);
            for (column, edge) in columns.zip([at as f32 - 0.5, at as f32 + 19.5]) {
                assert!((column - edge).abs() < 0.1, "frame {k}: {column} px, not {edge}");
            }
        }
        // It lies in the second of the parts, and has no motion before it was seen twice.
        assert_eq!(ids.iter().map(Vec::len).collect::<Vec<_>>(), [0, 2, 0, 0, 2, 2], "{ids:?}");
        assert!(ids.iter().all(|seen| seen.is_empty() || *seen == ids[1]), "{ids:?}");
    }
}
