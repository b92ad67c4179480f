//! Texture that repeats: which corners are unlike their surroundings, and where such a corner has gone.
//!
//! Coarse levels of the pyramid show a fine pattern of equal cells as aliases, and on the full image a match may be off by a whole
//! cell. A corner whose patch is not seen again close by can be looked for everywhere within that distance.
//!
//! Two signs tell that the texture in view repeats: most of the strongest corners have a rival, or some of all corners stand in a
//! lattice, with rivals opposite each other in two directions. Rivals alone are common where texture is scarce, along edges; lattices
//! are not, so that few of them tell, even where the strongest corners are edges of things and the pattern is too fine to be seen far away.

use super::align::TranslationTemplate;
use super::flow::{FlowOptions, MAX_LAST_STEP_PX, SAME_PLACE_PX, prepare_at, track_patch};
use super::stereo::MIN_LEAD;
use crate::image::Pyramid;
use crate::image::patch::{Patch, SIDE, sample_patch, sample_upright};
use nalgebra::{Matrix2, Vector2};

/// Correlation above which two places of one image are alike: fewer are left below 0.7, and above 0.85 false depths are as many again.
const ALIKE_ZNCC: f32 = 0.78;
/// Radius within which a corner is compared with its surroundings, px.
const SURROUNDINGS_PX: i32 = 12;
/// Distance of the patches that a corner is compared with, px: those beside its surroundings, and what a sampled patch needs beside it.
const REACH_PX: usize = SURROUNDINGS_PX as usize + 6;
/// Radius of the search in the next image, px: 1.5 m/s at a depth of 1.5 m, at 20 Hz in images of half the usual size.
const SEARCH_PX: i32 = 14;
/// Least correlation of a place before its alignment, and after.
const MIN_ZNCC: (f32, f32) = (0.6, 0.75);
/// Gain in correlation by an alignment, at most.
const MAX_GAIN: f32 = 0.1;
/// Opposite rivals are equally far from the corner to this, px.
const OPPOSITE_PX: i32 = 1;
/// Sine of the least angle between the two directions of a lattice.
const MIN_SINE: f32 = 0.5;
/// Corners of which it is remembered whether they have a rival, those that are enough to tell, and the shares above which the texture
/// begins to repeat, and goes on to.
const RIVALS: Limits = Limits { remembered: 24, enough: 6, begins: 0.75, ends: 0.6 };
/// Corners of which it is remembered whether they stand in a lattice (6 to 78 % on a fine pattern, none on others), and their limits.
const LATTICES: Limits = Limits { remembered: 64, enough: 24, begins: 0.05, ends: 0.01 };

/// Bounds of a running share.
#[derive(Clone, Copy, Debug)]
struct Limits {
    remembered: u32,
    enough: u32,
    begins: f32,
    ends: f32,
}

/// Running share of corners that are of a kind.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    share: f32,
    looked: u32,
    is_large: bool,
}

impl Share {
    fn add(&mut self, is_of_kind: bool, limits: &Limits) {
        self.looked = (self.looked + 1).min(limits.remembered);
        self.share += (f32::from(u8::from(is_of_kind)) - self.share) / self.looked as f32;
        let limit = if self.is_large { limits.ends } else { limits.begins };
        self.is_large = self.looked >= limits.enough && self.share > limit;
    }
}

/// Evidence that the texture in view repeats itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RepetitionWatch {
    rivals: Share,
    lattices: Share,
}

impl RepetitionWatch {
    /// Takes one of the strongest corners.
    pub fn add(&mut self, has_rival: bool) {
        self.rivals.add(has_rival, &RIVALS);
    }

    /// Takes any corner.
    pub fn add_any(&mut self, is_in_lattice: bool) {
        self.lattices.add(is_in_lattice, &LATTICES);
    }

    /// True before enough of the strongest corners were looked at.
    pub fn is_new(&self) -> bool {
        self.rivals.looked < RIVALS.enough
    }

    /// True if most of the strongest corners have a rival.
    pub fn is_everywhere(&self) -> bool {
        self.rivals.is_large
    }

    /// True if the texture in view repeats itself.
    pub fn is_repeating(&self) -> bool {
        self.rivals.is_large || self.lattices.is_large
    }
}

/// A corner with its surroundings, less the mean of its patch.
type Surroundings = [[f32; SIDE + 2 * REACH_PX]; SIDE + 2 * REACH_PX];

