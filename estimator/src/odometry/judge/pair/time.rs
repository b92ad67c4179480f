//! Synchrony of the two images of a pair.
//!
//! A right image that is late by `tau` shows each point where it was, so that its distance from the epipolar line of the left point is
//! `e = -tau u`, where `u` is the speed across that line at which it moves in the image. A wrong calibration moves points off their lines as
//! well, but has nothing to do with how they move: the slope of `e` over `u` is that of time alone. Images of the camera that is late are not used.

use crate::window::epipolar::EpipolarMoments;
use plumbline_config::{Portable, Timestamp};

/// Time for which pairs are remembered, s.
const MEMORY_S: f64 = 2.0;
/// Standard deviation of the mean of a frame's distances, px: several times that of clean and of recorded flights.
const FRAME_SIGMA_PX: f64 = 0.15;
/// A delay shows from this many standard deviations, and from this length, s. Sound flights stay below 0.2 ms; of a pair that is late by a
/// frame a tenth of that is found, since points that move faster are not matched.
const SHOWS_SIGMAS: f64 = 6.0;
const LEAST_S: f64 = 1e-3;
/// Frames that tell a delay.
const FRAMES_TO_SHOW: f64 = 1.5;
/// A start waits for so long, s, while a delay of this many standard deviations shows (sound starts: 1.2), or while less than this share of
/// the points is found in both images of a pair that moves fast enough to tell a delay to this, s (sound starts: 0.6; a camera that is late:
/// at most 0.5 in its first frames).
const DOUBT_S: f64 = 1.0;
const DOUBT_SIGMAS: f64 = 1.5;
const MIN_SHARED_AT_START: f64 = 0.5;
const MOVES_S: f64 = 0.03;
/// The right camera.
pub(super) const RIGHT: usize = 1;

/// Regression of distances over speeds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairTime {
    sums: EpipolarMoments,
    frames: f64,
    /// When a start first waited for the pair.
    doubted: Option<Timestamp>,
}

impl PairTime {
    /// Takes the moments of a frame, if it has any.
    pub(super) fn add(&mut self, moments: Option<EpipolarMoments>, period_s: f64) {
        let Some(moments) = moments else { return };
        let kept = 1.0 - period_s / MEMORY_S;
        self.frames = self.frames * kept + 1.0;
        self.sums = self.sums.scaled(kept).plus(&moments);
    }

    /// True if a start should wait, at `stamp`, for what the pair will show: `shared` of its `points` are found in both images.
    pub(super) fn delays_start(&mut self, stamp: Timestamp, shared: usize, points: usize) -> bool {
        let delay = self.late_s();
        let is_late =
            delay.is_some_and(|(late_s, sigma_s)| late_s.abs() > LEAST_S.at_least(DOUBT_SIGMAS * sigma_s));
        let moves = delay.is_none_or(|(_, sigma_s)| sigma_s < MOVES_S);
        let is_doubtful = is_late || moves && (shared as f64) < MIN_SHARED_AT_START * points as f64;
        is_doubtful && stamp.seconds_since(*self.doubted.get_or_insert(stamp)) < DOUBT_S
    }

    /// The next start may wait as well.
    pub(super) fn wait_anew(&mut self) {
        self.doubted = None;
    }

    /// The camera that is late.
    pub(super) fn late_camera(&self) -> Option<usize> {
        self.late_s().filter(|_| self.is_out_of_step()).map(|(late_s, _)| usize::from(late_s > 0.0))
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
        (self.frames > FRAMES_TO_SHOW && spread > 0.0).then(|| (-slope, FRAME_SIGMA_PX / spread.sqrt()))
    }

    /// True if the images of a pair are of different moments.
    pub(super) fn is_out_of_step(&self) -> bool {
        self.late_s().is_some_and(|(late_s, sigma_s)| late_s.abs() > LEAST_S.at_least(SHOWS_SIGMAS * sigma_s))
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
        }
    }

    #[test]
    fn the_camera_that_is_late_is_left_out() {
        let late = [0.05, -0.05, 0.0].map(|late_s| watched(late_s, 0.8).late_camera());
        assert_eq!(late, [Some(RIGHT), Some(0), None]);
    }

    #[test]
    fn a_camera_that_looks_too_low_is_not_late() {
        assert!(!watched(0.0, 2.0).is_out_of_step() && !watched(5e-4, -2.0).is_out_of_step());
        assert!(!PairTime::default().is_out_of_step());
    }
}
