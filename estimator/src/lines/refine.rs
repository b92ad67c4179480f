//! Exact place of an edge: segments found at half the resolution are fitted to the whole image.
//!
//! Along its major axis a segment is crossed at most [`MAX_CROSSINGS`] times. Each crossing is a profile of the image along the minor
//! axis, differentiated by `[-1 -4 -5 0 5 4 1]` (the binomial filter `[1 4 6 4 1]` and `[-1 0 1]`); the edge is its steepest
//! place near to where it is expected, to a fraction of a pixel by a parabola. From its ends the edge is followed further
//! while it is found: at half the resolution it ends early, and breaks at what is small. The new segment is the line through
//! all these places by total least squares.

use super::growth::MAX_GAP;
use super::segment::{NODES, Place, Segment};
use crate::image::mask::ImageMask;
use crate::image::patch::whole;
use nalgebra::{Matrix3, Vector2, Vector3};
use plumbline_config::{ImageView, Portable};

/// Pixels of a profile, and the place of its middle.
const PROFILE: usize = 16;
const MIDDLE: usize = 6;
/// Response of the filter to a ramp of one grey level per pixel.
const FILTER_GAIN: f32 = 32.0;
/// A crossing counts where it is at least this steep, as a share of the gradient at half the resolution: a third of what
/// an edge has there.
const MIN_SHARE: f32 = 0.25;
/// A crossing further than this from the curve through all of them is that of another edge, px.
const MAX_OFF_PX: f32 = 0.4;
/// Limit of [`MAX_OFF_PX`] beyond the ends, where the curve is continued, px.
const MAX_OFF_BEYOND_PX: f32 = 0.6;
/// An edge is followed this far beyond its ends, px, over gaps of at most [`MAX_GAP`].
const MAX_BEYOND: usize = 48;
/// From this length on the lens bends an edge enough to be seen, px along the major axis.
const BENT_FROM_PX: f32 = 60.0;
/// Parts of a segment, or crossings, that a bent curve needs.
const BENT_FROM_PLACES: usize = 5;
/// A segment is crossed so often from end to end, at most: places twice as dense say little more, and the work of a segment
/// has a bound.
const MAX_CROSSINGS: f32 = 48.0;
/// A segment is searched this far from where it is expected, px.
const REACH: i32 = 4;
/// At least this share of the crossings from end to end is found.
const MIN_FOUND: f32 = 0.7;

/// A segment of the whole image.
#[derive(Clone, Copy, Debug)]
pub struct RefinedSegment {
    /// Line, ends and nodes.
    pub segment: Segment,
    /// Crossings looked for from end to end.
    pub tried: usize,
    /// Crossings found.
    pub found: usize,
}

/// Refines segments. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct Refiner {
    crossings: Vec<Crossing>,
    places: Vec<Place>,
}

/// Crossing of an edge: coordinates along the major and the minor axis, px, the gradient, grey levels per pixel, and the pixels
/// along the major axis that it stands for.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    major: f32,
    minor: f32,
    strength: f32,
    weight: f32,
}

impl Refiner {
    /// For images of `width` x `height` px.
    pub fn new(width: usize, height: usize) -> Self {
        let room = width.max(height) + 2 * MAX_BEYOND;
        Self { crossings: Vec::with_capacity(room), places: Vec::with_capacity(room) }
    }

    /// Refines the edge `coarse`, off by up to [`REACH`], in the image; `None` where it is not seen. `coarse` is in pixels of the
    /// whole image, its strength in grey levels per halved pixel. Pixels hidden by `mask` are not looked at.
    pub fn refine(
        &mut self,
        image: &ImageView<'_>,
        coarse: &Segment,
        mask: Option<&ImageMask>,
    ) -> Option<RefinedSegment> {
        let edge = Edge::of(image, coarse, mask);
        let (a, b) = (edge.axes(&coarse.start).0, edge.axes(&coarse.end).0);
        let (first, last) = (a.at_most(b), a.at_least(b));
        let (centre, is_long) = (0.5 * (first + last), last - first >= BENT_FROM_PX);
        let expected = edge.curve_of(coarse, centre, is_long)?;
        let expected = expected.moved(edge.offset(&expected, first, last)?);
        self.crossings.clear();
        let stride = (((last - first) / MAX_CROSSINGS).ceil() as usize).max(1);
        for major in (first.ceil() as isize..=last.floor() as isize).step_by(stride) {
            let crossing = edge.cross(&expected, major);
            self.crossings.extend(crossing.map(|c| Crossing { weight: stride as f32, ..c }));
        }
        let is_bent = is_long && self.crossings.len() >= BENT_FROM_PLACES;
        let places = self.crossings.iter().map(|c| (c.major, c.minor, 1.0));
        let curve = Curve::through(places, centre, is_bent)?;
        self.crossings.retain(|c| curve.distance(c) <= MAX_OFF_PX);
        let (lowest, highest) =
            (self.crossings.first()?.major as isize, self.crossings.last()?.major as isize);
        let beyond = self.follow(&edge, &curve, lowest, -1) + self.follow(&edge, &curve, highest, 1);
        let tried = (highest - lowest) as usize / stride + 1 + beyond;
        let found = self.crossings.len();
        if (found as f32) < MIN_FOUND * tried as f32 {
            return None;
        }
        self.places.clear();
        self.places.extend(self.crossings.iter().map(|c| edge.place(c)));
        Segment::through(&self.places, &coarse.direction(), 0.0).map(|segment| RefinedSegment {
            segment,
            tried,
            found,
        })
    }

