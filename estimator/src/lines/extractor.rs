//! The extractor: an image in, its straight edges out, in bounded time and without allocation.
//!
//! Seeds are ridges of the gradient, strongest first ([`super::gradient`], [`super::seeds`]); from each free
//! one a segment grows ([`super::growth`]), which must be long and meaningful ([`super::validation`]) to stay.
//! The idea of strongest-first growth and of validation is LSD's (Grompone von Gioi et al. 2012), that of
//! following ridges Edge Drawing's (Topal and Akinlar 2012) and ELSED's (Suarez et al. 2022). The paper's
//! length filter and merging follow ([`super::filter`], [`super::merge`]).

use super::filter;
use super::gradient::{Gradients, SCALE};
use super::growth::Growth;
use super::merge::Merger;
use super::seeds::Seeds;
use super::segment::Segment;
use super::validation::Validation;
use crate::work_budget::WorkBudget;
use plumbline_config::options::LinesConfig;
use plumbline_config::{ImageView, Portable};

/// One ridge may be probed for so many visits of the budget.
const VISITS_PER_PROBED: usize = 2;
/// A segment has at least this share of edge pixels between its ends.
const MIN_DENSITY: f32 = 0.7;

/// Work and outcome of one image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExtractionFigures {
    /// Segments found.
    pub raw: u32,
    /// Segments that the length filter left.
    pub kept: u32,
    /// Segments after merging.
    pub merged: u32,
    /// Edge pixels visited.
    pub visits: u32,
    /// The budget was spent before the last ridge was probed or the last seed grown.
    pub is_cut_short: bool,
}

/// Finds straight edges. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct LineExtractor {
    options: LinesConfig,
    gradients: Gradients,
    growth: Growth,
    validation: Validation,
    merger: Merger,
    seeds: Seeds,
    raw: Vec<Segment>,
    kept: Vec<Segment>,
    merged: Vec<Segment>,
    figures: ExtractionFigures,
    max_visits: usize,
    max_segments: usize,
}

impl LineExtractor {
    /// For images of `width` x `height` px, allocated for its lifetime.
    #[must_use]
    pub fn new(width: usize, height: usize, options: &LinesConfig) -> Self {
        Self {
            gradients: Gradients::new(width, height),
            growth: Growth::new(width, height),
            validation: Validation::new(width, height),
            merger: Merger::new(options),
            seeds: Seeds::new(width, height, options.max_visits / VISITS_PER_PROBED),
            raw: Vec::with_capacity(options.max_raw),
            kept: Vec::with_capacity(options.max_raw),
            merged: Vec::with_capacity(options.max_raw),
            figures: ExtractionFigures::default(),
            max_visits: options.max_visits,
            max_segments: options.max_segments,
            options: options.clone(),
        }
    }

    /// Limits visits and segments from now on.
    pub fn set_budget(&mut self, budget: &WorkBudget) {
        self.max_visits = budget.share_of(self.options.max_visits);
        self.max_segments = budget.share_of(self.options.max_segments);
    }

    /// Gradients of the last image.
    #[must_use]
    pub fn gradients(&self) -> &Gradients {
        &self.gradients
    }

    /// Segments of the last image as they were found, strongest seed first.
    #[must_use]
    pub fn raw(&self) -> &[Segment] {
        &self.raw
    }

    /// Segments of the last image that are long enough, clearest first.
    #[must_use]
    pub fn kept(&self) -> &[Segment] {
        &self.kept
    }

    /// Segments of the last image after filter and merging, clearest first.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.merged
    }

    /// Work and outcome of the last image.
    #[must_use]
    pub fn figures(&self) -> ExtractionFigures {
        self.figures
    }

    /// The segments of an image, clearest first; `None`, and nothing is changed, when its size is not the
    /// extractor's.
    pub fn extract(&mut self, image: &ImageView<'_>) -> Option<&[Segment]> {
        if image.width() != self.gradients.width() || image.height() != self.gradients.height() {
            return None;
        }
        let threshold = self.threshold();
        self.seeds.find(&mut self.gradients, image, threshold);
        self.find();
        self.kept.clear();
        if self.options.length_filter {
            let least = filter::min_length_px(self.raw.len(), image.width(), image.height());
            self.kept.extend(self.raw.iter().filter(|s| s.length() >= least));
        } else {
            self.kept.extend_from_slice(&self.raw);
        }
        filter::clearest_first(&mut self.kept);
        self.merged.clear();
        if self.options.merge {
            self.merger.merge(&self.kept, &mut self.merged);
        } else {
            self.merged.extend_from_slice(&self.kept);
        }
        self.merged.truncate(self.max_segments);
        self.figures.raw = self.raw.len() as u32;
        self.figures.kept = self.kept.len() as u32;
        self.figures.merged = self.merged.len() as u32;
        Some(&self.merged)
    }

    fn threshold(&self) -> i16 {
        (self.options.min_gradient as f32 * SCALE).at_most(f32::from(i16::MAX)) as i16
    }

    /// Grows segments until the seeds or the budget are spent.
    fn find(&mut self) {
        let threshold = self.threshold();
        self.growth.begin();
        self.raw.clear();
        self.figures =
            ExtractionFigures { is_cut_short: self.seeds.is_cut_short(), ..ExtractionFigures::default() };
        for k in 0..self.seeds.ordered().len() {
            let seed = self.seeds.ordered()[k];
            let pixel = self.gradients.pixels()[seed as usize];
            if pixel.is_taken() || pixel.is_tried() {
                continue;
            }
            if self.growth.visits() >= self.max_visits || self.raw.len() == self.options.max_raw {
                self.figures.is_cut_short = true;
                break;
            }
            match self.segment_at(seed, threshold) {
                Some(segment) => self.raw.push(segment),
                None => self.growth.reject(&mut self.gradients),
            }
        }
        self.figures.visits = self.growth.visits() as u32;
    }

    fn segment_at(&mut self, seed: u32, threshold: i16) -> Option<Segment> {
        let grown = self.growth.grow(&mut self.gradients, seed, threshold);
        // Along the diagonal a segment is longer than its steps by the root of two.
        let may_be_long = grown.steps as f64 * std::f64::consts::SQRT_2 >= self.options.min_raw_length_px;
        let is_dense = grown.support as f32 >= MIN_DENSITY * grown.steps as f32;
        if !may_be_long || !is_dense || !self.validation.is_meaningful(grown.steps, grown.support) {
            return None;
        }
        let segment = Segment::through(self.growth.places(), &grown.direction)?;
        (f64::from(segment.length()) >= self.options.min_raw_length_px).then_some(segment)
    }
}
