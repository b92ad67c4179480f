//! Noise of an image: what a small patch differs by from a smooth one.
//!
//! The mask `[1 -2 1; -2 4 -2; 1 -2 1]` is blind to planes and edges along the axes (Immerkær 1996, "Fast noise variance
//! estimation"); of white noise of standard deviation `s` it makes values of `6 s`. Texture makes larger ones in places, so the lowest
//! quarter of the values is looked at, on a grid of every fourth pixel.

use super::{Plane, Pyramid};

/// Pixels between those that are looked at, in both directions.
const STEP: usize = 4;
/// Values from which on they are counted as one.
const MOST: usize = 256;
/// Values that are worked out together.
const BLOCK: usize = 64;
/// A quarter of the values of a normal distribution lies within this many standard deviations.
const QUARTER_SIGMAS: f32 = 0.3186;
/// Standard deviation of the mask's values in white noise of one grey level.
const GAIN: f32 = 6.0;

/// An image is noisy from the first of these on, until it is below the second, grey levels: good cameras by day have 1 to 2, those by
/// night 4 and more.
const NOISY: (f32, f32) = (3.85, 3.7);
/// Fine texture (bricks in small images) makes values as large. On the next level of the pyramid half of them and more is left, where a
/// quarter is left of white noise: there is less than this share.
const MAX_SHARE: f32 = 0.35;

/// One image of so many is looked at: light changes more slowly, and a look costs as many instructions as the pyramid.
const LOOK_EVERY: u32 = 8;

/// Detection of noisy images of a camera.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoiseWatch {
    is_noisy: bool,
    /// Images since the last one that was looked at.
    since: u32,
}

impl NoiseWatch {
    /// Judges this image by the first two levels of its pyramid, or repeats the verdict on one shortly
    /// before.
    pub fn is_noisy(&mut self, image: &Pyramid) -> bool {
        let is_due = self.since == 0;
        self.since = (self.since + 1) % LOOK_EVERY;
        if is_due {
            self.look(image);
        }
        self.is_noisy
    }

    fn look(&mut self, image: &Pyramid) {
        let limit = if self.is_noisy { NOISY.1 } else { NOISY.0 };
        let sigma = noise_sigma(&image.plane(0));
        self.is_noisy =
            image.level_count() > 1 && sigma > limit && noise_sigma(&image.plane(1)) < MAX_SHARE * sigma;
    }
}

/// Standard deviation of the noise of a plane with a rim, grey levels; 0 where it is too small to tell.
pub fn noise_sigma(plane: &Plane<'_>) -> f32 {
    let (columns, rim) = (plane.columns, plane.origin);
    let mut counts = [0u32; MOST];
    let mut all = 0;
    // Each pixel that is looked at with those beside it and one more: a word.
    let words = columns.saturating_sub(2 * rim + 2).div_ceil(STEP);
    for y in (rim + 1..plane.rows.saturating_sub(rim + 1)).step_by(STEP) {
        let rows = [y - 1, y, y + 1].map(|y| &plane.pixels[y * columns + rim..][..STEP * words]);
        let [above, here, below] = rows.map(|row| row.as_chunks::<STEP>().0.chunks(BLOCK));
        for ((above, here), below) in above.zip(here).zip(below) {
            let mut values = [0u8; BLOCK];
            let n = above.len().min(BLOCK);
            let (here, below) = (&here[..n], &below[..n]);
            for i in 0..n {
                let [above, here, below] = [above[i], here[i], below[i]].map(second);
                values[i] = (above - 2 * here + below).unsigned_abs().min(MOST as u32 - 1) as u8;
            }
            values[..n].iter().for_each(|value| counts[usize::from(*value)] += 1);
            all += n as u32;
        }
    }
    quantile(&counts, all / 4) / (QUARTER_SIGMAS * GAIN)
}

/// Second difference of the first three of four pixels.
#[inline(always)]
fn second(pixels: [u8; STEP]) -> i32 {
    let word = u32::from_le_bytes(pixels);
    let [left, middle, right] = [0, 8, 16].map(|shift| (word >> shift & 0xFF) as i32);
    left - 2 * middle + right
}

/// The value below which `wanted` of the counted lie, between whole numbers by the share of the one that it falls into.
fn quantile(counts: &[u32; MOST], wanted: u32) -> f32 {
    let mut below = 0;
    for (value, count) in counts.iter().enumerate() {
        if below + count > wanted {
            // A count of zero stands for absolute values below a half.
            let (start, width) = if value == 0 { (0.0, 0.5) } else { (value as f32 - 0.5, 1.0) };
            return start + width * (wanted - below) as f32 / *count as f32;
        }
        below += count;
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::pyramid::Smoothing;
    use plumbline_config::{GrayImage, Random};

    /// A pyramid of an image of 240 x 160 px by a function of its pixels.
    fn pyramid(pixel: impl FnMut(usize) -> f64) -> Pyramid {
        let pixels = (0..240 * 160).map(pixel).map(|grey| grey.round().clamp(0.0, 255.0) as u8);
        let mut pyramid = Pyramid::new(240, 160, 3);
        assert!(pyramid.build(&GrayImage::from_pixels(240, 160, pixels.collect()).unwrap().view()));
        pyramid
    }

    #[test]
    fn noise_is_measured_over_a_slope_and_a_flat_image_has_none() {
        let mut random = Random::new(1);
        for (sigma, slope) in [(1.5, 0.0), (4.0, 0.3), (8.0, 0.0)] {
            let image = pyramid(|k| 100.0 + slope * (k % 240) as f64 + sigma * random.gaussian());
            let found = f64::from(noise_sigma(&image.plane(0)));
            assert!((found - sigma).abs() < 0.1 * sigma, "{found} for {sigma}");
        }
        assert!(noise_sigma(&pyramid(|_| 90.0).plane(0)) < 0.3);
    }

    #[test]
    fn smoothing_leaves_a_quarter_of_the_noise() {
        let mut random = Random::new(2);
        let mut image = pyramid(|_| 100.0 + 8.0 * random.gaussian());
        let before = noise_of(&image);
        image.smooth(&mut Smoothing::new(240, 160));
        let share = noise_of(&image) / before;
        assert!((0.25..0.3).contains(&share), "{share}");
    }

    /// Standard deviation of the grey levels of an image without texture.
    fn noise_of(image: &Pyramid) -> f64 {
        let plane = image.plane(0);
        let rows = (plane.origin..plane.rows - plane.origin).map(|y| y * plane.columns + plane.origin);
        let grey: Vec<f64> =
            rows.flat_map(|start| plane.pixels[start..start + 240].iter().map(|x| f64::from(*x))).collect();
        let mean = grey.iter().sum::<f64>() / grey.len() as f64;
        (grey.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / grey.len() as f64).sqrt()
    }

    #[test]
    fn fine_texture_is_no_noise() {
        let mut random = Random::new(3);
        let noisy = pyramid(|_| 100.0 + 6.0 * random.gaussian());
        // White noise through `[1 2 1] / 4` in both directions: grains of two pixels.
        let white: Vec<f64> = (0..242 * 162).map(|_| 80.0 * random.gaussian()).collect();
        let across = |at: usize| white[at] + 2.0 * white[at + 1] + white[at + 2];
        let grainy = pyramid(|k| {
            let at = k / 240 * 242 + k % 240;
            128.0 + (across(at) + 2.0 * across(at + 242) + across(at + 484)) / 16.0
        });
        assert!(noise_sigma(&grainy.plane(0)) > NOISY.0);
        assert!(NoiseWatch::default().is_noisy(&noisy) && !NoiseWatch::default().is_noisy(&grainy));
    }
}
