//! Detection of poor images: dark, without texture, or blocked by something near.
//!
//! Every eighth frame a coarse level of the pyramids is looked at, where noise is gone. It is divided into tiles; a tile is empty if
//! its grey levels differ by next to nothing from those two pixels away. What holds for three looks is reported.
//! A near thing before one lens hides from one camera what the other one sees. No estimate depends on any of it.

use super::Pyramid;

/// One frame of so many is looked at: light and scene change more slowly.
const LOOK_EVERY: u32 = 8;
/// Looks in a row after which a condition is reported: a second and a bit at 20 frames a second.
const LOOKS_TO_TELL: u32 = 3;
/// Level of the pyramid that is looked at, or the coarsest.
const LEVEL: usize = 2;
/// Tiles in a row, rows of tiles.
const TILES: (usize, usize) = (8, 6);
/// Number of tiles.
const COUNT: usize = TILES.0 * TILES.1;
/// Pixels between those that are compared, and between those that are looked at.
const LAG: usize = 2;
/// Tenths of a grey level: a tile is empty below the first of these mean differences, and has texture from the second on.
const EMPTY: u32 = 12;
const TEXTURE: u32 = 30;
/// Grey levels below this are dark: texture of a twentieth of the light is within the noise of the camera.
const DARK_LEVEL: u8 = 16;
/// An image is dark if no more pixels than one in so many are not.
const DARK_REST: u32 = 10;
/// Share of the tiles, in percent, that one camera does not see and the other one does, where something is before a lens.
const BLOCKED_PERCENT: usize = 25;
/// Share of the tiles, in percent, that are empty where there is little texture.
const PLAIN_PERCENT: usize = 85;

/// Findings in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Look {
    is_dark: bool,
    /// Mean difference of grey levels in each tile, tenths of a level.
    activity: [u32; COUNT],
}

impl Look {
    fn at(image: &Pyramid) -> Self {
        let level = LEVEL.min(image.level_count() - 1);
        let (width, height) = image.size(level);
        let plane = image.plane(level);
        let (mut sums, mut counts, mut bright) = ([0; COUNT], [0; COUNT], 0);
        for v in (0..height.saturating_sub(LAG)).step_by(LAG) {
            let row = |v: usize| &plane.pixels[(v + plane.origin) * plane.columns + plane.origin..];
            let (here, below) = (row(v), row(v + LAG));
            let first = v * TILES.1 / height * TILES.0;
            for u in (0..width.saturating_sub(LAG)).step_by(LAG) {
                let level = here[u];
                let tile = first + u * TILES.0 / width;
                sums[tile] += u32::from(level.abs_diff(here[u + LAG])) + u32::from(level.abs_diff(below[u]));
                counts[tile] += 2;
                bright += u32::from(level >= DARK_LEVEL);
            }
        }
        let all: u32 = counts.iter().sum::<u32>() / 2;
        let activity = std::array::from_fn(|k| 10 * sums[k] / counts[k].max(1));
        Self { is_dark: DARK_REST * bright < all, activity }
    }

    fn empty(&self) -> usize {
        self.activity.iter().filter(|activity| **activity < EMPTY).count()
    }

    /// Tiles that are empty here and have texture in `other`.
    fn hidden_from(&self, other: &Self) -> usize {
        let pairs = self.activity.iter().zip(&other.activity);
        pairs.filter(|(here, there)| **here < EMPTY && **there >= TEXTURE).count()
    }
}

/// Poor image conditions that have lasted for a while.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Condition {
    /// Nearly black.
    pub is_dark: bool,
    /// Hardly any texture.
    pub is_plain: bool,
    /// Something is before the lens of one camera.
    pub is_blocked: bool,
}

/// Follows the condition of the images.
#[derive(Clone, Debug, Default)]
pub struct ConditionWatch {
    /// Frames since the last that was looked at.
    since: u32,
    /// Looks in a row for which the images were dark, without texture and blocked.
    looks: [u32; 3],
}

impl ConditionWatch {
    /// Takes the newest images, left and right, where there are any.
    pub fn update(&mut self, images: [Option<&Pyramid>; 2]) -> Condition {
        let is_due = self.since == 0;
        self.since = (self.since + 1) % LOOK_EVERY;
        if is_due {
            let found = judge(images.map(|image| image.map(Look::at)));
            for (looks, is_so) in self.looks.iter_mut().zip(found) {
                *looks = if is_so { looks.saturating_add(1) } else { 0 };
            }
        }
        let [is_dark, is_plain, is_blocked] = self.looks.map(|looks| looks >= LOOKS_TO_TELL);
        Condition { is_dark, is_plain, is_blocked }
    }
}