    /// Follows the edge beyond its end at `major`, pixel by pixel; how far.
    fn follow(&mut self, edge: &Edge<'_>, curve: &Curve, mut major: isize, step: isize) -> usize {
        let (mut end, mut gap) = (0, 0);
        for beyond in 1..=MAX_BEYOND {
            major += step;
            match edge.cross(curve, major).filter(|c| curve.distance(c) <= MAX_OFF_BEYOND_PX) {
                Some(crossing) => {
                    self.crossings.push(crossing);
                    (end, gap) = (beyond, 0);
                }
                None if gap == MAX_GAP => break,
                None => gap += 1,
            }
        }
        end
    }
}

/// The course of an edge, which the lens may bend: `minor = c0 + c1 t + c2 t^2` with `t = major - centre`.
#[derive(Clone, Copy, Debug)]
struct Curve {
    centre: f32,
    coefficients: [f32; 3],
}

impl Curve {
    /// Fits the curve with the least squared distances along the minor axis to places `(major, minor, weight)`;
    /// straight unless `is_bent`.
    fn through(places: impl Iterator<Item = (f32, f32, f32)>, centre: f32, is_bent: bool) -> Option<Self> {
        // Moments of t up to the fourth order, and of minor with t up to the second.
        let (mut m, mut r) = ([0.0; 5], [0.0; 3]);
        for (major, minor, weight) in places {
            let [t, y, w] = [major - centre, minor, weight].map(f64::from);
            let powers = [w, w * t, w * t * t];
            for k in 0..3 {
                m[k] += powers[k];
                r[k] += powers[k] * y;
            }
            m[3] += powers[2] * t;
            m[4] += powers[2] * t * t;
        }
        let coefficients = if is_bent {
            let normal = Matrix3::new(m[0], m[1], m[2], m[1], m[2], m[3], m[2], m[3], m[4]);
            normal.try_inverse()? * Vector3::from(r)
        } else {
            let determinant = m[0] * m[2] - m[1] * m[1];
            (determinant > 1e-9).then_some(())?;
            Vector3::new(m[2] * r[0] - m[1] * r[1], m[0] * r[1] - m[1] * r[0], 0.0) / determinant
        };
        Some(Self { centre, coefficients: coefficients.cast::<f32>().into() })
    }

    /// The curve moved by `offset` along the minor axis, px.
    fn moved(&self, offset: f32) -> Self {
        let [c0, c1, c2] = self.coefficients;
        Self { coefficients: [c0 + offset, c1, c2], ..*self }
    }

    fn at(&self, major: f32) -> f32 {
        let (t, [c0, c1, c2]) = (major - self.centre, self.coefficients);
        c0 + t * (c1 + t * c2)
    }

    /// Distance of a crossing along the minor axis, px.
    fn distance(&self, crossing: &Crossing) -> f32 {
        (crossing.minor - self.at(crossing.major)).abs()
    }
}

/// Image across which an edge is searched.
#[derive(Clone, Copy, Debug)]
struct Edge<'a> {
    image: &'a ImageView<'a>,
    mask: Option<&'a ImageMask>,
    /// The major axis is that of the rows: y.
    is_steep: bool,
    /// 1 where the image brightens along the minor axis, else -1.
    sign: i32,
    /// Least response of the filter.
    threshold: i32,
}

impl<'a> Edge<'a> {
    fn of(image: &'a ImageView<'a>, segment: &Segment, mask: Option<&'a ImageMask>) -> Self {
        let direction = segment.direction();
        let is_steep = direction.y.abs() > direction.x.abs();
        // The gradient points to the right of the direction.
        let is_brighter = if is_steep { direction.y < 0.0 } else { direction.x > 0.0 };
        let sign = if is_brighter { 1 } else { -1 };
        Self { image, mask, is_steep, sign, threshold: (MIN_SHARE * FILTER_GAIN * segment.strength) as i32 }
    }

