//! Views that stay the same: images of one camera that differ by their noise alone.
//!
//! A view is the same as long as it differs from the one at the beginning no more than neighbouring images differ from each other. The
//! view of a camera that moves differs from the beginning more with every image. Only a view with texture can show it.

use crate::thumbnail::Thumbnail;
use plumbline_config::Timestamp;

/// Mean square by which the view may differ from that at the beginning, as a multiple of that between neighbours.
const DRIFT: f64 = 1.4;
/// Difference of images that are the same but for rounding, squared grey levels.
const SAME: f64 = 1e-3;
/// Largest difference of neighbours, as a multiple of the variance of the view: half a correlation.
const UNLIKE: f64 = 1.0;
/// Tiles of a view, the standard deviation of one that has texture, grey levels, and the least share of such tiles.
const TILES: (usize, usize) = (8, 6);
const TEXTURE: f64 = 2.0;
const MIN_TEXTURED: f64 = 0.5;

/// Time in which a camera shows one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SameView {
    pub(crate) camera: usize,
    /// Stamp of the first image of it, and of the last one.
    pub(crate) from: Timestamp,
    pub(crate) to: Timestamp,
    /// Images after the first one, and those of them that are bit for bit the one before.
    pub(crate) repeats: usize,
    pub(crate) exact: usize,
}

/// What one camera shows.
#[derive(Default)]
pub(super) struct View {
    last: Option<(Timestamp, Thumbnail)>,
    same: Option<Same>,
}

/// View that has been the same since its first image.
struct Same {
    first: Thumbnail,
    from: Timestamp,
    to: Timestamp,
    repeats: usize,
    exact: usize,
    /// Sum of the differences from neighbour to neighbour.
    noise: f64,
}

impl View {
    /// Takes the next image, of which the detail is looked at; returns the time of one view that ends with it.
    pub(super) fn add(
        &mut self,
        stamp: Timestamp,
        image: Option<&Thumbnail>,
        camera: usize,
    ) -> Option<SameView> {
        let now = image.map(|image| image.halved().detail());
        let is_same = now.as_ref().is_some_and(|now| self.go_on(stamp, now));
        let ended = if is_same { None } else { self.so_far(camera) };
        if !is_same {
            self.same = now.as_ref().and_then(|now| self.begin(stamp, now));
        }
        self.last = now.map(|now| (stamp, now));
        ended
    }

    /// The time of the present view.
    pub(super) fn so_far(&self, camera: usize) -> Option<SameView> {
        let same = self.same.as_ref()?;
        Some(SameView { camera, from: same.from, to: same.to, repeats: same.repeats, exact: same.exact })
    }

    /// Goes on with the view; `false` if this is another one.
    fn go_on(&mut self, stamp: Timestamp, now: &Thumbnail) -> bool {
        let (Some(same), Some((_, last))) = (&mut self.same, &self.last) else { return false };
        let change = difference(last, now);
        let (repeats, noise) = (same.repeats + 1, same.noise + change);
        let is_same =
            is_like(now, change) && difference(&same.first, now) <= DRIFT * noise / repeats as f64 + SAME;
        if is_same {
            (same.to, same.repeats, same.noise) = (stamp, repeats, noise);
            same.exact += usize::from(change == 0.0);
        }
        is_same
    }

    /// The view that the last image and this one share.
    fn begin(&self, stamp: Timestamp, now: &Thumbnail) -> Option<Same> {
        let (from, last) = self.last.as_ref()?;
        let noise = difference(last, now);
        let exact = usize::from(noise == 0.0);
        is_like(now, noise).then(|| Same {
            first: last.clone(),
            from: *from,
            to: stamp,
            repeats: 1,
            exact,
            noise,
        })
    }
}

/// True if a view with so much texture would differ by more from another one.
fn is_like(view: &Thumbnail, change: f64) -> bool {
    change <= UNLIKE * variance(view.pixels.iter()) && textured(view) >= MIN_TEXTURED
}

/// Mean square difference of the pixels.
fn difference(a: &Thumbnail, b: &Thumbnail) -> f64 {
    let squares = a.pixels.iter().zip(&b.pixels).map(|(a, b)| f64::from((a - b) * (a - b)));
    squares.sum::<f64>() / a.pixels.len().max(1) as f64
}

/// Share of the tiles that have texture.
fn textured(view: &Thumbnail) -> f64 {
    let (width, height) = (view.width / TILES.0, view.height / TILES.1);
    let has_texture = |tile: &usize| {
        let (x, y) = (tile % TILES.0 * width, tile / TILES.0 * height);
        let rows = (y..y + height).map(|row| &view.pixels[row * view.width + x..][..width]);
        variance(rows.flatten()) >= TEXTURE * TEXTURE
    };
    let count = TILES.0 * TILES.1;
    (0..count).filter(has_texture).count() as f64 / count as f64
}

fn variance<'a>(values: impl Iterator<Item = &'a f32>) -> f64 {
    let (sum, squares, count) = values.fold((0.0, 0.0, 0.0), |(sum, squares, count), value| {
        let value = f64::from(*value);
        (sum + value, squares + value * value, count + 1.0)
    });
    let mean = sum / f64::max(count, 1.0);
    squares / f64::max(count, 1.0) - mean * mean
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thumbnail of a pattern shifted by so many pixels, with noise of so many grey levels; every seed has its own.
    fn image(shift: f64, contrast: f64, noise: f64, seed: u64) -> Thumbnail {
        let mut state = seed;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) * 2.0 - 1.0
        };
        let mut image = Thumbnail::new((752, 480));
        for y in 0..image.height {
            for x in 0..image.width {
                let (u, v) = (x as f64 + shift, y as f64);
                let grey =
                    120.0 + contrast * ((u * 0.31).sin() * (v * 0.27).cos() + (u * 0.13 + v * 0.2).sin());
                image.pixels[y * image.width + x] = (grey + noise * draw()) as f32;
            }
        }
        image
    }

    /// Repeats of the views of twenty images that shift by so much from one to the next.
    fn views(shift: f64, contrast: f64, noise: f64) -> Vec<usize> {
        let (mut view, mut found) = (View::default(), Vec::new());
        for k in 0..20_u32 {
            let image = image(shift * f64::from(k), contrast, noise, u64::from(k) + 1);
            found.extend(view.add(Timestamp::from_nanos(i64::from(k) * 50_000_000), Some(&image), 0));
        }
        found.extend(view.so_far(0));
        found.iter().map(|view| view.repeats).collect()
    }

    #[test]
    fn a_view_that_stays_is_the_same_whatever_its_noise() {
        for noise in [0.0, 0.5, 1.0, 4.0] {
            assert_eq!(views(0.0, 10.0, noise), [19], "{noise}");
        }
    }

    #[test]
    fn a_view_that_moves_slowly_is_another_one_soon() {
        for noise in [0.0, 0.5, 1.0] {
            for shift in [0.3, 1.0, 5.0] {
                let longest = views(shift, 10.0, noise).into_iter().max().unwrap_or(0);
                assert!(longest as f64 * shift < 3.0, "{noise} {shift}: {longest}");
            }
        }
    }

    #[test]
    fn a_plain_view_shows_nothing() {
        assert!(views(0.0, 0.05, 1.0).is_empty());
    }
}
