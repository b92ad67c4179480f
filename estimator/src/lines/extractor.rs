//! The extractor: an image in, its straight edges out, in bounded time and without allocation.
//!
//! Seeds are ridges of the gradient, strongest first ([`super::gradient`], [`super::seeds`]); from each free
//! one a segment grows ([`super::growth`]), all at half the resolution. Of those that are long enough by the paper's length
//! filter ([`super::filter`]) the clearest are found anew in the whole image, from end to end ([`super::refine`]), and must be
//! meaningful there ([`super::validation`]).
//! The idea of strongest-first growth and of validation is LSD's (Grompone von Gioi et al. 2012), that of
//! following ridges Edge Drawing's (Topal and Akinlar 2012) and ELSED's (Suarez et al. 2022).

use super::filter;
use super::gradient::{Gradients, SCALE};
use super::growth::Growth;
use super::refine::Refiner;
use super::seeds::Seeds;
use super::segment::{REDUCTION, Segment, halved_px};
use super::validation::{ALIGNED_BY_CHANCE, ALIGNED_BY_CHANCE_AT_HALF, Validation};
use crate::image::mask::ImageMask;
use crate::work_budget::WorkBudget;
use nalgebra::Vector2;
use plumbline_config::options::{LinesConfig, PixelMask};
use plumbline_config::{ImageView, Portable};
use std::ops::Range;

/// An image is searched in so many parts, from top to bottom.
pub(super) const PARTS: usize = 3;
/// Visits of the budget for each ridge that may be a seed.
const VISITS_PER_SEED: usize = 2;
/// A segment has at least this share of edge pixels between its ends.
const MIN_DENSITY: f32 = 0.7;
/// At half the resolution noise is half: as much contrast as this share of the least gradient is enough to look closer.
const SHARE_AT_HALF: f32 = 0.7;
/// Smallest gain at the ends of a segment, px, for which it is refined in the whole image.
const MAY_GAIN_PX: f32 = 4.0;

/// Reach of the filters of the halved image, px of the whole one: edges keep this distance from what a mask hides.
const FILTER_REACH_PX: usize = 6;

/// Work and outcome of one image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExtractionFigures {
    /// Segments found at half the resolution.
    pub raw: u32,
    /// The clearest of those that the length filter left, as far as the whole image confirmed them.
    pub kept: u32,
    /// Edge pixels visited.
    pub visits: u32,
    /// The budget was spent before the last ridge was a seed or the last seed grown.
    pub is_cut_short: bool,
}

/// Finds straight edges. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct LineExtractor {
    options: LinesConfig,
    width: usize,
    height: usize,
    gradients: Gradients,
    growth: Growth,
    validation_at_half: Validation,
    validation: Validation,
    refiner: Refiner,
    seeds: Seeds,
    raw: Vec<Segment>,
    candidates: Vec<Segment>,
    kept: Vec<Segment>,
    /// Segments of each part of the image when it was searched last.
    counts: [usize; PARTS],
    figures: ExtractionFigures,
    max_visits: usize,
    max_segments: usize,
    mask: Option<LineMask>,
}

/// Masks that hide parts of the images from lines.
#[derive(Clone, Debug)]
struct LineMask {
    whole: ImageMask,
    halved: ImageMask,
}

impl LineMask {
    fn new(mask: &PixelMask) -> Self {
        let whole = ImageMask::new(mask, FILTER_REACH_PX);
        Self { halved: whole.halved(), whole }
    }
}

impl LineExtractor {
    /// For images of `width` x `height` px, allocated for its lifetime.
    #[must_use]
    pub fn new(width: usize, height: usize, options: &LinesConfig) -> Self {
        let (halved_width, halved_height) = (width / REDUCTION, height / REDUCTION);
        Self {
            width,
            height,
            gradients: Gradients::new(width, height),
            growth: Growth::new(halved_width, halved_height),
            validation_at_half: Validation::new(halved_width, halved_height, ALIGNED_BY_CHANCE_AT_HALF),
            validation: Validation::new(width, height, ALIGNED_BY_CHANCE),
            refiner: Refiner::new(width, height),
            seeds: Seeds::new(width, height),
            raw: Vec::with_capacity(options.max_raw),
            candidates: Vec::with_capacity(options.max_raw),
            kept: Vec::with_capacity(options.max_raw),
            counts: [0; PARTS],
            figures: ExtractionFigures::default(),
            max_visits: options.max_visits,
            max_segments: options.max_segments,
            mask: None,
            options: options.clone(),
        }
    }