    /// Coordinates along the major and the minor axis.
    fn axes(&self, px: &Vector2<f32>) -> (f32, f32) {
        if self.is_steep { (px.y, px.x) } else { (px.x, px.y) }
    }

    fn place(&self, c: &Crossing) -> Place {
        let px = if self.is_steep { Vector2::new(c.minor, c.major) } else { Vector2::new(c.major, c.minor) };
        Place { px, weight: c.weight, strength: c.strength }
    }

    /// The curve through the nodes of a segment.
    fn curve_of(&self, segment: &Segment, centre: f32, is_long: bool) -> Option<Curve> {
        let nodes = segment.nodes.iter().filter(|node| node.weight > 0.0);
        let is_bent = is_long && nodes.clone().count() >= BENT_FROM_PLACES;
        let places = nodes.map(|node| {
            let (major, minor) = self.axes(&node.px);
            (major, minor, node.weight)
        });
        Curve::through(places, centre, is_bent)
    }

    /// How far the edge lies from where `expected` has it between two places, px along the minor axis: the least by which half of some
    /// crossings find it.
    fn offset(&self, expected: &Curve, first: f32, last: f32) -> Option<f32> {
        let share = |k: usize| (k as f32 + 0.5) / NODES as f32;
        let majors: [_; NODES] = std::array::from_fn(|k| (first + (last - first) * share(k)) as isize);
        // 0, 1, -1, 2 and so on.
        (1..2 * REACH + 2).map(|k| if k % 2 == 0 { k / 2 } else { -(k / 2) } as f32).find(|offset| {
            let curve = expected.moved(*offset);
            let is_there = |c: Crossing| curve.distance(&c) <= MAX_OFF_BEYOND_PX;
            2 * majors.iter().filter(|m| self.cross(&curve, **m).is_some_and(is_there)).count() >= NODES
        })
    }

    /// Crosses the edge at a pixel of the major axis, near to where `expected` has it.
    #[inline(always)]
    fn cross(&self, expected: &Curve, major: isize) -> Option<Crossing> {
        let (width, height) = (self.image.width(), self.image.height());
        let (majors, minors) = if self.is_steep { (height, width) } else { (width, height) };
        let row = usize::try_from(major).ok().filter(|&m| m < majors)?;
        let nearest = whole((expected.at(major as f32) + 0.5).at_least(0.0).at_most(minors as f32)) as usize;
        let from = nearest.checked_sub(MIDDLE).filter(|from| from + PROFILE <= minors)?;
        let (offset, response) = if self.is_steep {
            let levels = &self.image.row(row)[from..from + PROFILE];
            self.steepest(|k| levels[k])
        } else {
            self.steepest(|k| self.image.pixel(row, from + k))
        }?;
        let minor = nearest as f32 + offset;
        let crossing = Crossing { major: major as f32, minor, strength: response / FILTER_GAIN, weight: 1.0 };
        let is_hidden = |mask: &ImageMask| mask.hides_px(&self.place(&crossing).px.cast());
        (!self.mask.is_some_and(is_hidden)).then_some(crossing)
    }

    /// Distance of the steepest place from the middle of a profile of [`PROFILE`] grey levels, and the response there, if it
    /// is near and steep enough.
    #[inline(always)]
    fn steepest(&self, level: impl Fn(usize) -> u8) -> Option<(f32, f32)> {
        let slope = |offset| self.sign * slope(&level, offset);
        let (b, c, d) = (slope(-1), slope(0), slope(1));
        // Of two alike the middle one, then the one before.
        let (before, top, after, at) = match (c >= b && c >= d, b >= d) {
            (true, _) => (b, c, d, 0.0),
            (false, true) => (slope(-2), b, c, -1.0),
            (false, false) => (c, d, slope(2), 1.0),
        };
        if top <= self.threshold || before > top || after > top {
            return None;
        }
        let [a, b, c] = [before, top, after].map(|response| response as f32);
        let curvature = a - 2.0 * b + c;
        let shift = if curvature < 0.0 { 0.5 * (a - c) / curvature } else { 0.0 };
        Some((at + shift, b))
    }
}

/// Response of the filter to a profile, so far from its middle: at most `10 * 255`.
#[inline(always)]
fn slope(level: &impl Fn(usize) -> u8, offset: isize) -> i32 {
    let at = |k: isize| i32::from(level((MIDDLE as isize + offset + k) as usize));
    at(3) - at(-3) + 4 * (at(2) - at(-2)) + 5 * (at(1) - at(-1))
}

