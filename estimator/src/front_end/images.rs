//! Which images of a frame are tracked: not those of another size, those that repeat, and those of a covered lens.

use super::FrontEnd;
use crate::estimate::HealthBits;
use crate::input::FrameInput;
use plumbline_config::ImageView;

impl FrontEnd {
    /// The images of a frame that can be used; what is wrong with the others is added to `health`.
    pub(super) fn usable_images<'a>(
        &mut self,
        frame: &FrameInput<'a>,
        health: &mut HealthBits,
    ) -> [Option<ImageView<'a>>; 2] {
        let mut images = [None, None];
        let missing = [HealthBits::LEFT_MISSING, HealthBits::RIGHT_MISSING];
        let frozen = [HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN];
        for camera in 0..self.cameras {
            match frame.images[camera] {
                Some(image) if (image.width(), image.height()) == self.sizes_px[camera] => {
                    if self.frozen.is_repeated(camera, &image) && !is_blank(&image) {
                        health.insert(frozen[camera]);
                    } else {
                        images[camera] = Some(image);
                    }
                }
                Some(_) => health.insert(HealthBits::BAD_IMAGE_SIZE),
                None => health.insert(missing[camera]),
            }
        }
        // A covered lens: the other camera leads, as if this one were silent.
        if let [Some(left), Some(right)] = &images {
            let blank = [is_blank(left), is_blank(right)];
            for camera in 0..2 {
                if blank[camera] && !blank[1 - camera] {
                    images[camera] = None;
                    health.insert(missing[camera]);
                }
            }
        }
        if let (Some(camera), [Some(_), Some(_)]) = (self.untracked_camera, &images) {
            images[camera] = None;
        }
        images
    }
}

/// An image whose grey levels spread by less than this (standard deviation) shows nothing but noise.
const BLANK_SPREAD: f64 = 3.0;
/// One pixel in so many of either direction is looked at.
const BLANK_STEP: usize = 8;

/// True if an image shows nothing.
fn is_blank(image: &ImageView<'_>) -> bool {
    let (mut sum, mut squares, mut count) = (0u64, 0u64, 0u64);
    for v in (0..image.height()).step_by(BLANK_STEP) {
        for pixel in image.row(v).iter().step_by(BLANK_STEP) {
            let level = u64::from(*pixel);
            sum += level;
            squares += level * level;
            count += 1;
        }
    }
    let count = count.max(1) as f64;
    let mean = sum as f64 / count;
    squares as f64 / count - mean * mean < BLANK_SPREAD * BLANK_SPREAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::GrayImage;

    #[test]
    fn a_covered_lens_shows_nothing_and_a_dim_room_shows_something() {
        let image = |level: fn(usize) -> u8| {
            let mut image = GrayImage::new(160, 120);
            image.pixels_mut().iter_mut().enumerate().for_each(|(k, pixel)| *pixel = level(k));
            image
        };
        assert!(is_blank(&image(|_| 0).view()) && is_blank(&image(|_| 200).view()));
        assert!(is_blank(&image(|k| 2 + (k * 7 % 5) as u8).view()), "noise of a dark sensor");
        assert!(!is_blank(&image(|k| 10 + ((k % 160) / 10) as u8).view()), "dim, and there is something");
    }
}