/// Correlation of the patch at a pixel `px` with that at a whole offset; `None` for a patch that can be compared with nothing. All
/// these patches are parts of one that is sampled once, into `around`, if that lies in the image.
fn likeness<'a>(
    pyramid: &'a Pyramid,
    px: &'a Vector2<f32>,
    around: &'a mut Surroundings,
) -> Option<impl Fn(Vector2<f32>) -> f32 + 'a> {
    let mut template = TranslationTemplate::empty();
    prepare_at(pyramid, 0, px, &Matrix2::identity(), &mut template).then_some(())?;
    let plane = pyramid.plane(0);
    let is_whole = sample_upright(&plane, px, template.mean, around);
    Some(move |offset: Vector2<f32>| {
        let mut patch = Patch::ZERO;
        if is_whole {
            patch.cut(around, [offset.x, offset.y].map(|x| (x + REACH_PX as f32) as usize));
        } else if !sample_patch(&plane, &(px + offset), template.mean, &mut patch) {
            return -1.0;
        }
        template.zncc(&patch).unwrap_or(-1.0)
    })
}

/// True if the patch at `px` is seen again at opposite places around it, in two directions.
pub(super) fn is_in_lattice(pyramid: &Pyramid, px: &Vector2<f32>) -> bool {
    let mut around = [[0.0; SIDE + 2 * REACH_PX]; SIDE + 2 * REACH_PX];
    let Some(zncc) = likeness(pyramid, px, &mut around) else { return false };
    let mut first: Option<Vector2<f32>> = None;
    for offset in offsets(SURROUNDINGS_PX).filter(|o| (o.y, o.x) < (0.0, 0.0) && is_around(o)) {
        let is_new = first.is_none_or(|a| a.perp(&offset).abs() > MIN_SINE * a.norm() * offset.norm());
        if !is_new || !is_rival(&zncc, offset) {
            continue;
        }
        if !offsets(OPPOSITE_PX).any(|off| is_rival(&zncc, off - offset)) {
            continue;
        }
        if first.is_some() {
            return true;
        }
        first = Some(offset);
    }
    false
}

/// True for an offset to another place close by.
fn is_around(offset: &Vector2<f32>) -> bool {
    (SAME_PLACE_PX..=SURROUNDINGS_PX as f32).contains(&offset.norm())
}

/// True if the patch is seen again at `offset`. The shoulder of the patch itself is no other place: a maximum of `zncc` is.
fn is_rival(zncc: &impl Fn(Vector2<f32>) -> f32, offset: Vector2<f32>) -> bool {
    let here = zncc(offset);
    here > ALIKE_ZNCC
        && [Vector2::x(), Vector2::y()]
            .iter()
            .all(|side| here >= zncc(offset + side) && here >= zncc(offset - side))
}

/// Distance from `px` to the nearest place around it where its patch is seen again, px; `None` for a corner of its own.
pub(super) fn nearest_rival_px(pyramid: &Pyramid, px: &Vector2<f32>) -> Option<f32> {
    let mut around = [[0.0; SIDE + 2 * REACH_PX]; SIDE + 2 * REACH_PX];
    let zncc = likeness(pyramid, px, &mut around)?;
    let mut nearest: Option<f32> = None;
    for offset in offsets(SURROUNDINGS_PX).filter(is_around) {
        let far = offset.norm();
        if nearest.is_none_or(|nearest| nearest > far) && is_rival(&zncc, offset) {
            nearest = Some(far);
        }
    }
    nearest
}

/// Finds the patch around `from_px` of `from` at the one place around `guess` in `to` that is like it. `warp` takes offsets in
/// `from` to offsets in `to`.
pub(super) fn search(
    (from, from_px): (&Pyramid, &Vector2<f32>),
    (to, guess): (&Pyramid, &Vector2<f32>),
    warp: &Matrix2<f32>,
    max_iterations: usize,
) -> Option<Vector2<f32>> {
    let mut template = TranslationTemplate::empty();
    prepare_at(from, 0, from_px, &warp.try_inverse()?, &mut template).then_some(())?;
    let plane = to.plane(0);
    let mut zncc = [-1.0f32; (2 * SEARCH_PX as usize + 1).pow(2)];
    let mut best = (*guess, MIN_ZNCC.0);
    for (value, offset) in zncc.iter_mut().zip(offsets(SEARCH_PX)) {
        let place = guess + offset;
        *value = template.zncc_at(&plane, &place).unwrap_or(-1.0);
        if *value > best.1 {
            best = (place, *value);
        }
    }
    let options = FlowOptions { top_level: 0, max_iterations };
    let align = |place: &Vector2<f32>| track_patch((from, from_px), (to, place), warp, &options);
    let found = align(&best.0)?;
    let is_good = (found.px - best.0).norm() <= SAME_PLACE_PX
        && found.zncc >= MIN_ZNCC.1
        && found.last_step_px <= MAX_LAST_STEP_PX;
    let may_rival = |place: &Vector2<f32>, zncc: f32| {
        zncc > found.zncc - MIN_LEAD - MAX_GAIN && (place - found.px).norm() > SAME_PLACE_PX
    };
    let rivals = |place: &Vector2<f32>| {
        align(place)
            .is_some_and(|r| (r.px - found.px).norm() > SAME_PLACE_PX && r.zncc > found.zncc - MIN_LEAD)
    };
    let is_alone = || {
        let places = zncc.iter().zip(offsets(SEARCH_PX)).map(|(zncc, offset)| (guess + offset, *zncc));
        !places.filter(|(place, zncc)| may_rival(place, *zncc)).any(|(place, _)| rivals(&place))
    };
    (is_good && is_alone()).then_some(found.px)
}

