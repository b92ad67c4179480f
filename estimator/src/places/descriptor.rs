//! Binary descriptors of image patches, 256 bits: comparisons of intensity at pairs of places (BRIEF, Calonder et al.
//! 2010), with the patch turned and sized by the caller.
//!
//! The pairs are drawn once from a Gaussian about the centre of the patch, from a fixed seed: part of the map format.
//! Intensities are read from the pyramid level whose pixels are about an eighth of the patch's radius, which does the
//! smoothing that BRIEF asks for, so no image is filtered or copied for it.

use crate::image::Pyramid;
use nalgebra::Vector2;
use plumbline_config::Random;

/// Bits of a descriptor.
pub const BITS: usize = 256;
/// Names the pairs: another seed makes other descriptors, and maps of one do not fit the other.
const PATTERN_SEED: u64 = 0x706c_756d_6221;
/// Standard deviation of the places of a pair, in radii of the patch.
const PATTERN_SIGMA: f64 = 0.4;

/// 256 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Descriptor(pub [u64; 4]);

impl Descriptor {
    /// Number of bits in which two descriptors differ.
    #[inline]
    pub fn distance(&self, other: &Self) -> u32 {
        let [a, b, c, d] = self.0;
        let [e, f, g, h] = other.0;
        (a ^ e).count_ones() + (b ^ f).count_ones() + (c ^ g).count_ones() + (d ^ h).count_ones()
    }

