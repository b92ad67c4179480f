//! Pixels of a camera that are not looked at, with their surroundings.

use nalgebra::Vector2;
use plumbline_config::options::PixelMask;

/// Mask of the pixels of a camera that are hidden from points or lines.
#[derive(Clone, Debug)]
pub struct ImageMask {
    width: usize,
    height: usize,
    is_hidden: Vec<bool>,
}

impl ImageMask {
    /// Hides what `mask` ignores, and all within `reach_px` of it in either direction: what looks at a pixel looks at those
    /// around it too.
    #[must_use]
    pub fn new(mask: &PixelMask, reach_px: usize) -> Self {
        let (width, height) = mask.size_px();
        let ignored: Vec<bool> = mask.pixels().map(|is_seen| !is_seen).collect();
        let around = |at: usize, size: usize| at.saturating_sub(reach_px)..(at + reach_px + 1).min(size);
        let mut in_rows = vec![false; ignored.len()];
        let mut is_hidden = in_rows.clone();
        for (v, row) in ignored.chunks_exact(width).enumerate() {
            for u in (0..width).filter(|u| row[*u]) {
                in_rows[v * width..][around(u, width)].fill(true);
            }
        }
        for v in 0..height {
            for other in around(v, height) {
                let (to, from) = (v * width, other * width);
                (0..width).for_each(|u| is_hidden[to + u] |= in_rows[from + u]);
            }
        }
        Self { width, height, is_hidden }
    }

    /// True if the pixel at column `u` and row `v` is hidden; false outside of the image.
    pub fn hides(&self, u: usize, v: usize) -> bool {
        u < self.width && v < self.height && self.is_hidden[v * self.width + u]
    }

    /// True if the image at `px` is hidden.
    pub fn hides_px(&self, px: &Vector2<f64>) -> bool {
        // A cast saturates, and takes what is no number for 0.
        let whole = px.map(|x| (x + 0.5) as usize);
        self.hides(whole.x, whole.y)
    }

    /// The mask at half the resolution: a pixel is hidden if one of its four is.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let four = |u: usize, v: usize| [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| (2 * u + a, 2 * v + b));
        let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
        let is_hidden = pixels.map(|(u, v)| four(u, v).iter().any(|(u, v)| self.hides(*u, *v))).collect();
        Self { width, height, is_hidden }
    }

    /// Indices of the hidden pixels, row by row.
    pub fn hidden(&self) -> impl Iterator<Item = usize> {
        self.is_hidden.iter().enumerate().filter(|(_, is_hidden)| **is_hidden).map(|(index, _)| index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ignored_is_hidden_with_its_surroundings() {
        let mask = ImageMask::new(&PixelMask::of(100, 80, |u, v| (u, v) != (50, 40)), 3);
        assert_eq!(mask.hidden().count(), 49);
        assert!(mask.hides(47, 37) && mask.hides(53, 43) && !mask.hides(46, 40) && !mask.hides(50, 44));
        assert!(mask.hides_px(&Vector2::new(53.4, 40.0)) && !mask.hides_px(&Vector2::new(53.6, 40.0)));
        assert!(!mask.hides_px(&Vector2::new(f64::NAN, 1e300)));
    }

    #[test]
    fn one_of_four_hides_a_pixel_of_half_the_resolution() {
        let mask = ImageMask::new(&PixelMask::of(101, 80, |u, v| (u, v) != (51, 41)), 0).halved();
        assert_eq!(mask.hidden().collect::<Vec<_>>(), [20 * 50 + 25]);
    }
}
