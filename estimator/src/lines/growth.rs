//! A segment grows from a seed: the edge is followed pixel by pixel in both directions.
//!
//! From the pixels so far a line is known (at first by their gradients, then by a fit). The next pixel
//! along its major axis must be a ridge within [`TOLERANCE_PX`] of the line, with a gradient across it;
//! where there is none the line runs on over a gap of at most [`MAX_GAP`] pixels. Every look at a pixel is
//! a visit, and visits are what the extractor's budget counts.

use super::fit::LineMoments;
use super::gradient::{BORDER, Gradients, Pixel, SCALE};
use super::segment::Place;
use crate::image::patch::whole;
use nalgebra::Vector2;
use plumbline_config::Portable;
use std::ops::Range;

/// Largest distance of an edge pixel from the line so far, px.
const TOLERANCE_PX: f32 = 0.6;
/// Squared cosine of the largest angle between the gradient and the normal of the line (22.5 degrees).
const MIN_COS2: f32 = 0.853_553_4;
/// Longest gap, px.
pub(super) const MAX_GAP: usize = 2;
/// Longest gap before the line is fitted, px.
const MAX_EARLY_GAP: usize = 1;
/// The line is fitted from this many pixels on; before it follows the mean gradient.
const FIT_FROM: usize = 8;
/// A run of fewer pixels behind the last gap is cut off.
const MIN_LAST_RUN: usize = 3;
/// An edge that turns this far from its major axis has ended.
const MAX_SLOPE: f32 = 1.3;

/// Cost of starting a segment beside that of its pixels, in visits.
const BEGIN_VISITS: usize = 8;

/// Grows segments over the gradients of one image.
#[derive(Clone, Debug)]
pub struct Growth {
    /// Edge pixels of the segment at hand, from the seed outward, first one way, then the other.
    pixels: Vec<EdgePixel>,
    places: Vec<Place>,
    moments: LineMoments,
    /// Sum of the gradients of the pixels.
    gradient: Vector2<f32>,
    /// Distance in memory of neighbours across the segment at hand.
    across: usize,
    /// Pixels looked at in an image, and what beginning segments cost.
    pub(super) visits: usize,
}

/// A pixel of the segment at hand.
#[derive(Clone, Copy, Debug)]
struct EdgePixel {
    place: Place,
    index: usize,
    /// The three pixels across the edge before it took them.
    before: [Pixel; 3],
    /// Steps from the seed.
    step: usize,
}

/// The line so far, as seen from its major axis.
#[derive(Clone, Copy, Debug)]
struct Line {
    direction: Vector2<f32>,
    /// A point of it: coordinates along the major and the minor axis.
    major: f32,
    minor: f32,
    /// Steps along the minor axis per step along the major one.
    slope: f32,
    /// Largest distance of an edge pixel from it, along the minor axis.
    tolerance: f32,
}

impl Line {
    fn new(point: &Vector2<f32>, direction: Vector2<f32>, is_steep: bool) -> Self {
        let (d_major, d_minor) =
            if is_steep { (direction.y, direction.x) } else { (direction.x, direction.y) };
        let (major, minor) = if is_steep { (point.y, point.x) } else { (point.x, point.y) };
        let tolerance = TOLERANCE_PX / d_major.abs();
        Self { direction, major, minor, slope: d_minor / d_major, tolerance }
    }

    fn at(&self, major: isize) -> f32 {
        self.minor + (major as f32 - self.major) * self.slope
    }
}

/// Result of growing a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grown {
    /// Direction, oriented as segments are.
    pub direction: Vector2<f32>,
    /// Pixels along the major axis from end to end.
    pub steps: usize,
    /// Edge pixels among them.
    pub support: usize,
}

/// A pixel that continues a segment.
#[derive(Clone, Copy, Debug)]
struct Ridge {
    place: Place,
    index: usize,
    gradient: Vector2<f32>,
}

/// The image an edge is followed in, and the axis along which: with `STEEP` the major axis is that of the rows, y. It is known to the
/// compiler, since every pixel asks for it.
#[derive(Debug)]
struct Following<'a, const STEEP: bool> {
    gradients: &'a mut Gradients,
    threshold: i16,
    /// Distance in memory of the rows of the image, apart from its width: places then are sums, and not products each.
    row: usize,
    /// Columns and rows in which it is followed.
    x: Range<isize>,
    y: Range<isize>,
}

