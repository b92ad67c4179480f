//! Images that repeat: a camera that delivers the same pixels again has not looked.
//!
//! The noise of a camera changes some grey level of every image. So an image is a repetition if a grid of some thousand
//! pixels is bit for bit that of the image before. The grid is compared until its first difference.

use plumbline_config::{ImageView, ValidSetup};

/// Every pixel of so many in a row, and every row of so many, are compared.
const STEP_U: usize = 8;
const STEP_V: usize = 16;

/// Remembers the last image of each camera by a grid of its pixels.
#[derive(Clone, Debug)]
pub struct FrozenWatch {
    is_on: bool,
    grids: [Vec<u8>; 2],
    has_image: [bool; 2],
}

impl FrozenWatch {
    /// A watch for the cameras of a setup.
    pub fn new(setup: &ValidSetup) -> Self {
        let grid = |k: usize| {
            let size = |c: &plumbline_config::options::CameraConfig| {
                c.width_px.div_ceil(STEP_U) * c.height_px.div_ceil(STEP_V)
            };
            vec![0; setup.camera.get(k).map_or(0, size)]
        };
        Self {
            is_on: setup.estimator.health.refuse_repeated_images,
            grids: [grid(0), grid(1)],
            has_image: [false; 2],
        }
    }

    /// Takes an image of `camera`, of its configured size; returns whether it repeats the one before.
    pub fn is_repeated(&mut self, camera: usize, image: &ImageView<'_>) -> bool {
        if !self.is_on {
            return false;
        }
        let columns = image.width().div_ceil(STEP_U);
        let mut is_same = self.has_image[camera];
        for (kept, v) in self.grids[camera].chunks_exact_mut(columns).zip((0..image.height()).step_by(STEP_V))
        {
            let pixels = image.row(v).iter().step_by(STEP_U);
            is_same = is_same && kept.iter().eq(pixels.clone());
            if !is_same {
                kept.iter_mut().zip(pixels).for_each(|(kept, pixel)| *kept = *pixel);
            }
        }
        self.has_image[camera] = true;
        is_same
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::odometry::synthetic::config;
    use plumbline_config::GrayImage;

    fn image(seed: usize) -> GrayImage {
        let mut image = GrayImage::new(752, 480);
        image.pixels_mut().iter_mut().enumerate().for_each(|(k, p)| *p = (k * (seed + 7) % 251) as u8);
        image
    }

    #[test]
    fn an_image_that_comes_again_is_a_repetition_and_each_camera_has_its_own() {
        let mut watch = FrozenWatch::new(&config(2));
        let (a, b) = (image(1), image(2));
        let said = [(0, &a), (1, &a), (0, &a), (0, &b), (1, &a), (0, &a)]
            .map(|(camera, image)| watch.is_repeated(camera, &image.view()));
        assert_eq!(said, [false, false, true, false, true, false]);
    }

    #[test]
    fn one_grey_level_of_the_grid_is_a_difference() {
        let mut watch = FrozenWatch::new(&config(1));
        let mut seen = image(1);
        assert!(!watch.is_repeated(0, &seen.view()));
        seen.pixels_mut()[752 * 16 * 29 + 8 * 90] ^= 1;
        assert!(!watch.is_repeated(0, &seen.view()) && watch.is_repeated(0, &seen.view()));
    }
}
