//! The point front-end: images in, tracked points out.
//!
//! Everything is allocated at construction; a frame costs a bounded amount of work, counted in points and
//! never in time. The left camera leads while it delivers; when its image is missing the tracks go on in the
//! right one, and find back to the left when it returns.

mod begin;
mod follow;
mod predicted;
mod witnessed;

use super::PointObservation;
use super::corners::CornerDetector;
use super::outliers::OutlierFilter;
use super::pairing::Pairing;
use super::prediction::{AROUND, DepthMap, PredictedMotion, WitnessedTurn};
use super::repetition::RepetitionWatch;
use super::rig::{Baseline, RigCamera};
use super::stereo::StereoPair;
use super::track::{Track, TrackStore};
use crate::estimate::{Stage, StageProbe};
use crate::image::Pyramid;
use crate::image::mask::ImageMask;
use crate::image::noise::NoiseWatch;
use crate::image::patch::SIDE;
use crate::image::pyramid::Smoothing;
use crate::shutter::RowTurns;
use crate::work_budget::Fork;
use nalgebra::{Isometry3, UnitQuaternion, Vector2};
use plumbline_config::options::{PixelMask, PointsConfig};
use plumbline_config::{CameraModel, ImageView, Portable};

/// Every track without a stereo match looks for one in one of this many frames.
const SEARCH_PERIOD: u64 = 4;
/// Searches of old tracks a frame at most; bounds the worst frame.
const MAX_SEARCHES: usize = 30;
/// A track that the left camera does not see, though it delivers, is given up after this many frames.
const MAX_WITHOUT_LEFT: u32 = 3;
/// Two tracks closer than this follow the same corner, px: the younger one goes.
const MIN_SEPARATION_PX: f64 = 4.0;

/// Points keep this distance from what a mask hides, px: half a patch, which looks at what is around a point.
const PATCH_REACH_PX: usize = SIDE / 2;

/// One frame for the tracker.
#[derive(Clone, Copy, Debug)]
pub struct TrackerInput<'a> {
    /// Left and right image; `None` when missing. An image of the wrong size counts as missing.
    pub images: [Option<ImageView<'a>>; 2],
    /// Predicted rotation since the last call: takes coordinates of the current body frame to the previous.
    pub rot_prev_cur: UnitQuaternion<f64>,
}

/// The images of one camera.
#[derive(Clone, Debug)]
struct View {
    current: Pyramid,
    previous: Pyramid,
    /// Belongs to the view and not to its pyramids, which are exchanged for others ([`PointTracker::exchange_images`]).
    denoising: Option<(NoiseWatch, Smoothing)>,
    /// Frames of the tracker that the two show, 0 for none.
    current_frame: u64,
    previous_frame: u64,
    /// True if `previous` holds an image.
    has_previous: bool,
    /// True if `current` holds an image of this frame.
    is_new: bool,
    /// Frames since the previous image.
    frames: u32,
    /// Takes current body coordinates to those of the previous image.
    rot_prev_cur_b: UnitQuaternion<f64>,
}

impl View {
    fn new(camera: &CameraModel, levels: usize, denoises: bool) -> Self {
        let pyramid = Pyramid::new(camera.width_px, camera.height_px, levels);
        Self {
            current: pyramid.clone(),
            previous: pyramid,
            denoising: denoises
                .then(|| (NoiseWatch::default(), Smoothing::new(camera.width_px, camera.height_px))),
            current_frame: 0,
            previous_frame: 0,
            has_previous: false,
            is_new: false,
            frames: 0,
            rot_prev_cur_b: UnitQuaternion::identity(),
        }
    }

    fn take(&mut self, frame: u64, image: Option<&ImageView<'_>>, rot_prev_cur_b: &UnitQuaternion<f64>) {
        self.rot_prev_cur_b *= rot_prev_cur_b;
        self.frames += 1;
        self.is_new = image.is_some_and(|i| self.current.build(i));
        if !self.is_new {
            return;
        }
        self.current_frame = frame;
        if let Some((noise, smoothing)) = &mut self.denoising
            && noise.is_noisy(&self.current)
        {
            self.current.smooth(smoothing);
        }
    }

