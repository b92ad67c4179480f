//! Epipolar error between left and right, by matches that know nothing of the calibration.
//!
//! A corner of the left image is sought in the right one over a wide window of a coarse level of the pyramid, by
//! correlation, and refined by flow to full resolution. Only then the calibration is asked how far the match is from the
//! epipolar line, and on which side of infinity it lies: of swapped cameras all points are behind. An error that grows towards the
//! rim is one of the lens model.

use crate::late_camera::Lag;
use crate::plausibility::stereo;
use crate::statistics::{median, quantile};
use crate::verdict::{Fitness, Measure};
use nalgebra::{Matrix2, Vector2, Vector3};
use plumbline_config::{Config, ImageView, Timestamp};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::points::align::TranslationTemplate;
use plumbline_estimator::points::corners::{CornerDetector, Demand};
use plumbline_estimator::points::flow::{FlowOptions, prepare_at, track_patch};
use plumbline_estimator::points::rig::{Baseline, RigCamera};

/// Corners of a frame.
const CORNERS: usize = 60;
/// Cells across an image, of which each gives one; border, px; least score.
const CELLS: usize = 14;
const BORDER_PX: usize = 16;
const MIN_SCORE: f32 = 12.0;
/// The coarse level is the first that is narrower, px.
const COARSE_PX: usize = 120;
/// Reach of the search there, as shares of its width.
const REACH: (f32, f32) = (0.2, 0.07);
/// Least correlation there and at full resolution.
const MIN_ZNCC: (f32, f32) = (0.6, 0.85);
/// The best place beats every other by this much, unless it is as near, px of the level.
const LEAD: (f32, f32) = (0.08, 2.5);
/// Largest distance between a point and its return, px.
const MAX_RETURN_PX: f32 = 0.5;
/// A last step longer than this means no convergence, px.
const MAX_LAST_STEP_PX: f32 = 0.1;
const ITERATIONS: usize = 10;
/// Matches that are needed for a verdict.
const MIN_MATCHES: usize = 150;
/// A point whose disparity is beyond infinity by more than this is behind, px.
const BEHIND_PX: f64 = 2.0;
/// Share of points behind.
const BEHIND: (f64, f64) = (0.1, 0.3);
/// Epipolar error, px: of the median as a share of `estimator.points.max_epipolar_px`, and of 95 %.
const MEDIAN: (f64, f64) = (0.3, 0.6);
const TAIL: f64 = 1.0;
/// From this multiple of that limit on the error of 95 % is not fit, whatever the median is.
const WILD_TAIL: f64 = 4.0;
/// Middle and rim of the image, as shares of half its diagonal, and fewest matches of each.
const MIDDLE: f64 = 0.4;
const RIM: f64 = 0.65;
const MIN_PART: usize = 40;
/// The lens is in doubt where three quarters of the errors at the rim reach beyond this share of the limit, and this many times as far
/// as in the middle.
const RIM_ERROR: (f64, f64) = (0.35, 3.0);
/// Left and right are exchanged where that makes the error smaller by this factor.
const EXCHANGED: f64 = 0.3;
/// Errors that are kept.
const MAX_ERRORS: usize = 50_000;

/// A point of the left image found in the right one.
#[derive(Clone, Copy, Debug)]
pub struct PairMatch {
    /// Pixel in the left image.
    pub px: Vector2<f32>,
    /// Ideal normalized coordinates there.
    pub xy: Vector2<f64>,
    /// Distance of the right pixel from the epipolar line, px; positive below.
    pub epipolar_px: f64,
    /// Distance from the epipolar line if left and right were exchanged, px; without a sign.
    pub exchanged_px: f64,
    /// Inverse depth in the left camera, 1/m; negative where the rays diverge.
    pub inverse_depth: f64,
    /// Distance of the left pixel from the middle of the image, as a share of half its diagonal.
    pub radius: f64,
}

