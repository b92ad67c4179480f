//! Synchrony of the two images of a pair.
//!
//! A right image that is late by `tau` shows each point where it was, so that its distance from the epipolar line of the left point is
//! `e = -tau u`, where `u` is the speed across that line at which it moves in the image. A wrong calibration moves points off their lines as
//! well, but has nothing to do with how they move: the slope of `e` over `u` is that of time alone.

use crate::window::epipolar::EpipolarMoments;
use plumbline_config::Portable;

/// Time for which pairs are remembered, s.
const MEMORY_S: f64 = 2.0;
/// Standard deviation of the mean of a frame's distances, px: several times that of clean and of recorded flights.
const FRAME_SIGMA_PX: f64 = 0.15;
/// A delay shows from this many standard deviations, and from this length, s. Sound flights stay below 0.2 ms; of a pair that is late by a
/// frame a tenth of that is found, since points that move faster are not matched.
const SHOWS_SIGMAS: f64 = 6.0;
const LEAST_S: f64 = 1e-3;
/// Largest quality while the images of a pair are not of the same moment.
const OUT_OF_STEP_QUALITY: i8 = 10;

/// Regression of distances over speeds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairTime {
    sums: EpipolarMoments,
    frames: f64,
}

impl PairTime {
    /// Takes the moments of a frame, if it has any.
    pub(super) fn add(&mut self, moments: Option<EpipolarMoments>, period_s: f64) {
        let Some(moments) = moments else { return };
        let kept = 1.0 - period_s / MEMORY_S;
        self.frames = self.frames * kept + 1.0;
        self.sums = self.sums.scaled(kept).plus(&moments);
    }

    /// Forgets all pairs.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Delay of the right image, s, with its standard deviation; `None` while too few points have moved.
    fn late_s(&self) -> Option<(f64, f64)> {
        let EpipolarMoments { speed, off, speed_squared, product } = self.sums;
        let spread = speed_squared - speed * speed / self.frames;
        let slope = (product - speed * off / self.frames) / spread;
        (self.frames > 5.0 && spread > 0.0).then(|| (-slope, FRAME_SIGMA_PX / spread.sqrt()))
    }

    /// True if the images of a pair are of different moments.
    pub(super) fn is_out_of_step(&self) -> bool {
        self.late_s().is_some_and(|(late_s, sigma_s)| late_s.abs() > LEAST_S.at_least(SHOWS_SIGMAS * sigma_s))
    }

    /// The quality of an estimate that would have `quality` if they were of the same.
    pub(super) fn bounded(&self, quality: i8) -> i8 {
        if self.is_out_of_step() { quality.min(OUT_OF_STEP_QUALITY) } else { quality }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of pairs whose right image is late, of a rig whose right camera looks too low by `low_px`.
    fn watched(late_s: f64, low_px: f64) -> PairTime {
        let mut watch = PairTime::default();
        for k in 0..200 {
            let speeds = [-1.0, 0.0, 1.0].map(|x| 60.0 * libm::sin(0.1 * f64::from(k)) + 10.0 * x);
            let noise = 0.1 * libm::sin(f64::from(k * k));
            let mean = |f: &dyn Fn(f64) -> f64| speeds.iter().map(|u| f(*u)).sum::<f64>() / 3.0;
            let off = |u: f64| low_px - late_s * u + noise;
            let moments = EpipolarMoments {
                speed: mean(&|u| u),
                off: mean(&off),
                speed_squared: mean(&|u| u * u),
                product: mean(&|u| u * off(u)),
            };
            watch.add(Some(moments), 0.05);
        }
        watch
    }

    #[test]
    fn a_right_image_that_is_late_or_early_is_found() {
        for late_s in [0.05, -0.05, 0.015] {
            let watch = watched(late_s, 0.8);
            let (found, sigma) = watch.late_s().expect("points move");
            assert!(watch.is_out_of_step() && (found - late_s).abs() < 3.0 * sigma, "{late_s}: {found}");
            assert_eq!(watch.bounded(90), OUT_OF_STEP_QUALITY);
        }
    }

    #[test]
    fn a_camera_that_looks_too_low_is_not_late() {
        assert!(!watched(0.0, 2.0).is_out_of_step() && !watched(5e-4, -2.0).is_out_of_step());
        assert!(!PairTime::default().is_out_of_step());
    }
}
