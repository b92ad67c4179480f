//! A segment grows from a seed: the edge is followed pixel by pixel in both directions.
//!
//! From the pixels so far a line is known (at first by their gradients, then by a fit). The next pixel
//! along its major axis must be a ridge within [`TOLERANCE_PX`] of the line, with a gradient across it;
//! where there is none the line runs on over a gap of at most [`MAX_GAP`] pixels. Every look at a pixel is
//! a visit, and visits are what the extractor's budget counts.

use super::fit::LineSums;
use super::gradient::{BORDER, Gradients, SCALE};
use super::segment::Place;
use nalgebra::Vector2;

/// Largest distance of an edge pixel from the line so far, px.
const TOLERANCE_PX: f32 = 1.3;
/// Squared cosine of the largest angle between the gradient and the normal of the line (22.5 degrees).
const MIN_COS2: f32 = 0.853_553_4;
/// Longest gap, px.
const MAX_GAP: usize = 4;
/// Longest gap before the line is fitted, px.
const MAX_EARLY_GAP: usize = 1;
/// The line is fitted from this many pixels on; before it follows the mean gradient.
const FIT_FROM: usize = 10;
/// A run of fewer pixels behind the last gap is cut off.
const MIN_LAST_RUN: usize = 4;
/// An edge that turns this far from its major axis has ended.
const MAX_SLOPE: f32 = 1.3;

/// The pixel belongs to a segment, or lies beside one that does.
const TAKEN: u8 = 1;
/// A segment was tried here and came to nothing: no more is begun here.
const TRIED: u8 = 2;

/// Grows segments over the gradients of one image.
#[derive(Clone, Debug)]
pub struct Growth {
    marks: Vec<u8>,
    /// Edge pixels of the segment at hand, from the seed outward, first one way, then the other.
    pixels: Vec<EdgePixel>,
    places: Vec<Place>,
    sums: LineSums,
    /// Sum of the gradients of the pixels.
    gradient: Vector2<f32>,
    /// Distance in memory of neighbours across the segment at hand.
    across: usize,
    visits: usize,
}

/// A pixel of the segment at hand.
#[derive(Clone, Copy, Debug)]
struct EdgePixel {
    place: Place,
    index: usize,
    /// Which of the three pixels across the edge it marked as taken.
    marked: [bool; 3],
    /// Steps from the seed.
    step: usize,
}

/// The line so far.
#[derive(Clone, Copy, Debug)]
struct Line {
    point: Vector2<f32>,
    direction: Vector2<f32>,
}

/// What the growth of a segment came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grown {
    /// Direction, oriented as segments are.
    pub direction: Vector2<f32>,
    /// Pixels along the major axis from end to end.
    pub steps: usize,
    /// Edge pixels among them.
    pub support: usize,
}

/// The images an edge is followed in, and the axis along which.
#[derive(Clone, Copy, Debug)]
struct Course<'a> {
    gradients: &'a Gradients,
    threshold: i16,
    /// The major axis is that of the rows: y.
    is_steep: bool,
}