/// Finds matches between left and right.
pub struct PairMatcher {
    cameras: [RigCamera; 2],
    /// From left to right, and back.
    baselines: [Baseline; 2],
    detector: CornerDetector,
    pyramids: [Pyramid; 2],
    level: usize,
    /// Middle of the left image and half its diagonal, px.
    middle_px: (Vector2<f32>, f32),
    matches: Vec<PairMatch>,
}

impl PairMatcher {
    /// Creates the matcher for a rig with two cameras; `None` for one camera.
    #[must_use]
    pub fn new(config: &Config) -> Option<Self> {
        let [left, right] = config.camera.as_slice() else { return None };
        let cameras = [left, right].map(|camera| {
            let mut mounted = RigCamera::new(camera.model());
            mounted.pose_b_c = camera.pose_b_c();
            mounted
        });
        let mut level = 0;
        while left.width_px >> level > COARSE_PX {
            level += 1;
        }
        let pyramid = |width, height| Pyramid::new(width, height, level.max(3) + 1);
        let pyramids = [pyramid(left.width_px, left.height_px), pyramid(right.width_px, right.height_px)];
        let level = level.min(pyramids[0].level_count() - 1).min(pyramids[1].level_count() - 1);
        let detector =
            CornerDetector::new(left.width_px, left.height_px, left.width_px / CELLS, BORDER_PX, MIN_SCORE);
        let baselines =
            [Baseline::between(&cameras[0], &cameras[1]), Baseline::between(&cameras[1], &cameras[0])];
        let half = Vector2::new(left.width_px as f32, left.height_px as f32) * 0.5;
        let middle_px = (half, half.norm());
        Some(Self { cameras, baselines, detector, pyramids, level, middle_px, matches: Vec::new() })
    }

    /// The left image that was given last.
    #[must_use]
    pub fn left(&self) -> &Pyramid {
        &self.pyramids[0]
    }

    /// The matches that were found last.
    #[must_use]
    pub fn matches(&self) -> &[PairMatch] {
        &self.matches
    }

    /// Finds the matches of a pair; `false`, and none, where the images are of another size than configured.
    pub fn find(&mut self, left: &ImageView<'_>, right: &ImageView<'_>) -> bool {
        self.matches.clear();
        if !self.pyramids[0].build(left) || !self.pyramids[1].build(right) {
            return false;
        }
        let demand = Demand { wanted: CORNERS, max_new: CORNERS };
        let corners = self.detector.detect(&self.pyramids[0].plane(0), &[], &demand).to_vec();
        self.matches = corners.iter().filter_map(|corner| self.find_one(&corner.px)).collect();
        true
    }

    fn find_one(&self, px: &Vector2<f32>) -> Option<PairMatch> {
        let scale = 1.0 / (1_u32 << self.level) as f32;
        let mut template = TranslationTemplate::empty();
        let upright = Matrix2::identity();
        prepare_at(&self.pyramids[0], self.level, &(px * scale), &upright, &mut template).then_some(())?;
        let guess = self.search(&template, &(px * scale))? / scale;
        let flow = |from: usize, at: &Vector2<f32>, to: usize, guess: &Vector2<f32>, top_level: usize| {
            let options = FlowOptions { top_level, max_iterations: ITERATIONS };
            let warp = Matrix2::identity();
            let found =
                track_patch((&self.pyramids[from], at), (&self.pyramids[to], guess), &warp, &options)?;
            (found.zncc >= MIN_ZNCC.1 && found.last_step_px < MAX_LAST_STEP_PX).then_some(found.px)
        };
        let right = flow(0, px, 1, &guess, self.level)?;
        let back = flow(1, &right, 0, px, 0)?;
        ((back - px).norm() <= MAX_RETURN_PX).then_some(())?;
        self.geometry(px, &right)
    }