/// Verdicts on the images: dark, without texture, blocked.
fn judge(looks: [Option<Look>; 2]) -> [bool; 3] {
    let there = || looks.iter().flatten();
    let is_dark = there().next().is_some() && there().all(|look| look.is_dark);
    let is_bare =
        !is_dark && there().next().is_some() && there().all(|l| 100 * l.empty() >= PLAIN_PERCENT * COUNT);
    let is_blocked = match &looks {
        [Some(left), Some(right)] => {
            100 * left.hidden_from(right).max(right.hidden_from(left)) >= BLOCKED_PERCENT * COUNT
        }
        _ => false,
    };
    [is_dark, is_bare, is_blocked]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::synthetic::Texture;
    use plumbline_config::{GrayImage, Random};

    const SIZE: (usize, usize) = (376, 240);

    fn pyramid(image: &GrayImage) -> Pyramid {
        let mut pyramid = Pyramid::new(SIZE.0, SIZE.1, 3);
        assert!(pyramid.build(&image.view()));
        pyramid
    }

    /// A textured image, changed by a function of column and grey level.
    fn image(change: impl Fn(usize, f64) -> f64) -> GrayImage {
        let mut image = Texture::new(4).render(SIZE.0, SIZE.1);
        for (k, pixel) in image.pixels_mut().iter_mut().enumerate() {
            *pixel = change(k % SIZE.0, f64::from(*pixel)).round().clamp(0.0, 255.0) as u8;
        }
        image
    }

    const DARK: Condition = Condition { is_dark: true, is_plain: false, is_blocked: false };
    const PLAIN: Condition = Condition { is_dark: false, is_plain: true, is_blocked: false };
    const BLOCKED: Condition = Condition { is_dark: false, is_plain: false, is_blocked: true };

    /// The condition after `frames` frames of the same images.
    fn told(images: [Option<&GrayImage>; 2], frames: u32) -> Condition {
        let pyramids = images.map(|image| image.map(pyramid));
        let mut watch = ConditionWatch::default();
        let mut condition = Condition::default();
        for _ in 0..frames {
            condition = watch.update(pyramids.each_ref().map(Option::as_ref));
        }
        condition
    }

    #[test]
    fn clear_images_are_not_reported() {
        let [left, right] = [image(|_, grey| grey), image(|_, grey| 0.7 * grey)];
        assert_eq!(told([Some(&left), Some(&right)], 100), Condition::default());
        assert_eq!(told([Some(&left), None], 100), Condition::default());
        assert_eq!(told([None, None], 100), Condition::default());
    }

    #[test]
    fn a_twentieth_of_the_light_is_dark_after_three_looks() {
        let noise = std::cell::RefCell::new(Random::new(1));
        let night = image(|_, grey| 0.05 * grey + 4.0 * noise.borrow_mut().gaussian());
        assert_eq!(told([Some(&night), Some(&night)], 16), Condition::default());
        assert_eq!(told([Some(&night), Some(&night)], 17), DARK);
        let day = image(|_, grey| grey);
        assert_eq!(told([Some(&night), Some(&day)], 40), BLOCKED, "one camera sees");
    }

    #[test]
    fn plain_walls_have_little_texture() {
        let wall = image(|u, _| 120.0 + 0.1 * u as f64);
        assert_eq!(told([Some(&wall), Some(&wall)], 20), PLAIN);
        let half = image(|u, grey| if u < 190 { 120.0 } else { grey });
        assert_eq!(told([Some(&half), Some(&half)], 20), Condition::default(), "half a wall");
    }

    #[test]
    fn a_thing_before_one_lens_is_reported() {
        let seen = image(|_, grey| grey);
        let covered = image(|u, grey| if u < 190 { 60.0 + 0.1 * u as f64 } else { grey });
        for pair in [[Some(&covered), Some(&seen)], [Some(&seen), Some(&covered)]] {
            assert_eq!(told(pair, 20), BLOCKED);
        }
        let corner = image(|u, grey| if u < 70 { 60.0 } else { grey });
        assert_eq!(told([Some(&corner), Some(&seen)], 20), Condition::default(), "a corner");
    }
}
