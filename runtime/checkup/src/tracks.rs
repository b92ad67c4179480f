//! Points followed through the images of both cameras, without a word of calibration or of the gyroscope.
//!
//! A corner of the left image is followed from frame to frame; at keyframes its place is refined against the keyframe before, and
//! it is sought in the right image: by its place there before, else over a wide window of a coarse level, by correlation. Every
//! step must lead back to where it came from.

use nalgebra::{Matrix2, Vector2};
use plumbline_config::{Config, ImageView, Timestamp};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::image::mask::ImageMask;
use plumbline_estimator::points::align::TranslationTemplate;
use plumbline_estimator::points::corners::{CornerDetector, Demand};
use plumbline_estimator::points::flow::{FlowOptions, prepare_at, track_patch};

/// Points that are followed at a time, cells across an image, of which each holds one; border, px; least score.
const POINTS: usize = 100;
const CELLS: usize = 20;
const BORDER_PX: usize = 12;
const MIN_SCORE: f32 = 12.0;
/// Time from one keyframe to the next, s: the odd number of frames that is nearest, so that even and odd ones take turns.
const KEY_S: f64 = 0.15;
/// The coarse level is the first that is narrower, px.
const COARSE_PX: usize = 120;
/// Reach of the search there, as shares of its width.
const REACH: (f32, f32) = (0.2, 0.07);
/// Least correlation there and at full resolution.
const MIN_ZNCC: (f32, f32) = (0.6, 0.85);
/// The best place beats every other by this much, unless it is as near, px of the level.
const LEAD: (f32, f32) = (0.08, 2.5);
/// Largest distance between a point and its return, px, and longest last step of a flow that converged.
const MAX_RETURN_PX: f32 = 0.5;
const MAX_LAST_STEP_PX: f32 = 0.1;
const FLOW: FlowOptions = FlowOptions { top_level: 3, max_iterations: 10 };
/// Reach of a patch around its pixel, for masks.
const PATCH_PX: usize = 6;

/// A point at a keyframe: pixel in the left and in the right image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sighting {
    pub(crate) key: usize,
    pub(crate) px: [Option<Vector2<f32>>; 2],
}

/// Keyframes: stamps, and whether the frame's number is odd.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tracks {
    pub(crate) keys: Vec<(Timestamp, bool)>,
    /// Sightings of each point, in order.
    pub(crate) tracks: Vec<Vec<Sighting>>,
}

impl Tracks {
    /// Time from the first keyframe to the last, s.
    pub(crate) fn span_s(&self) -> f64 {
        let ends = self.keys.first().zip(self.keys.last());
        ends.map_or(0.0, |(first, last)| last.0.seconds_since(first.0))
    }
}

/// A point that is being followed.
struct Live {
    track: usize,
    px: Vector2<f32>,
    at_key: Vector2<f32>,
    right: Option<Vector2<f32>>,
}

/// Follows points from frame to frame.
pub(crate) struct Tracker {
    detector: CornerDetector,
    mask: Option<ImageMask>,
    /// Left image now, before and at the last keyframe, and the right one.
    left: Pyramid,
    before: Pyramid,
    key: Pyramid,
    right: Option<Pyramid>,
    level: usize,
    every: u64,
    frames: u64,
    live: Vec<Live>,
    /// What was followed so far.
    pub(crate) found: Tracks,
}

impl Tracker {
    pub(crate) fn new(config: &Config) -> Option<Self> {
        let left = config.camera.first()?;
        let (width, height) = (left.width_px, left.height_px);
        let level = (0..).find(|level| width >> level <= COARSE_PX)?;
        let pyramid = || Pyramid::new(width, height, level.max(FLOW.top_level) + 1);
        let key = pyramid();
        let level = level.min(key.level_count() - 1);
        let mask = left.mask.as_ref().and_then(|mask| mask.pixels());
        let mask = mask.map(|mask| ImageMask::new(mask, PATCH_PX));
        let mut detector = CornerDetector::new(width, height, width / CELLS, BORDER_PX, MIN_SCORE);
        mask.iter().for_each(|mask| detector.set_mask(mask.clone()));
        let right = config.camera.get(1);
        Some(Self {
            detector,
            mask,
            left: pyramid(),
            before: pyramid(),
            key,
            right: right
                .map(|right| Pyramid::new(right.width_px, right.height_px, level.max(FLOW.top_level) + 1)),
            level,
            every: 2 * (left.rate_hz * KEY_S / 2.0) as u64 + 1,
            frames: 0,
            live: Vec::new(),
            found: Tracks::default(),
        })
    }