    /// The best place of the coarse level, if it is clearly the best.
    fn search(&self, template: &TranslationTemplate, from: &Vector2<f32>) -> Option<Vector2<f32>> {
        let (width, _) = self.pyramids[1].size(self.level);
        let plane = self.pyramids[1].plane(self.level);
        let reach = |share: f32| (share * width as f32).ceil() as i32;
        let (across, along) = (reach(REACH.1), reach(REACH.0));
        let mut places: Vec<(f32, Vector2<f32>)> = Vec::new();
        for dy in -across..=across {
            for dx in -along..=along {
                let px = from + Vector2::new(dx as f32, dy as f32);
                let zncc = template.zncc_at(&plane, &px).filter(|zncc| *zncc >= MIN_ZNCC.0 - LEAD.0);
                places.extend(zncc.map(|zncc| (zncc, px)));
            }
        }
        let best = places.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let rival = places.iter().filter(|place| (place.1 - best.1).norm() > LEAD.1);
        let is_clear = rival.map(|place| place.0).fold(0.0, f32::max) <= best.0 - LEAD.0;
        (best.0 >= MIN_ZNCC.0 && is_clear).then_some(best.1)
    }

    /// Geometry of a match by the calibration.
    fn geometry(&self, px: &Vector2<f32>, right: &Vector2<f32>) -> Option<PairMatch> {
        let xy = self.cameras[0].model.unproject(&px.cast())?;
        let (epipolar_px, inverse_depth) = self.of_views(0, px, right)?;
        let exchanged_px = self.of_views(1, px, right)?.0.abs();
        let radius = f64::from((px - self.middle_px.0).norm() / self.middle_px.1);
        Some(PairMatch { px: *px, xy, epipolar_px, exchanged_px, inverse_depth, radius })
    }

    /// Epipolar error and inverse depth of a pixel of camera `first` and one of the other.
    fn of_views(&self, first: usize, px: &Vector2<f32>, other: &Vector2<f32>) -> Option<(f64, f64)> {
        let (from, to, baseline) = (&self.cameras[first], &self.cameras[1 - first], &self.baselines[first]);
        let (xy, xy_to) = (from.model.unproject(&px.cast())?, to.model.unproject(&other.cast())?);
        let triangulated = baseline.triangulate(&xy, &xy_to, to.focal_px())?;
        // The line of the point in the other image is that of all depths, of normal t x R x; below it is positive.
        let ray = baseline.rotation * Vector3::new(xy.x, xy.y, 1.0);
        let normal = baseline.translation.cross(&ray);
        let across = normal.dot(&Vector3::new(xy_to.x, xy_to.y, 1.0)) / normal.xy().norm();
        Some((across * normal.y.signum() * to.focal_px(), triangulated.inverse_depth))
    }
}

/// Statistics of the matches against the calibration.
#[derive(Clone, Debug, Default)]
pub struct PairFigures {
    pairs: Vec<Timestamp>,
    matches: Vec<(Timestamp, PairMatch)>,
}

impl PairFigures {
    /// Takes the matches of the pair of a frame.
    pub fn add(&mut self, stamp: Timestamp, matches: &[PairMatch]) {
        self.pairs.push(stamp);
        if self.matches.len() < MAX_ERRORS {
            self.matches.extend(matches.iter().map(|found| (stamp, *found)));
        }
    }

    /// Those of frames whose images are not frozen.
    #[must_use]
    pub fn without(&self, is_frozen: &dyn Fn(Timestamp) -> bool) -> Self {
        let pairs = self.pairs.iter().copied().filter(|stamp| !is_frozen(*stamp)).collect();
        let matches = self.matches.iter().copied().filter(|(stamp, _)| !is_frozen(*stamp)).collect();
        Self { pairs, matches }
    }

    fn all(&self, of: impl Fn(&PairMatch) -> f64) -> Vec<f64> {
        self.matches.iter().map(|(_, found)| of(found)).collect()
    }