    /// Bytes, the lowest first.
    pub fn bytes(&self) -> [u8; BITS / 8] {
        let mut bytes = [0; BITS / 8];
        for (to, word) in bytes.chunks_exact_mut(8).zip(self.0) {
            to.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }
}

/// Position, size and orientation of a patch in the image.
#[derive(Clone, Copy, Debug)]
pub struct PatchFrame {
    /// Centre, px of the full-size image.
    pub px: Vector2<f32>,
    /// Radius, px of the full-size image.
    pub radius_px: f32,
    /// Unit vector in the image that counts as up; `(0, -1)` for an upright patch.
    pub up: Vector2<f32>,
}

/// The pairs of places that are compared.
#[derive(Clone, Debug)]
pub struct Pattern {
    pairs: Vec<[f32; 4]>,
}

impl Default for Pattern {
    /// The one pattern there is.
    fn default() -> Self {
        let mut random = Random::new(PATTERN_SEED);
        let mut place = || loop {
            let (x, y) = (random.gaussian() * PATTERN_SIGMA, random.gaussian() * PATTERN_SIGMA);
            if x * x + y * y <= 1.0 {
                return [x as f32, y as f32];
            }
        };
        let pairs = (0..BITS).map(|_| {
            let ([ax, ay], [bx, by]) = (place(), place());
            [ax, ay, bx, by]
        });
        Self { pairs: pairs.collect() }
    }
}

impl Pattern {
    /// Describes a patch; `None` when it leaves the image.
    #[must_use]
    pub fn describe(&self, pyramid: &Pyramid, patch: &PatchFrame) -> Option<Descriptor> {
        let level = level_for(pyramid, patch.radius_px);
        let plane = pyramid.plane(level);
        let scale = 1.0 / (1u32 << level) as f32;
        let centre = patch.px * scale + Vector2::repeat(plane.origin as f32);
        let radius = patch.radius_px * scale;
        // Written so that a NaN fails. One pixel is for the interpolation.
        let inside = centre.x >= radius
            && centre.y >= radius
            && centre.x + radius + 1.5 < plane.columns as f32
            && centre.y + radius + 1.5 < plane.rows as f32;
        if !inside {
            return None;
        }
        // The pattern's (0, -1) becomes `up`.
        let (cos, sin) = (-patch.up.y * radius, patch.up.x * radius);
        let value = |x: f32, y: f32| {
            let (u, v) = (centre.x + cos * x - sin * y, centre.y + sin * x + cos * y);
            let (column, row) = (u as usize, v as usize);
            let (fx, fy) = (u - column as f32, v - row as f32);
            let at = row * plane.columns + column;
            let [a, b] = [plane.pixels[at], plane.pixels[at + 1]].map(f32::from);
            let below = at + plane.columns;
            let [c, d] = [plane.pixels[below], plane.pixels[below + 1]].map(f32::from);
            let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
            top + fy * (bottom - top)
        };
        let mut bits = [0u64; 4];
        for (i, [ax, ay, bx, by]) in self.pairs.iter().enumerate() {
            bits[i / 64] |= u64::from(value(*ax, *ay) < value(*bx, *by)) << (i % 64);
        }
        Some(Descriptor(bits))
    }
}

/// The level whose pixels are at most an eighth of the patch's radius, and smoothed at least once.
fn level_for(pyramid: &Pyramid, radius_px: f32) -> usize {
    let mut level = 0;
    let mut pixel = 2.0;
    while level + 1 < pyramid.level_count() && pixel <= radius_px / 8.0 {
        level += 1;
        pixel *= 2.0;
    }
    level
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::synthetic::Texture;
    use plumbline_config::GrayImage;

    const UPRIGHT: Vector2<f32> = Vector2::new(0.0, -1.0);

    /// The texture seen turned by `angle` and grown by `scale` about (100, 90), brightened.
    fn seen(texture: &Texture, angle: f64, scale: f64) -> Pyramid {
        let mut image = GrayImage::new(200, 180);
        for (i, p) in image.pixels_mut().iter_mut().enumerate() {
            let (x, y) = ((i % 200) as f64 - 100.0, (i / 200) as f64 - 90.0);
            let (x, y) = (x / scale, y / scale);
            let (u, v) = (angle.cos() * x + angle.sin() * y, -angle.sin() * x + angle.cos() * y);
            *p = (0.8 * texture.at(100.0 + u, 90.0 + v) + 20.0).clamp(0.0, 255.0) as u8;
        }
        let mut pyramid = Pyramid::new(200, 180, 3);
        assert!(pyramid.build(&image.view()));
        pyramid
    }

    fn describe(pyramid: &Pyramid, radius_px: f32, up: Vector2<f32>) -> Descriptor {
        let patch = PatchFrame { px: Vector2::new(100.0, 90.0), radius_px, up };
        Pattern::default().describe(pyramid, &patch).unwrap()
    }

    #[test]
    fn a_patch_turned_and_grown_is_recognized_when_turn_and_size_are_known() {
        for seed in 0..5 {
            let texture = Texture::new(seed);
            let reference = describe(&seen(&texture, 0.0, 1.0), 24.0, UPRIGHT);
            let (angle, scale) = (0.7, 1.5);
            let turned = seen(&texture, angle, scale);
            let up = Vector2::new(angle.sin() as f32, -angle.cos() as f32);
            let known = reference.distance(&describe(&turned, 36.0, up));
            let unknown = reference.distance(&describe(&turned, 24.0, UPRIGHT));
            assert!(known < 30 && unknown > known + 25, "{known} {unknown}");
        }
    }

    #[test]
    fn different_patches_differ_in_about_half_of_their_bits() {
        let mut sum = 0;
        for seed in 0..20 {
            let [a, b] =
                [seed, seed + 100].map(|s| describe(&seen(&Texture::new(s), 0.0, 1.0), 24.0, UPRIGHT));
            sum += a.distance(&b);
        }
        assert!((100..156).contains(&(sum / 20)), "{}", sum / 20);
    }

    #[test]
    fn a_patch_that_leaves_the_image_has_no_descriptor() {
        let pyramid = seen(&Texture::new(1), 0.0, 1.0);
        for px in [Vector2::new(-30.0, 90.0), Vector2::new(100.0, f32::NAN), Vector2::new(240.0, 90.0)] {
            let patch = PatchFrame { px, radius_px: 24.0, up: UPRIGHT };
            assert!(Pattern::default().describe(&pyramid, &patch).is_none());
        }
        let patch = PatchFrame { px: Vector2::new(100.0, 90.0), radius_px: f32::NAN, up: UPRIGHT };
        assert!(Pattern::default().describe(&pyramid, &patch).is_none());
    }
}