    fn finish(&mut self) {
        if self.is_new {
            std::mem::swap(&mut self.current, &mut self.previous);
            std::mem::swap(&mut self.current_frame, &mut self.previous_frame);
            self.has_previous = true;
            self.is_new = false;
            self.frames = 0;
            self.rot_prev_cur_b = UnitQuaternion::identity();
        }
    }

    fn can_follow(&self) -> bool {
        self.is_new && self.has_previous
    }
}

/// Tracks points through the images of one or two cameras.
#[derive(Clone, Debug)]
pub struct PointTracker {
    options: PointsConfig,
    rig: Vec<RigCamera>,
    views: Vec<View>,
    detectors: Vec<CornerDetector>,
    masks: [Option<ImageMask>; 2],
    filter: OutlierFilter,
    store: TrackStore,
    taken: Vec<Vector2<f32>>,
    /// Places of older tracks, px.
    older_px: Vec<Vector2<f64>>,
    observations: Vec<PointObservation>,
    frame: u64,
    limit: usize,
    motion: Option<PredictedMotion>,
    depths: DepthMap,
    turn: Option<WitnessedTurn>,
    /// Tracks as they were before they were followed, where that may be done once more.
    before: Vec<Track>,
    repetition: RepetitionWatch,
    /// Frames for which predictions are refused, since most points were not where the last one put them.
    refused: u32,
    /// True once the window had a state, until a reset.
    has_started: bool,
}

impl PointTracker {
    /// A tracker for one or two cameras (left first), allocated for its lifetime.
    #[must_use]
    pub fn new(options: &PointsConfig, cameras: &[CameraModel]) -> Self {
        let cameras = &cameras[..cameras.len().min(2)];
        let focal_px = cameras.first().map_or(0.0, |c| c.focal_px.x);
        let detector = |c: &CameraModel| {
            let (cell, border) = (options.cell_px, options.border_px + 2);
            CornerDetector::new(c.width_px, c.height_px, cell, border, options.min_corner_score)
        };
        Self {
            options: options.clone(),
            rig: cameras.iter().map(|&c| RigCamera::new(c)).collect(),
            views: cameras.iter().map(|c| View::new(c, options.pyramid_levels, options.denoise)).collect(),
            detectors: cameras.iter().map(detector).collect(),
            masks: [None, None],
            filter: OutlierFilter::new(options.max_points),
            store: TrackStore::new(options.max_points),
            taken: Vec::with_capacity(options.max_points),
            older_px: Vec::with_capacity(options.max_points),
            observations: Vec::with_capacity(options.max_points),
            frame: 0,
            limit: options.max_points,
            motion: None,
            depths: DepthMap::new(options.max_points, AROUND * focal_px),
            turn: None,
            before: Vec::with_capacity(options.max_points),
            repetition: RepetitionWatch::default(),
            refused: 0,
            has_started: false,
        }
    }

    /// Looks from now on only at what the masks of the cameras leave, where there are any.
    pub fn set_masks(&mut self, masks: [Option<&PixelMask>; 2]) {
        self.masks = masks.map(|mask| mask.map(|mask| ImageMask::new(mask, PATCH_REACH_PX)));
        for (detector, mask) in self.detectors.iter_mut().zip(&self.masks) {
            mask.iter().for_each(|mask| detector.set_mask(mask.clone()));
        }
    }

    /// Sets the extrinsics `T_BC` (camera to body coordinates) of each camera, as refined so far.
    pub fn set_extrinsics(&mut self, pose_b_c: &[Isometry3<f64>]) {
        for (camera, pose) in self.rig.iter_mut().zip(pose_b_c) {
            camera.pose_b_c = *pose;
        }
    }