    /// Judges them, where the images are of these moments.
    #[must_use]
    pub fn judge(&self, config: &Config, lag: Option<&Lag>) -> Measure {
        const NAME: &str = "epipolar error";
        if self.matches.len() < MIN_MATCHES {
            let value = format!("{} matches in {} pairs", self.matches.len(), self.pairs.len());
            let cure = "look at something with texture, in light, one to five metres away, lenses clean and in focus";
            return Measure::new(NAME, Fitness::NotMeasured, value, cure, &[]);
        }
        let errors_px = self.all(|found| found.epipolar_px);
        let sizes: Vec<f64> = errors_px.iter().map(|error| error.abs()).collect();
        let (middle, tail, side) = (median(&sizes), quantile(&sizes, 0.95), median(&errors_px));
        let limit: f64 = config.estimator.points.max_epipolar_px.into();
        let behind = self.behind(config);
        let wrong_side = Fitness::within(behind, BEHIND.0, BEHIND.1);
        let mut verdict = Fitness::within(middle / limit, MEDIAN.0, MEDIAN.1);
        verdict = verdict.max(Fitness::within(tail, TAIL * limit, WILD_TAIL * limit));
        let (inner, rim) = self.parts();
        let is_lens = self.is_lens_in_doubt(limit);
        if is_lens {
            verdict = verdict.max(Fitness::NotFit);
        }
        let focal_px = config.camera.first().map_or(1.0, |camera| camera.focal_px[1]);
        let degrees = (side / focal_px).atan().to_degrees().abs();
        // Exchanged they agree: or, of a rectified pair, which agrees either way, all is behind.
        let exchanged_px = self.all(|found| found.exchanged_px);
        let are_exchanged = median(&exchanged_px) < EXCHANGED * middle || wrong_side > verdict;
        let cure = if let Some(lag) = lag {
            verdict = Fitness::NotFit;
            lag.cure(config)
        } else if are_exchanged {
            format!("{} (or they squint); {}", stereo::SWAPPED, stereo::CURE)
        } else if is_lens {
            "the error grows towards the rim: correct lens model (`distortion`), focal lengths or principal points (`camera.centre_px`), or calibrate the cameras \
             again (`plumbline calibrate camera`)"
                .to_owned()
        } else {
            format!(
                "calibrate the pair again (`plumbline calibrate camera`); one camera looks {degrees:.2} degrees higher"
            )
        };
        let value = format!(
            "median {middle:.2} px (to one side {side:.2}), 95 % within {tail:.2} px, three quarters within {inner:.2} px in the middle \
             and {rim:.2} at the rim, {:.0} % behind the cameras, {} matches{}",
            100.0 * behind,
            sizes.len(),
            lag.map_or_else(String::new, |lag| format!("; {}", lag.words()))
        );
        let figures = [
            ("median_px", middle),
            ("p95_px", tail),
            ("middle_p75_px", inner),
            ("rim_p75_px", rim),
            ("lag_frames", lag.map_or(0.0, |lag| f64::from(lag.frames))),
            ("signed_median_px", side),
            ("behind_share", behind),
            ("matches", sizes.len() as f64),
        ];
        Measure::new(NAME, verdict.max(wrong_side), value, cure, &figures)
    }

    /// Error within which three quarters lie, px, in the middle and at the rim; not a number where too few were matched.
    fn parts(&self) -> (f64, f64) {
        let part = |is_in: &dyn Fn(f64) -> bool| {
            let inside = self.matches.iter().filter(|(_, found)| is_in(found.radius));
            let errors: Vec<f64> = inside.map(|(_, found)| found.epipolar_px.abs()).collect();
            if errors.len() < MIN_PART { f64::NAN } else { quantile(&errors, 0.75) }
        };
        (part(&|radius| radius < MIDDLE), part(&|radius| radius > RIM))
    }

    /// True if the error grows towards the rim as a wrong lens model makes it grow.
    #[must_use]
    pub fn is_lens_in_doubt(&self, limit_px: f64) -> bool {
        let (inner, rim) = self.parts();
        rim > RIM_ERROR.0 * limit_px && rim > RIM_ERROR.1 * inner
    }

    /// Share of points that lie beyond infinity.
    fn behind(&self, config: &Config) -> f64 {
        let [left, right] = config.camera.as_slice() else { return 0.0 };
        let baseline_m = (left.pose_b_c().inverse() * right.pose_b_c()).translation.vector.norm();
        let least = -BEHIND_PX / (left.focal_px[0] * baseline_m);
        let behind = self.matches.iter().filter(|(_, found)| found.inverse_depth < least).count();
        behind as f64 / self.matches.len().max(1) as f64
    }
}
