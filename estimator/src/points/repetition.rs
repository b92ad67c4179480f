//! Texture that repeats: which corners are unlike their surroundings, and where such a corner has gone.
//!
//! Coarse levels of the pyramid show a fine pattern of equal cells as aliases, and on the full image a match may be off by a whole
//! cell. A corner whose patch is not seen again close by can be looked for everywhere within that distance.

use super::align::TranslationTemplate;
use super::flow::{FlowOptions, prepare_at, track_patch};
use crate::image::Pyramid;
use nalgebra::{Matrix2, Vector2};

/// Correlation above which two places of one image are alike: fewer are left below 0.7, and above 0.85 false depths are as many again.
const ALIKE_ZNCC: f32 = 0.78;
/// Radius within which a corner is compared with its surroundings, px.
const SURROUNDINGS_PX: i32 = 12;
/// Offsets below this are the corner itself, px.
const SAME_PLACE_PX: f32 = 2.0;
/// Radius of the search in the next image, px: 1.5 m/s at a depth of 1.5 m, at 20 Hz in images of half the usual size.
const SEARCH_PX: i32 = 14;
/// Places of a search.
const PLACES: usize = (2 * SEARCH_PX as usize + 1) * (2 * SEARCH_PX as usize + 1);
/// Least correlation of a place before its alignment, and after.
const MIN_ZNCC: (f32, f32) = (0.6, 0.75);
/// The best place is better than any other by this much.
const MIN_LEAD: f32 = 0.08;
/// Gain in correlation by an alignment, at most.
const MAX_GAIN: f32 = 0.1;
/// Corners that are remembered, corners that are enough to tell, and the share of them above which the texture repeats.
const REMEMBERED: u32 = 24;
const ENOUGH: u32 = 6;
const REPEATING_SHARE: f32 = 0.75;
/// A last step longer than this means no convergence, px.
const MAX_LAST_STEP_PX: f32 = 0.1;

/// Running share of the corners that are seen again close by.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RepetitionWatch {
    share: f32,
    looked: u32,
}

impl RepetitionWatch {
    /// Takes a corner.
    pub fn add(&mut self, is_repeated: bool) {
        self.looked = (self.looked + 1).min(REMEMBERED);
        self.share += (f32::from(u8::from(is_repeated)) - self.share) / self.looked as f32;
    }

    /// True before enough corners were looked at.
    pub fn is_new(&self) -> bool {
        self.looked < ENOUGH
    }

    /// True if the texture in view repeats itself.
    pub fn is_repeating(&self) -> bool {
        self.looked >= ENOUGH && self.share > REPEATING_SHARE
    }
}

/// Distance from `px` to the nearest place around it where its patch is seen again, px; `None` for a corner of its own.
pub(super) fn nearest_rival_px(pyramid: &Pyramid, px: &Vector2<f32>) -> Option<f32> {
    let mut template = TranslationTemplate::empty();
    if !prepare_at(pyramid, 0, px, &Matrix2::identity(), &mut template) {
        return None;
    }
    let plane = pyramid.plane(0);
    let zncc = |at: Vector2<f32>| template.zncc_at(&plane, &at).unwrap_or(-1.0);
    let mut nearest: Option<f32> = None;
    for offset in offsets(SURROUNDINGS_PX) {
        let far = offset.norm();
        if far < SAME_PLACE_PX
            || far > SURROUNDINGS_PX as f32
            || nearest.is_some_and(|nearest| nearest <= far)
        {
            continue;
        }
        let at = px + offset;
        let here = zncc(at);
        // The shoulder of the patch itself is no other place: a maximum is.
        let is_maximum = here > ALIKE_ZNCC
            && [Vector2::x(), Vector2::y()]
                .iter()
                .all(|side| here >= zncc(at + side) && here >= zncc(at - side));
        if is_maximum {
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
    let mut zncc = [-1.0f32; PLACES];
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