    /// Takes a frame with its number. A frame without a left image ends all tracks.
    pub(crate) fn add(&mut self, number: u64, stamp: Timestamp, images: &[Option<ImageView<'_>>; 2]) {
        std::mem::swap(&mut self.left, &mut self.before);
        if !images[0].as_ref().is_some_and(|left| self.left.build(left)) {
            self.live.clear();
            return;
        }
        let is_key = self.frames.is_multiple_of(self.every);
        self.frames += 1;
        let (before, left, mask) = (&self.before, &self.left, &self.mask);
        self.live.retain_mut(|point| {
            let found = followed((before, &point.px), (left, &point.px), !is_key);
            let found = found.filter(|px| !mask.as_ref().is_some_and(|mask| mask.hides_px(&px.cast())));
            found.is_some_and(|px| {
                point.px = px;
                true
            })
        });
        if is_key {
            self.add_key(number, stamp, images[1].as_ref());
        }
    }

    fn add_key(&mut self, number: u64, stamp: Timestamp, right: Option<&ImageView<'_>>) {
        let (key, left) = (&self.key, &self.left);
        self.live.retain_mut(|point| {
            let found = followed((key, &point.at_key), (left, &point.px), true);
            found.is_some_and(|px| {
                (point.px, point.at_key) = (px, px);
                true
            })
        });
        let places: Vec<Vector2<f32>> = self.live.iter().map(|point| point.px).collect();
        let demand = Demand { wanted: POINTS, max_new: POINTS };
        for corner in self.detector.detect(&left.plane(0), &places, &demand) {
            self.live.push(Live {
                track: self.found.tracks.len(),
                px: corner.px,
                at_key: corner.px,
                right: None,
            });
            self.found.tracks.push(Vec::new());
        }
        let has_right = match (&mut self.right, right) {
            (Some(pyramid), Some(right)) => pyramid.build(right),
            _ => false,
        };
        let right = self.right.as_ref().filter(|_| has_right);
        for point in &mut self.live {
            // The shift to the right image changes little from one keyframe to the next.
            let last = self.found.tracks[point.track].last().and_then(|last| Some(last.px[1]? - last.px[0]?));
            point.right = right.and_then(|right| {
                let near =
                    last.and_then(|shift| followed((left, &point.px), (right, &(point.px + shift)), true));
                near.or_else(|| {
                    let guess = sought(left, right, self.level, &point.px)?;
                    followed((left, &point.px), (right, &guess), true)
                })
            });
            let key = self.found.keys.len();
            self.found.tracks[point.track].push(Sighting { key, px: [Some(point.px), point.right] });
        }
        self.found.keys.push((stamp, number % 2 == 1));
        self.key.clone_from(&self.left);
    }
}

/// Place of a patch of one image in another, near a guess; `returns` asks for the way back.
fn followed(
    (from, px): (&Pyramid, &Vector2<f32>),
    (to, guess): (&Pyramid, &Vector2<f32>),
    returns: bool,
) -> Option<Vector2<f32>> {
    let flow =
        |from: &Pyramid, px: &Vector2<f32>, to: &Pyramid, guess: &Vector2<f32>, options: &FlowOptions| {
            let found = track_patch((from, px), (to, guess), &Matrix2::identity(), options)?;
            (found.zncc >= MIN_ZNCC.1 && found.last_step_px < MAX_LAST_STEP_PX).then_some(found.px)
        };
    let found = flow(from, px, to, guess, &FLOW)?;
    let near = FlowOptions { top_level: 0, ..FLOW };
    let is_back =
        || flow(to, &found, from, px, &near).is_some_and(|back| (back - px).norm() <= MAX_RETURN_PX);
    (!returns || is_back()).then_some(found)
}

/// The best place in the right image by the coarse level, if it is clearly the best.
fn sought(left: &Pyramid, right: &Pyramid, level: usize, px: &Vector2<f32>) -> Option<Vector2<f32>> {
    let (scale, mut template) = (1.0 / (1_u32 << level) as f32, TranslationTemplate::empty());
    prepare_at(left, level, &(px * scale), &Matrix2::identity(), &mut template).then_some(())?;
    let (width, _) = right.size(level);
    let plane = right.plane(level);
    let reach = |share: f32| (share * width as f32).ceil() as i32;
    let (along, across) = (reach(REACH.0), reach(REACH.1));
    let mut places: Vec<(f32, Vector2<f32>)> = Vec::new();
    for dy in -across..=across {
        for dx in -along..=along {
            let at = px * scale + Vector2::new(dx as f32, dy as f32);
            let zncc = template.zncc_at(&plane, &at).filter(|zncc| *zncc >= MIN_ZNCC.0 - LEAD.0);
            places.extend(zncc.map(|zncc| (zncc, at)));
        }
    }
    let best = places.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let rivals = places.iter().filter(|place| (place.1 - best.1).norm() > LEAD.1);
    let is_clear = rivals.map(|place| place.0).fold(0.0, f32::max) <= best.0 - LEAD.0;
    (best.0 >= MIN_ZNCC.0 && is_clear).then_some(best.1 / scale)
}