impl Growth {
    /// For images of `width` x `height`.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        let longest = width + height;
        Self {
            marks: vec![0; width * height],
            pixels: Vec::with_capacity(longest),
            places: Vec::with_capacity(longest),
            sums: LineSums::default(),
            gradient: Vector2::zeros(),
            across: 1,
            visits: 0,
        }
    }

    /// Forgets the image before.
    pub fn begin(&mut self) {
        self.marks.fill(0);
        self.visits = 0;
    }

    /// Pixels looked at since [`Self::begin`].
    #[must_use]
    pub fn visits(&self) -> usize {
        self.visits
    }

    /// Whether a segment may begin here.
    #[must_use]
    pub fn is_free(&self, seed: u32) -> bool {
        self.marks[seed as usize] == 0
    }

    /// Edge of the last segment, in no order.
    pub fn places(&mut self) -> &[Place] {
        self.places.clear();
        self.places.extend(self.pixels.iter().map(|p| p.place));
        &self.places
    }

    /// Follows the edge at `seed` both ways; what it takes it keeps, unless [`Self::reject`] follows.
    pub fn grow(&mut self, gradients: &Gradients, seed: u32, threshold: i16) -> Grown {
        let width = gradients.width();
        let (x, y) = (seed as usize % width, seed as usize / width);
        let (gx, gy) = gradients.at(seed as usize);
        self.pixels.clear();
        self.sums = LineSums::default();
        self.gradient = Vector2::new(f32::from(gx), f32::from(gy));
        let start = Line { point: Vector2::new(x as f32, y as f32), direction: along(&self.gradient) };
        let is_steep = start.direction.y.abs() > start.direction.x.abs();
        self.across = if is_steep { 1 } else { width };
        let course = Course { gradients, threshold, is_steep };
        let major = if is_steep { y } else { x } as isize;
        let (line, ahead) = self.follow(&course, start, major, 1);
        let back = if self.pixels.len() < FIT_FROM { Line { point: start.point, ..line } } else { line };
        let (line, behind) = self.follow(&course, back, major - 1, -1);
        Grown { direction: line.direction, steps: ahead + behind, support: self.pixels.len() }
    }

    /// Gives the pixels of the last segment back: it was none.
    pub fn reject(&mut self) {
        self.cut(0);
    }

    /// Follows the edge one way along the major axis until it ends; the refined line, and the steps to its
    /// last pixel.
    fn follow(
        &mut self,
        course: &Course<'_>,
        mut line: Line,
        mut major: isize,
        step: isize,
    ) -> (Line, usize) {
        let from = self.pixels.len();
        let (mut gap, mut steps, mut refit_at) = (0, 0, FIT_FROM.max(from + 1));
        while major >= BORDER as isize && major < course.limit_major() {
            steps += 1;
            self.visits += 1;
            if let Some((place, index)) = self.look(course, &line, major) {
                gap = 0;
                self.take(course, place, index, steps);
                if self.pixels.len() < FIT_FROM {
                    line = Line { point: place.px, direction: along(&self.gradient) };
                } else if self.pixels.len() >= refit_at {
                    refit_at = self.pixels.len() + (self.pixels.len() / 4).clamp(4, 32);
                    line = self.fitted(&line);
                }
                if course.slope(&line).abs() > MAX_SLOPE {
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
        self.cut_stub(from);
        (line, self.pixels[from..].last().map_or(0, |p| p.step))
    }

    /// The line through all pixels so far, in the sense of `line`.
    fn fitted(&self, line: &Line) -> Line {
        let Some((point, axis)) = self.sums.line() else { return *line };
        let axis = axis.cast::<f32>();
        let direction = if axis.dot(&line.direction) < 0.0 { -axis } else { axis };
        Line { point: point.cast(), direction }
    }

    /// The ridge at `major` nearest to the line, if there is one that fits.
    #[inline]
    fn look(&self, course: &Course<'_>, line: &Line, major: isize) -> Option<(Place, usize)> {
        let (predicted, cos) = course.predict(line, major);
        let nearest = (predicted + 0.5).floor() as isize;
        if nearest < BORDER as isize || nearest >= course.limit_minor() {
            return None;
        }
        let across = self.across as isize;
        let centre = course.index(major, nearest) as isize;
        let magnitude = course.gradients.magnitude();
        let at = |k: isize| magnitude[(centre + k * across) as usize];
        let (low, mid, high) = (at(-1), at(0), at(1));
        let offset = match (mid >= low && mid >= high, low > high) {
            (true, _) => 0,
            (false, true) => -1,
            (false, false) => 1,
        };
        let (before, peak, after) = (at(offset - 1), at(offset), at(offset + 1));
        let index = (centre + offset * across) as usize;
        let is_ridge = peak > course.threshold && before <= peak && after <= peak;
        if !is_ridge || self.marks[index] & TAKEN != 0 {
            return None;
        }
        let (gx, gy) = course.gradients.at(index);
        let gradient = Vector2::new(f32::from(gx), f32::from(gy));
        let dot = normal(&line.direction).dot(&gradient);
        if dot <= 0.0 || dot * dot < MIN_COS2 * gradient.norm_squared() {
            return None;
        }
        let (a, b, c) = (f32::from(before), f32::from(peak), f32::from(after));
        let curvature = a - 2.0 * b + c;
        let shift = if curvature < 0.0 { 0.5 * (a - c) / curvature } else { 0.0 };
        let minor = (nearest + offset) as f32 + shift;
        if (minor - predicted).abs() * cos > TOLERANCE_PX {
            return None;
        }
        let px = course.px(major as f32, minor);
        Some((Place { px, weight: 1.0, strength: dot / SCALE }, index))
    }

    /// Takes a pixel, and those beside it, so that no second segment begins there.
    #[inline]
    fn take(&mut self, course: &Course<'_>, place: Place, index: usize, step: usize) {
        let (gx, gy) = course.gradients.at(index);
        self.gradient += Vector2::new(f32::from(gx), f32::from(gy));
        self.sums.add(&place.px.cast(), 1.0);
        let marked = [index - self.across, index, index + self.across].map(|k| {
            let is_new = self.marks[k] & TAKEN == 0;
            self.marks[k] |= TAKEN;
            is_new
        });
        self.pixels.push(EdgePixel { place, index, marked, step });
    }

    /// Cuts off what lies behind the last gap if it is short.
    fn cut_stub(&mut self, from: usize) {
        let pixels = &self.pixels[from..];
        let gap = (1..pixels.len()).rev().find(|&k| pixels[k].step - pixels[k - 1].step > 1);
        if let Some(k) = gap
            && pixels.len() - k < MIN_LAST_RUN
        {
            self.cut(from + k);
        }
    }

    /// Gives back the pixels from number `from` on.
    fn cut(&mut self, from: usize) {
        for pixel in &self.pixels[from..] {
            let three = [pixel.index - self.across, pixel.index, pixel.index + self.across];
            for (k, _) in three.iter().zip(pixel.marked).filter(|(_, marked)| *marked) {
                self.marks[*k] = TRIED;
            }
        }
        self.pixels.truncate(from);
    }
}

impl Course<'_> {
    /// First coordinate beyond the image along the major axis.
    fn limit_major(&self) -> isize {
        let side = if self.is_steep { self.gradients.height() } else { self.gradients.width() };
        (side - BORDER) as isize
    }

    /// First coordinate beyond the image along the minor axis.
    fn limit_minor(&self) -> isize {
        let side = if self.is_steep { self.gradients.width() } else { self.gradients.height() };
        (side - BORDER) as isize
    }

    fn index(&self, major: isize, minor: isize) -> usize {
        let (x, y) = if self.is_steep { (minor, major) } else { (major, minor) };
        y as usize * self.gradients.width() + x as usize
    }

    fn px(&self, major: f32, minor: f32) -> Vector2<f32> {
        if self.is_steep { Vector2::new(minor, major) } else { Vector2::new(major, minor) }
    }

    /// Steps of the line along the minor axis per step along the major one.
    fn slope(&self, line: &Line) -> f32 {
        let d = &line.direction;
        if self.is_steep { d.x / d.y } else { d.y / d.x }
    }

    /// Where the line is at `major`, and the cosine between the minor axis and its normal.
    fn predict(&self, line: &Line, major: isize) -> (f32, f32) {
        let (p, d) = (&line.point, &line.direction);
        let (p_major, p_minor, cos) = if self.is_steep { (p.y, p.x, d.y) } else { (p.x, p.y, d.x) };
        (p_minor + (major as f32 - p_major) * self.slope(line), cos.abs())
    }
}

/// Direction of an edge with this gradient: the brighter side is on the right (rows go down).
fn along(gradient: &Vector2<f32>) -> Vector2<f32> {
    Vector2::new(gradient.y, -gradient.x) / gradient.norm().max(f32::MIN_POSITIVE)
}

/// Direction of the gradient of an edge along `direction`: the inverse of [`along`].
fn normal(direction: &Vector2<f32>) -> Vector2<f32> {
    Vector2::new(-direction.y, direction.x)
}