/// Whole offsets in a square, row by row.
fn offsets(radius: i32) -> impl Iterator<Item = Vector2<f32>> {
    (-radius..=radius).flat_map(move |y| (-radius..=radius).map(move |x| Vector2::new(x as f32, y as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::{GrayImage, Random};

    const SIZE: usize = 96;
    const AT: Vector2<f32> = Vector2::new(48.0, 48.0);

    /// An image of cells of 5 px, each with a dark rectangle, moved by `shift`; the one in the middle may be brighter than all.
    fn image(shift: (i32, i32), is_odd: bool) -> Pyramid {
        let mut random = Random::new(3);
        let level = |x: i32, y: i32| match x.rem_euclid(5) < 2 && y.rem_euclid(5) < 3 {
            _ if is_odd && (x - 46).abs() < 4 && (y - 47).abs() < 4 => 240.0,
            true => 60.0,
            false => 150.0,
        };
        let pixel = |k: usize| level((k % SIZE) as i32 - shift.0, (k / SIZE) as i32 - shift.1);
        let pixels: Vec<u8> = (0..SIZE * SIZE).map(|k| (pixel(k) + random.gaussian()) as u8).collect();
        let mut pyramid = Pyramid::new(SIZE, SIZE, 3);
        assert!(pyramid.build(&GrayImage::from_pixels(SIZE, SIZE, pixels).unwrap().view()));
        pyramid
    }

    #[test]
    fn a_corner_among_equal_cells_repeats_and_one_of_its_own_does_not() {
        assert!(nearest_rival_px(&image((0, 0), false), &AT).is_some_and(|px| (px - 5.0).abs() < 1.5));
        assert_eq!(nearest_rival_px(&image((0, 0), true), &AT), None);
    }

    #[test]
    fn a_corner_among_equal_cells_stands_in_a_lattice_and_one_of_its_own_does_not() {
        assert!(is_in_lattice(&image((0, 0), false), &AT));
        assert!(!is_in_lattice(&image((0, 0), true), &AT));
    }

    #[test]
    fn equal_cells_in_a_row_are_no_lattice() {
        let mut random = Random::new(4);
        let level = |x: usize, y: usize| if x % 5 < 2 && (44..50).contains(&y) { 60.0 } else { 150.0 };
        let pixels =
            (0..SIZE * SIZE).map(|k| (level(k % SIZE, k / SIZE) + random.gaussian()) as u8).collect();
        let mut row = Pyramid::new(SIZE, SIZE, 3);
        assert!(row.build(&GrayImage::from_pixels(SIZE, SIZE, pixels).unwrap().view()));
        assert!(nearest_rival_px(&row, &AT).is_some() && !is_in_lattice(&row, &AT));
    }

    #[test]
    fn few_lattices_tell_where_the_strongest_corners_are_edges_of_things() {
        let mut watch = RepetitionWatch::default();
        (0..16).for_each(|k| watch.add(k % 3 == 0));
        (0..64).for_each(|_| watch.add_any(false));
        assert!(!watch.is_repeating());
        (0..8).for_each(|k| watch.add_any(k % 2 == 0));
        assert!(watch.is_repeating());
    }

    #[test]
    fn a_corner_of_its_own_is_found_two_cells_away() {
        let (before, now) = (image((0, 0), true), image((10, -9), true));
        let found = search((&before, &AT), (&now, &AT), &Matrix2::identity(), 8);
        assert!(found.is_some_and(|px| (px - AT - Vector2::new(10.0, -9.0)).norm() < 0.2), "{found:?}");
    }

    #[test]
    fn a_corner_among_equal_cells_is_found_nowhere() {
        let (before, now) = (image((0, 0), false), image((2, 1), false));
        assert_eq!(search((&before, &AT), (&now, &AT), &Matrix2::identity(), 8), None);
    }
}