    /// Sets how each camera turns between the rows of the next frame.
    pub fn set_rows(&mut self, rows: &[RowTurns; 2]) {
        self.rig.iter_mut().zip(rows).for_each(|(camera, rows)| camera.rows = *rows);
    }

    /// Tracks at most so many points from now on; the configuration may allow fewer.
    pub fn set_limit(&mut self, max_points: usize) {
        self.limit = max_points.min(self.options.max_points);
    }

    /// Forgets all tracks and images. No track id is used twice.
    pub fn reset(&mut self) {
        self.store.clear();
        self.observations.clear();
        self.has_started = false;
        for view in &mut self.views {
            view.has_previous = false;
        }
    }

    /// Ends a track that proved wrong elsewhere.
    pub fn drop_track(&mut self, track_id: u32) {
        self.store.tracks.iter_mut().for_each(|t| t.lost = t.id == track_id);
        self.store.sweep();
    }

    /// Frames tracked so far: the number of the last one, counted from 1.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// Exchanges the pyramids of the frame before the last one, which the tracker needs no more, for those of
    /// `images`, if it is frame `frame`; says which cameras' were there.
    pub fn exchange_images(&mut self, frame: u64, images: &mut [Pyramid]) -> [bool; 2] {
        let mut given = [false; 2];
        for (camera, (view, image)) in self.views.iter_mut().zip(images).enumerate() {
            if view.current_frame == frame && !view.is_new {
                std::mem::swap(&mut view.current, image);
                view.current_frame = 0;
                given[camera] = true;
            }
        }
        given
    }

    /// Turn since the frame before by corners of their own, where it was looked for and they agree.
    pub fn turn(&self) -> Option<WitnessedTurn> {
        self.turn
    }

    /// The points seen in the last frame, in order of track id.
    pub fn observations(&self) -> &[PointObservation] {
        &self.observations
    }

    /// Tracks points into a frame, and returns those seen in it, in order of track id.
    pub fn track<P: StageProbe>(
        &mut self,
        input: &TrackerInput<'_>,
        fork: &dyn Fork,
        probe: &mut P,
    ) -> &[PointObservation] {
        probe.begin(Stage::Points);
        self.frame += 1;
        self.observations.clear();
        self.turn = None;
        self.take_images(input, fork);
        if self.views.iter().any(|v| v.is_new) {
            self.end_tracks_of_before();
            self.follow();
            self.reject_outliers();
            self.pair_tracks();
            self.prune();
            self.detect();
            self.observe();
            self.views.iter_mut().for_each(View::finish);
        }
        probe.end(Stage::Points);
        &self.observations
    }

    /// Builds the pyramids of both images.
    fn take_images(&mut self, input: &TrackerInput<'_>, fork: &dyn Fork) {
        let [left, right] = &input.images;
        let frame = self.frame;
        match self.views.as_mut_slice() {
            [a, b] => fork.join(&mut || a.take(frame, left.as_ref(), &input.rot_prev_cur), &mut || {
                b.take(frame, right.as_ref(), &input.rot_prev_cur);
            }),
            views => views.iter_mut().for_each(|view| view.take(frame, left.as_ref(), &input.rot_prev_cur)),
        }
    }

    /// Drops what contradicts the motion of the camera.
    fn reject_outliers(&mut self) {
        for (c, view) in self.views.iter().enumerate().filter(|(_, v)| v.can_follow()) {
            let camera = &self.rig[c];
            self.filter.clear();
            for (before, now) in self.store.tracks.iter().filter_map(|track| track.step_in(c)) {
                self.filter.add(&before, &now);
            }
            let told = self.turn.filter(|turn| turn.is_other && view.frames == 1);
            let rotation = camera.rotation_of(&told.map_or(view.rot_prev_cur_b, |turn| turn.rot_prev_cur_b));
            let mut keep = self.filter.filter(&rotation, camera.focal_px(), self.frame).iter();
            for track in self.store.tracks.iter_mut().filter(|t| t.step_in(c).is_some()) {
                track.lost = !keep.next().is_none_or(|&k| k);
            }
        }
        self.store.sweep();
    }