impl Growth {
    /// For images of `width` x `height`.
    pub fn new(width: usize, height: usize) -> Self {
        let longest = width + height;
        Self {
            pixels: Vec::with_capacity(longest),
            places: Vec::with_capacity(longest),
            moments: LineMoments::default(),
            gradient: Vector2::zeros(),
            across: 1,
            visits: 0,
        }
    }

    /// Edge of the last segment, in no order.
    pub fn places(&mut self) -> &[Place] {
        self.places.clear();
        self.places.extend(self.pixels.iter().map(|p| p.place));
        &self.places
    }

    /// Follows the edge at `seed` (column and row) both ways, as long as the gradient exceeds `threshold` steps.
    /// Pixels of the segment stay marked as taken, unless [`Self::cut`] follows.
    pub fn grow(&mut self, gradients: &mut Gradients, (x, y): (usize, usize), threshold: i16) -> Grown {
        self.visits += BEGIN_VISITS;
        let width = gradients.width;
        self.pixels.clear();
        self.moments = LineMoments::default();
        self.gradient = gradients.pixels[y * width + x].vector();
        let (point, direction) = (Vector2::new(x as f32, y as f32), along(&self.gradient));
        let is_steep = direction.y.abs() > direction.x.abs();
        self.across = if is_steep { 1 } else { width };
        let inner = |range: Range<usize>| (range.start + BORDER) as isize..(range.end - BORDER) as isize;
        let (x, y, row) = (inner(0..width), inner(gradients.rows.clone()), width);
        if is_steep {
            let mut course = Following::<true> { gradients, threshold, row, x, y };
            self.follow_both_ways(&mut course, &point, direction)
        } else {
            let mut course = Following::<false> { gradients, threshold, row, x, y };
            self.follow_both_ways(&mut course, &point, direction)
        }
    }

    /// Follows the edge from a pixel, where it has this direction.
    fn follow_both_ways<const STEEP: bool>(
        &mut self,
        course: &mut Following<'_, STEEP>,
        point: &Vector2<f32>,
        direction: Vector2<f32>,
    ) -> Grown {
        let major = if STEEP { point.y } else { point.x } as isize;
        let (line, ahead) = self.follow(course, Line::new(point, direction, STEEP), major, 1);
        let back = match self.pixels.len() {
            0..FIT_FROM => Line::new(point, line.direction, STEEP),
            _ => line,
        };
        let (line, behind) = self.follow(course, back, major - 1, -1);
        Grown { direction: line.direction, steps: ahead + behind, support: self.pixels.len() }
    }

    /// Follows the edge one way along the major axis until it ends; the refined line, and the steps to its
    /// last pixel.
    fn follow<const STEEP: bool>(
        &mut self,
        course: &mut Following<'_, STEEP>,
        mut line: Line,
        mut major: isize,
        step: isize,
    ) -> (Line, usize) {
        let from = self.pixels.len();
        let (mut gap, mut steps, mut refit_at) = (0, 0, FIT_FROM.max(from + 1));
        // The first pixel behind the last gap.
        let mut last_run = from;
        let within = if STEEP { course.y.clone() } else { course.x.clone() };
        while within.contains(&major) {
            steps += 1;
            if let Some(ridge) = course.look(&line, major) {
                if gap > 0 {
                    (gap, last_run) = (0, self.pixels.len());
                }
                let place = ridge.place;
                self.take(course, &ridge, steps);
                if self.pixels.len() < FIT_FROM {
                    line = Line::new(&place.px, along(&self.gradient), STEEP);
                } else if self.pixels.len() >= refit_at {
                    refit_at = self.pixels.len() + (self.pixels.len() / 4).clamp(4, 32);
                    line = self.fitted(&line, STEEP);
                }
                if line.slope.abs() > MAX_SLOPE {
                    break;
                }
            } else {
                gap += 1;
                if gap > if self.pixels.len() < FIT_FROM { MAX_EARLY_GAP } else { MAX_GAP } {
                    break;
                }
            }
            major += step;
        }
        self.visits += steps;
        // A short run behind the last gap is a stub.
        if last_run > from && self.pixels.len() - last_run < MIN_LAST_RUN {
            self.cut(course.gradients, last_run);
        }
        (line, self.pixels[from..].last().map_or(0, |p| p.step))
    }