    /// Looks from now on only at what `mask` leaves.
    pub fn set_mask(&mut self, mask: &PixelMask) {
        self.mask = Some(LineMask::new(mask));
    }

    /// Limits visits and segments from now on.
    pub fn set_budget(&mut self, budget: &WorkBudget) {
        self.max_visits = budget.share_of(self.options.max_visits);
        self.max_segments = budget.share_of(self.options.max_segments);
    }

    /// Gradients of the last image.
    pub fn gradients(&self) -> &Gradients {
        &self.gradients
    }

    /// Segments of the last image after the filter, clearest first.
    pub fn segments(&self) -> &[Segment] {
        &self.kept
    }

    /// Work and outcome of the last image.
    pub fn figures(&self) -> ExtractionFigures {
        self.figures
    }

    /// The segments of an image, clearest first; `None`, and nothing is changed, when its size is not the
    /// extractor's.
    pub fn extract(&mut self, image: &ImageView<'_>) -> Option<&[Segment]> {
        if !self.is_for(image) {
            return None;
        }
        self.counts = [0; PARTS];
        self.search(image, 0..self.gradients.height, &[], (0, 1));
        Some(&self.kept)
    }

    /// The segments of part `part` of an image beside those `known`, as [`Self::extract`].
    pub(super) fn extract_part(
        &mut self,
        image: &ImageView<'_>,
        part: usize,
        known: &[Segment],
    ) -> &[Segment] {
        self.search(image, self.rows_of(part), known, (part, PARTS));
        &self.kept
    }

    /// Rows of a part of the halved image.
    pub(super) fn rows_of(&self, part: usize) -> Range<usize> {
        let [start, end] = [part, part + 1].map(|part| part * self.gradients.height / PARTS);
        start..end
    }

    /// True if a pixel lies where gradients are those of the last image.
    pub(super) fn is_searched(&self, px: &Vector2<f32>) -> bool {
        self.gradients.rows.contains(&(halved_px(px).y as usize))
    }

    /// Searches `rows` of the halved image, which are part `part` of so many, each with its share of the budget.
    fn search(
        &mut self,
        image: &ImageView<'_>,
        rows: Range<usize>,
        known: &[Segment],
        (part, parts): (usize, usize),
    ) {
        let [max_visits, max_segments] =
            [self.max_visits, self.max_segments].map(|most| most.div_ceil(parts));
        let threshold = self.threshold();
        let Self { seeds, gradients, counts, .. } = self;
        let mask = self.mask.as_ref().map(|mask| &mask.halved);
        let seeding = (rows.clone(), max_visits / VISITS_PER_SEED);
        seeds.find(gradients, image, seeding, threshold, mask);
        counts[part] = 0;
        for segment in known {
            gradients.take(segment);
            counts[part] += usize::from(rows.contains(&(halved_px(&segment.middle()).y as usize)));
        }
        self.find(max_visits, part);
        self.keep(image, max_segments);
        self.figures.raw = self.raw.len() as u32;
        self.figures.kept = self.kept.len() as u32;
    }

    /// True if an image has the size of the extractor.
    pub(super) fn is_for(&self, image: &ImageView<'_>) -> bool {
        image.width() == self.width && image.height() == self.height
    }

    /// The edge near `guide` as the image confirms it, if it is long enough among those of the last search.
    pub(super) fn find_near(&mut self, image: &ImageView<'_>, guide: &Segment) -> Option<Segment> {
        let least = self.least_length_px();
        let refined = self.refiner.refine(image, guide, self.mask.as_ref().map(|mask| &mask.whole))?;
        let is_sound =
            refined.segment.length() >= least && self.validation.is_meaningful(refined.tried, refined.found);
        is_sound.then_some(refined.segment)
    }

    /// Finds the clearest of those that are long enough in the whole image.
    fn keep(&mut self, image: &ImageView<'_>, max_segments: usize) {
        let least = self.least_length_px();
        self.candidates.clear();
        self.candidates.extend(self.raw.iter().filter(|s| s.length() + MAY_GAIN_PX >= least));
        filter::clearest_first(&mut self.candidates);
        self.candidates.truncate(max_segments);
        self.kept.clear();
        for k in 0..self.candidates.len() {
            let coarse = self.candidates[k];
            let found = self.find_near(image, &coarse);
            self.kept.extend(found);
        }
        filter::clearest_first(&mut self.kept);
    }

