//! Synchrony of the two images of a pair.
//!
//! A right image that is late by `tau` shows each point where it was, so that its distance from the epipolar line of the left point is
//! `e = -tau u`, where `u` is the speed across that line at which it moves in the image. A wrong calibration moves points off their lines as
//! well, but has nothing to do with how they move: the slope of `e` over `u` is that of time alone.
//!
//! A camera that repeats an image may be late by a frame from then on: it is on probation, and its images are not used, until the points that
//! move show that the pair is in step. Nor are those of the camera that is late.

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
/// A pair is in step if its delay is known this well, s, and less than so many standard deviations, after so many frames.
const PROVES_S: f64 = 3e-3;
const PROVES_SIGMAS: f64 = 3.0;
const FRAMES_TO_PROVE: f64 = 5.0;
/// A probation lasts no longer, s: what does not move harms nothing.
const PROBATION_S: f64 = 5.0;
/// Repetitions that follow each other within this time are a habit of the camera, s.
const HABIT_S: f64 = 10.0;
/// Time after a pair whose images see different things, s: most of what is found in both images of such a pair is wrong.
const DISAGREED_S: f64 = 2.0;
/// The right camera.
pub(super) const RIGHT: usize = 1;

/// Regression of distances over speeds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairTime {
    sums: EpipolarMoments,
    frames: f64,
    /// When a camera repeated its image, and which, while the pair has not been found in step since.
    probation: Option<(Timestamp, usize)>,
    /// When a camera was last found in step after it had repeated an image, and which.
    acquitted: Option<(Timestamp, usize)>,
    /// When the cameras last saw different things.
    disagreed: Option<Timestamp>,
    /// When a start first waited for the pair.
    doubted: Option<Timestamp>,
}

impl PairTime {
    /// `camera` repeated its image at `stamp`. One that was found in step after a repetition, not long ago, repeats images by habit.
    pub(super) fn begin_probation(&mut self, stamp: Timestamp, camera: usize) {
        let is_habit = self
            .acquitted
            .is_some_and(|(last, other)| other == camera && stamp.seconds_since(last) < HABIT_S);
        if is_habit {
            self.acquitted = Some((stamp, camera));
        } else if self.probation.is_none_or(|(_, other)| other != camera) {
            (self.sums, self.frames) = Default::default();
            self.probation = Some((stamp, camera));
        }
    }

    /// The cameras see different things at `stamp`; returns whether they begin to.
    pub(super) fn disagree(&mut self, stamp: Timestamp) -> bool {
        let is_new = !self.is_disagreed_at(stamp);
        self.disagreed = Some(stamp);
        is_new
    }

    fn is_disagreed_at(&self, stamp: Timestamp) -> bool {
        self.disagreed.is_some_and(|last| stamp.seconds_since(last) < DISAGREED_S)
    }

    /// Takes the moments of the frame of `stamp`, if it has any.
    pub(super) fn add(&mut self, stamp: Timestamp, moments: Option<EpipolarMoments>, period_s: f64) {
        self.end_probation(stamp);
        let Some(moments) = moments else { return };
        let kept = 1.0 - period_s / MEMORY_S;
        self.frames = self.frames * kept + 1.0;
        self.sums = self.sums.scaled(kept).plus(&moments);
    }

    fn end_probation(&mut self, stamp: Timestamp) {
        let is_in_step = self.frames >= FRAMES_TO_PROVE
            && self.late_s().is_some_and(|(late_s, sigma_s)| {
                sigma_s < PROVES_S && late_s.abs() < LEAST_S.at_least(PROVES_SIGMAS * sigma_s)
            });
        if let Some((since, camera)) = self.probation
            && (is_in_step || stamp.seconds_since(since) > PROBATION_S)
        {
            self.probation = None;
            self.acquitted = is_in_step.then_some((stamp, camera));
        }
    }

    /// Camera whose image of the frame of `stamp` is not used; the right one of a pair that sees different things only if the left one sees enough
    /// (`left_sees`), since a covered lens makes such a pair too.
    pub(super) fn distrusted_at(&self, stamp: Timestamp, left_sees: bool) -> Option<usize> {
        let is_other = left_sees && self.is_disagreed_at(stamp);
        self.late_camera().or(self.probation.map(|(_, camera)| camera)).or(is_other.then_some(RIGHT))
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
            watch.add(Timestamp::default(), Some(moments), 0.05);
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
        let at = Timestamp::default();
        let left_out = [0.05, -0.05, 0.0].map(|late_s| watched(late_s, 0.8).distrusted_at(at, true));
        assert_eq!(left_out, [Some(RIGHT), Some(0), None]);
    }

    #[test]
    fn a_camera_that_repeats_an_image_is_left_out_until_it_is_in_step() {
        let seconds = |s: f64| Timestamp::default().plus_seconds(s);
        for camera in [0, 1] {
            let mut watch = watched(0.0, 0.0);
            watch.begin_probation(seconds(0.0), camera);
            let moving = EpipolarMoments { speed: 0.0, off: 0.0, speed_squared: 3600.0, product: 0.0 };
            let ended_s = (1..200).map(|k| 0.05 * f64::from(k)).find(|s| {
                watch.add(seconds(*s), Some(moving), 0.05);
                watch.distrusted_at(seconds(*s), true) != Some(camera)
            });
            assert!((0.2..1.0).contains(&ended_s.unwrap()), "{ended_s:?}");
            watch.begin_probation(seconds(5.0), camera);
            assert_eq!(watch.distrusted_at(seconds(5.0), true), None, "a habit");
            watch.begin_probation(seconds(20.0), camera);
            watch.add(seconds(24.0), None, 0.05);
            assert_eq!(watch.distrusted_at(seconds(24.0), true), Some(camera), "nothing moves");
            watch.add(seconds(25.1), None, 0.05);
            assert_eq!(watch.distrusted_at(seconds(25.1), true), None);
        }
    }

    #[test]
    fn a_camera_that_repeats_images_all_the_time_is_soon_found_in_step() {
        let seconds = |s: f64| Timestamp::default().plus_seconds(s);
        let mut watch = PairTime::default();
        let moving = EpipolarMoments { speed: 0.0, off: 0.0, speed_squared: 3600.0, product: 0.0 };
        let left_out = (0..100).filter(|k| {
            let stamp = seconds(0.05 * f64::from(*k));
            let moments = match k % 5 {
                0 => {
                    watch.begin_probation(stamp, RIGHT);
                    None
                }
                _ => Some(moving),
            };
            watch.add(stamp, moments, 0.05);
            watch.distrusted_at(stamp, true).is_some()
        });
        assert!(left_out.count() < 20);
    }

    #[test]
    fn the_right_camera_is_left_out_while_both_see_different_things() {
        let seconds = |s: f64| Timestamp::default().plus_seconds(s);
        let mut watch = PairTime::default();
        assert!(watch.disagree(seconds(0.0)) && !watch.disagree(seconds(0.05)));
        assert_eq!([2.0, 2.1].map(|s| watch.distrusted_at(seconds(s), true)), [Some(RIGHT), None]);
        assert!(watch.disagree(seconds(3.0)));
        // The clock is set back by an hour.
        watch.clear();
        assert_eq!(watch.distrusted_at(seconds(-3600.0), true), None);
    }

    #[test]
    fn a_camera_that_looks_too_low_is_not_late() {
        assert!(!watched(0.0, 2.0).is_out_of_step() && !watched(5e-4, -2.0).is_out_of_step());
        assert!(!PairTime::default().is_out_of_step());
    }
}