    /// The line through all pixels so far, in the sense of `line`.
    fn fitted(&self, line: &Line, is_steep: bool) -> Line {
        let Some((point, axis)) = self.moments.line() else { return *line };
        let axis = axis.cast::<f32>();
        let direction = if axis.dot(&line.direction) < 0.0 { -axis } else { axis };
        Line::new(&point.cast(), direction, is_steep)
    }

    /// Takes a pixel, and those beside it, so that no second segment begins there.
    #[inline]
    fn take<const STEEP: bool>(&mut self, course: &mut Following<'_, STEEP>, ridge: &Ridge, step: usize) {
        let Ridge { place, index, gradient } = *ridge;
        self.gradient += gradient;
        self.moments.add(&place.px.cast(), 1.0);
        let before = [index - course.across(), index, index + course.across()].map(|k| {
            let pixel = &mut course.gradients.pixels[k];
            std::mem::replace(pixel, pixel.taken())
        });
        self.pixels.push(EdgePixel { place, index, before, step });
    }

    /// Gives back the pixels from number `from` on: of a segment that was none, all of them.
    pub(super) fn cut(&mut self, gradients: &mut Gradients, from: usize) {
        for pixel in &self.pixels[from..] {
            let three = [pixel.index - self.across, pixel.index, pixel.index + self.across];
            for (k, _) in three.iter().zip(pixel.before).filter(|(_, before)| !before.is_taken()) {
                gradients.pixels[*k].give_back();
            }
        }
        self.pixels.truncate(from);
    }
}

impl<const STEEP: bool> Following<'_, STEEP> {
    /// Distance in memory of neighbours across the segment at hand.
    fn across(&self) -> usize {
        if STEEP { 1 } else { self.row }
    }

    fn index(&self, major: isize, minor: isize) -> usize {
        let (x, y) = if STEEP { (minor, major) } else { (major, minor) };
        y as usize * self.gradients.width + x as usize
    }

    /// The ridge at `major` nearest to the line, if there is one that fits.
    #[inline]
    fn look(&self, line: &Line, major: isize) -> Option<Ridge> {
        let (predicted, within) = (line.at(major), if STEEP { &self.x } else { &self.y });
        let nearest = whole((predicted + 0.5).at_least(0.0).at_most(within.end as f32)) as isize;
        if !within.contains(&nearest) {
            return None;
        }
        let across = self.across();
        let first = self.index(major, nearest - BORDER as isize);
        let magnitudes = &self.gradients.magnitudes[first..];
        let around = |k: usize| [k, k + across, k + 2 * across].map(|k| magnitudes[k]);
        let [low, mid, high] = around(across);
        // The greatest of the three without a branch: which one it is is anybody's guess.
        let is_mid = (mid >= low) & (mid >= high);
        let peak = usize::from(is_mid) + 2 * usize::from(!is_mid & (low <= high));
        let [before, top, after] = around(peak * across);
        let index = first + (peak + 1) * across;
        let pixel = self.gradients.pixels[index];
        if top <= self.threshold || before > top || after > top || pixel.is_taken() {
            return None;
        }
        let gradient = pixel.vector();
        let dot = normal(&line.direction).dot(&gradient);
        if dot <= 0.0 || dot * dot < MIN_COS2 * gradient.norm_squared() {
            return None;
        }
        let (a, b, c) = (f32::from(before), f32::from(top), f32::from(after));
        let curvature = a - 2.0 * b + c;
        let shift = if curvature < 0.0 { 0.5 * (a - c) / curvature } else { 0.0 };
        let minor = (nearest + peak as isize - 1) as f32 + shift;
        if (minor - predicted).abs() > line.tolerance {
            return None;
        }
        let px = self.px(major as f32, minor);
        Some(Ridge { place: Place { px, weight: 1.0, strength: dot / SCALE }, index, gradient })
    }

    fn px(&self, major: f32, minor: f32) -> Vector2<f32> {
        if STEEP { Vector2::new(minor, major) } else { Vector2::new(major, minor) }
    }
}

/// Direction of an edge with this gradient: the brighter side is on the right (rows go down).
fn along(gradient: &Vector2<f32>) -> Vector2<f32> {
    Vector2::new(gradient.y, -gradient.x) / gradient.norm().at_least(f32::MIN_POSITIVE)
}

/// Direction of the gradient of an edge along `direction`: the inverse of [`along`].
fn normal(direction: &Vector2<f32>) -> Vector2<f32> {
    Vector2::new(-direction.y, direction.x)
}