    /// Least length of a segment, which is the greater the more there are in the image.
    fn least_length_px(&self) -> f32 {
        let filtered = match self.options.length_filter {
            true => filter::min_length_px(self.counts.iter().sum(), self.width, self.height),
            false => 0.0,
        };
        filtered.at_least(self.options.min_raw_length_px as f32)
    }

    fn threshold(&self) -> i16 {
        (SHARE_AT_HALF * self.options.min_gradient as f32 * SCALE).at_most(f32::from(i16::MAX)) as i16
    }

    /// Grows segments of part `part` until the seeds or `max_visits` are spent.
    fn find(&mut self, max_visits: usize, part: usize) {
        let threshold = self.threshold();
        self.growth.visits = 0;
        self.raw.clear();
        self.figures =
            ExtractionFigures { is_cut_short: self.seeds.is_cut_short, ..ExtractionFigures::default() };
        for k in 0..self.seeds.ordered.len() {
            let seed = self.seeds.ordered[k];
            let (x, y) = seed.place();
            let pixel = self.gradients.pixels[y * self.gradients.width + x];
            if pixel.is_taken() || pixel.is_tried() || !seed.is_promising(&self.gradients, threshold) {
                continue;
            }
            if self.growth.visits >= max_visits || self.raw.len() == self.options.max_raw {
                self.figures.is_cut_short = true;
                break;
            }
            match self.segment_at((x, y), threshold) {
                Some(segment) => {
                    self.raw.push(segment);
                    self.counts[part] += 1;
                }
                None => self.growth.cut(&mut self.gradients, 0),
            }
        }
        self.figures.visits = self.growth.visits as u32;
    }

    fn segment_at(&mut self, seed: (usize, usize), threshold: i16) -> Option<Segment> {
        let grown = self.growth.grow(&mut self.gradients, seed, threshold);
        let is_dense = grown.support as f32 >= MIN_DENSITY * grown.steps as f32;
        if !is_dense || !self.validation_at_half.is_meaningful(grown.steps, grown.support) {
            return None;
        }
        // What will be left out needs no nodes; with a hair for the rounding.
        let least = self.least_length_px() - MAY_GAIN_PX;
        let nodes_from_px = least / REDUCTION as f32 - 0.01;
        Some(Segment::through(self.growth.places(), &grown.direction, nodes_from_px)?.whole())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::GrayImage;

    /// Two dark bars, upright and 20 px wide: from column 40 and from column 200 on.
    fn two_bars() -> GrayImage {
        let pixels = (0..320 * 240).map(|k| k % 320).map(|u| match u {
            40..60 | 200..220 => 40,
            _ => 180,
        });
        GrayImage::from_pixels(320, 240, pixels.collect()).expect("size")
    }

    fn columns(mask: Option<&PixelMask>) -> Vec<f32> {
        let mut extractor = LineExtractor::new(320, 240, &LinesConfig::default());
        mask.into_iter().for_each(|mask| extractor.set_mask(mask));
        let segments = extractor.extract(&two_bars().view()).expect("size");
        segments.iter().flat_map(|segment| [segment.start.x, segment.end.x]).collect()
    }

    #[test]
    fn what_is_masked_has_no_segments_and_the_rest_keeps_its_own() {
        let all = columns(None);
        assert!(all.iter().any(|x| *x < 100.0) && all.iter().any(|x| *x > 100.0), "{all:?}");
        let left = PixelMask::of(320, 240, |u, _| u > 100);
        let kept: Vec<f32> = all.iter().copied().filter(|x| *x > 100.0).collect();
        assert_eq!(columns(Some(&left)), kept);
    }

    #[test]
    fn a_segment_ends_before_the_mask() {
        let lower = PixelMask::of(320, 240, |_, v| v < 160);
        let mut extractor = LineExtractor::new(320, 240, &LinesConfig::default());
        extractor.set_mask(&lower);
        let segments = extractor.extract(&two_bars().view()).expect("size");
        assert!(segments.len() >= 4, "{segments:?}");
        assert!(segments.iter().all(|segment| segment.start.y < 160.0 && segment.end.y < 160.0));
    }
}
