//! Consistency of the two cameras: if they do not see the same things, their calibration is wrong, or something covers a lens.

use crate::estimate::HealthBits;
use plumbline_config::Portable;

/// Points in view below which nothing is said of the pair.
const MIN_POINTS: usize = 20;
/// A pair of which less than this share of the points is found in both images sees different things. Of sound flights the
/// worst has a third, before a near wall.
const MIN_SHARED: f64 = 0.12;
/// Time for which a disagreement must last before it is reported, s.
const TIME_TO_TELL_S: f64 = 0.75;

/// Follows what the cameras have in common.
#[derive(Clone, Debug)]
pub struct PairWatch {
    cameras: usize,
    frames_to_tell: u32,
    frames: u32,
}

impl PairWatch {
    /// Creates the watch for `cameras` cameras of `rate_hz` frames a second.
    #[must_use]
    pub fn new(cameras: usize, rate_hz: f64) -> Self {
        Self { cameras, frames_to_tell: (TIME_TO_TELL_S * rate_hz).round().at_least(1.0) as u32, frames: 0 }
    }

    /// Forgets what the cameras did not have in common.
    pub fn forget(&mut self) {
        self.frames = 0;
    }

    /// Takes the number of points of a frame, and of those that both cameras see; says so in `health` once the cameras have
    /// disagreed for a while.
    pub fn update(&mut self, points: usize, shared: usize, health: &mut HealthBits) {
        let missing = [
            HealthBits::LEFT_MISSING,
            HealthBits::RIGHT_MISSING,
            HealthBits::LEFT_FROZEN,
            HealthBits::RIGHT_FROZEN,
            HealthBits::BAD_IMAGE_SIZE,
        ];
        let is_pair = self.cameras > 1 && !missing.iter().any(|bit| health.contains(*bit));
        let disagree = is_pair && points >= MIN_POINTS && (shared as f64) < MIN_SHARED * points as f64;
        self.frames = if disagree { self.frames.saturating_add(1) } else { 0 };
        if self.frames >= self.frames_to_tell {
            health.insert(HealthBits::CAMERAS_DISAGREE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames until it is told of, out of a hundred.
    fn told_after(cameras: usize, points: usize, shared: usize, missing: HealthBits) -> Option<u32> {
        let mut watch = PairWatch::new(cameras, 20.0);
        (1..=100).find(|_| {
            let mut health = missing;
            watch.update(points, shared, &mut health);
            health.contains(HealthBits::CAMERAS_DISAGREE)
        })
    }

    #[test]
    fn a_pair_that_sees_different_things_is_told_of_before_a_second_is_over() {
        let fine = HealthBits::default();
        assert_eq!(told_after(2, 100, 3, fine), Some(15));
        assert_eq!(told_after(2, 100, 40, fine), None);
        assert_eq!(told_after(1, 100, 0, fine), None, "one camera has nothing to disagree with");
        assert_eq!(told_after(2, 10, 0, fine), None, "too few points to judge by");
        assert_eq!(told_after(2, 100, 0, HealthBits::RIGHT_MISSING), None, "that is told otherwise");
    }

    #[test]
    fn frames_that_tell_nothing_begin_the_time_anew() {
        let mut watch = PairWatch::new(2, 20.0);
        for k in 0..60 {
            let mut health = HealthBits::default();
            watch.update(100, 0, &mut health);
            assert_eq!(health, HealthBits::default());
            if k % 14 == 13 {
                watch.forget();
            }
        }
    }

    #[test]
    fn a_frame_in_between_that_agrees_begins_the_time_anew() {
        let mut watch = PairWatch::new(2, 20.0);
        for k in 0..60 {
            let mut health = HealthBits::default();
            watch.update(100, if k % 15 == 14 { 50 } else { 0 }, &mut health);
            assert_eq!(health, HealthBits::default());
        }
    }
}