    /// Finds the followed tracks in the other camera.
    fn pair_tracks(&mut self) {
        if self.is_start_of_one_camera() {
            for track in &mut self.store.tracks {
                track.came_by.into_iter().for_each(|(by, _)| track.unsee(1 - by));
            }
            return;
        }
        let mut searches = 0;
        let is_strict = self.is_strict();
        for (from, to) in [(0, 1), (1, 0)] {
            let Some(pairing) = pairing(&self.rig, &self.views, &self.options, is_strict, [from, to])
                .map(|pairing| Pairing { mask: self.masks[to].as_ref(), ..pairing })
            else {
                continue;
            };
            for (track, reference) in self.store.iter_mut() {
                if track.came_by.is_none_or(|(by, _)| by != from)
                    || pairing.continue_match(track, reference).is_some()
                {
                    continue;
                }
                let was_seen = track.px[to].is_some();
                track.unsee(to);
                let turn = (self.frame + u64::from(track.id)).is_multiple_of(SEARCH_PERIOD);
                if (was_seen || turn || to == 0) && searches < MAX_SEARCHES {
                    searches += 1;
                    pairing.search(track, reference, track.depth.filter(|_| self.motion.is_some()));
                }
            }
        }
    }

    /// Ends tracks that the leading camera has lost, and all but the oldest of those that have met.
    fn prune(&mut self) {
        if self.views[0].is_new {
            for track in &mut self.store.tracks {
                track.without_left = if track.px[0].is_some() { 0 } else { track.without_left + 1 };
                track.lost = track.without_left > MAX_WITHOUT_LEFT;
            }
        }
        let leading = self.leading();
        self.older_px.clear();
        for track in &mut self.store.tracks {
            let Some(px) = track.px[leading] else { continue };
            // All of them, without an end at the first that is near: many at a time.
            let is_near = |q: &Vector2<f64>| (q - px).norm_squared() < MIN_SEPARATION_PX.squared();
            track.lost |= self.older_px.iter().fold(false, |near, q| near | is_near(q));
            if !track.lost {
                self.older_px.push(px);
            }
        }
        self.store.sweep();
        self.store.tracks.iter_mut().for_each(|t| t.age += 1);
    }

    /// The camera in which new points are found.
    fn leading(&self) -> usize {
        usize::from(!self.views[0].is_new)
    }

    /// Writes down what this frame's images show.
    fn observe(&mut self) {
        let is_new: [bool; 2] = std::array::from_fn(|c| self.views.get(c).is_some_and(|v| v.is_new));
        for track in &self.store.tracks {
            let mut seen = PointObservation {
                track_id: track.id,
                age: track.age,
                px: [None; 2],
                xy: [None; 2],
                covariance_px2: track.covariance_px2,
            };
            for c in (0..2).filter(|&c| is_new[c]) {
                (seen.px[c], seen.xy[c]) = (track.px[c], track.xy[c]);
            }
            if seen.px[0].is_some() || seen.px[1].is_some() {
                self.observations.push(seen);
            }
        }
    }
}

/// The pairing from one camera to the other, when both have an image.
fn pairing<'a>(
    rig: &'a [RigCamera],
    views: &'a [View],
    options: &PointsConfig,
    is_unique_only: bool,
    [from, to]: [usize; 2],
) -> Option<Pairing<'a>> {
    let (a, b) = (views.get(from)?, views.get(to)?);
    (a.is_new && b.is_new).then(|| Pairing {
        from,
        to,
        pair: StereoPair {
            from: (&rig[from], &a.current),
            to: (&rig[to], &b.current),
            baseline: Baseline::between(&rig[from], &rig[to]),
            max_iterations: options.max_iterations,
            max_return_px: options.max_forward_backward_px,
            is_unique_only,
        },
        max_epipolar_px: f64::from(options.max_epipolar_px),
        border_px: options.border_px as f64,
        mask: None,
    })
}