#[cfg(test)]
mod tests {
    use super::super::segment::SegmentNode;
    use super::*;
    use plumbline_config::GrayImage;

    const SIZE: (usize, usize) = (160, 120);

    /// Brighter on one side of the curve `minor = f(major)` between columns (or rows) 30 and 100, with a ramp of 2 px.
    fn image(is_steep: bool, f: impl Fn(f64) -> f64) -> GrayImage {
        let level = |i: usize| {
            let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let (major, minor) = if is_steep { (y, x) } else { (x, y) };
            let is_edge = (30.0..=100.0).contains(&major);
            let side = if is_edge { (0.5 * (minor - f(major)) + 0.5).clamp(0.0, 1.0) } else { 0.0 };
            (60.0 + 80.0 * side) as u8
        };
        GrayImage::from_pixels(SIZE.0, SIZE.1, (0..SIZE.0 * SIZE.1).map(level).collect()).expect("size")
    }

    /// Segment as half the resolution may find it: half a pixel off, and short at both ends.
    fn coarse(is_steep: bool, f: impl Fn(f64) -> f64) -> Segment {
        let px = |major: f64| {
            let minor = f(major) + if (major as i32).rem_euclid(8) < 4 { 0.5 } else { -0.5 };
            let px = if is_steep { Vector2::new(minor, major) } else { Vector2::new(major, minor) };
            px.cast::<f32>()
        };
        let (first, last) = (36.0, 94.0);
        let nodes = std::array::from_fn(|k| {
            let major = first + (last - first) * (k as f64 + 0.5) / NODES as f64;
            SegmentNode { px: px(major), weight: 7.0 }
        });
        // Brighter on the right in an image whose rows go down.
        let (start, end) = if is_steep { (px(last), px(first)) } else { (px(first), px(last)) };
        Segment { start, end, nodes, strength: 40.0, support: 58.0 }
    }

    #[test]
    fn an_edge_is_found_to_a_fraction_of_a_pixel_and_from_end_to_end() {
        for is_steep in [false, true] {
            for slope in [-0.8, -0.13, 0.0, 0.37] {
                let f = |major: f64| 60.3 + slope * (major - 65.0);
                let image = image(is_steep, f);
                let mut refiner = Refiner::new(SIZE.0, SIZE.1);
                let refined = refiner.refine(&image.view(), &coarse(is_steep, f), None).expect("is seen");
                let support = refined.segment.support;
                assert!((70.0..=74.0).contains(&support), "{support} px");
                for node in refined.segment.nodes {
                    let px = node.px.cast::<f64>();
                    let (major, minor) = if is_steep { (px.y, px.x) } else { (px.x, px.y) };
                    let off = minor - f(major);
                    assert!(off.abs() < 0.1, "{slope}: {off} px off");
                }
            }
        }
    }

    #[test]
    fn an_edge_that_the_lens_bends_is_followed_along_its_bend() {
        let f = |major: f64| 60.3 + 0.2 * (major - 65.0) + 0.001 * (major - 65.0) * (major - 65.0);
        let image = image(false, f);
        let mut refiner = Refiner::new(SIZE.0, SIZE.1);
        let coarse =
            Segment { start: Vector2::new(33.0, 54.9), end: Vector2::new(97.0, 67.7), ..coarse(false, f) };
        let refined = refiner.refine(&image.view(), &coarse, None).expect("is seen");
        assert!(refined.segment.support >= 68.0, "{} of 71 are crossed", refined.segment.support);
        let bend = refined.segment.nodes.map(|n| f64::from(n.px.y) - f(f64::from(n.px.x)));
        assert!(bend.iter().all(|off| off.abs() < 0.15), "{bend:?}");
    }

    #[test]
    fn what_is_not_in_the_image_is_no_segment() {
        let f = |major: f64| 60.3 + 0.37 * (major - 65.0);
        let flat = GrayImage::from_pixels(SIZE.0, SIZE.1, vec![90; SIZE.0 * SIZE.1]).expect("size");
        let mut refiner = Refiner::new(SIZE.0, SIZE.1);
        assert!(refiner.refine(&flat.view(), &coarse(false, f), None).is_none());
        // Nor is an edge whose other side is the brighter one.
        let turned = Segment { start: coarse(false, f).end, end: coarse(false, f).start, ..coarse(false, f) };
        assert!(refiner.refine(&image(false, f).view(), &turned, None).is_none());
    }
}
