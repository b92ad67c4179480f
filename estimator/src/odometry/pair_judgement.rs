//! What becomes of a pair of images that do not belong together: one of them is left out.
//!
//! A camera that jumps against the other is found by [`super::pair_shift`], one that is late or has repeated an image by
//! [`super::pair_time`], cameras that see different things by [`super::pair`].

use super::Odometer;
use super::pair_shift::{LEFT, is_probe};
use super::pair_time::RIGHT;
use crate::estimate::HealthBits;
use plumbline_config::Timestamp;

/// Points that the left camera must see for the right one to be left out because it sees other things.
const MIN_LEFT: usize = 12;

impl Odometer {
    /// True if an image of the frame of `stamp` is left out: a camera has jumped against the other, repeated an
    /// image, is late, or sees other things.
    pub(super) fn is_pair_doubtful(&mut self, stamp: Timestamp, health: &HealthBits) -> bool {
        if self.window.options.cameras < 2 {
            return false;
        }
        let begins_to_disagree = self.note_pair(stamp, health);
        self.pair_shift.add(self.window.image_shifts());
        if begins_to_disagree && self.left_sees() && self.pair_shift.jumped().is_none() {
            self.window.forget_images(RIGHT);
        }
        self.distrusted_camera(stamp).is_some()
    }

    /// Takes what the bits of the frame of `stamp` say of the pair; returns whether its cameras begin to see different things.
    fn note_pair(&mut self, stamp: Timestamp, health: &HealthBits) -> bool {
        match [HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN].map(|bit| health.contains(bit)) {
            [true, false] => self.pair_time.begin_probation(stamp, 0),
            [false, true] => self.pair_time.begin_probation(stamp, RIGHT),
            _ => {}
        }
        health.contains(HealthBits::CAMERAS_DISAGREE) && self.pair_time.disagree(stamp)
    }

    /// Judges the pair of a frame that waits for a start, that of `stamp`: no start rests on a camera that is late or has jumped.
    pub(super) fn judge_gathered_pair(&mut self, stamp: Timestamp, health: &mut HealthBits) {
        if self.window.options.cameras < 2 {
            return;
        }
        self.note_pair(stamp, health);
        self.write_pair_bits(health);
        if let Some(camera) = self.distrusted_camera(stamp) {
            self.measurer.leave_out(camera);
            self.gathering.leave_out(camera);
        }
    }

    /// Camera whose images points are not to be followed in: the left one, while it has jumped or is late, but for the frames by which it can
    /// show that it is back.
    pub(super) fn untracked_camera(&self) -> Option<usize> {
        let is_late = self.pair_time.late_camera() == Some(LEFT) && !is_probe(self.frames);
        self.pair_shift.untracked().or(is_late.then_some(LEFT))
    }

    fn write_pair_bits(&self, health: &mut HealthBits) {
        if self.pair_time.is_out_of_step() {
            health.insert(HealthBits::CAMERAS_OUT_OF_STEP);
        }
        if self.pair_shift.jumped().is_some() {
            health.insert(HealthBits::CAMERAS_DISAGREE);
        }
    }

    /// Camera whose image of the frame of `stamp` is not used.
    fn distrusted_camera(&self, stamp: Timestamp) -> Option<usize> {
        self.pair_shift.jumped().or_else(|| self.pair_time.distrusted_at(stamp, self.left_sees()))
    }

    /// Judges whether both images of the newest frame, that of `stamp`, are of the same moment, and leaves one of them out if it is doubtful.
    pub(super) fn judge_pair(&mut self, stamp: Timestamp, health: &mut HealthBits) {
        let was_out_of_step = self.pair_time.is_out_of_step();
        self.pair_time.add(stamp, self.window.epipolar_moments(), self.options.frame_period_s);
        let is_out_of_step = self.pair_time.is_out_of_step();
        self.write_pair_bits(health);
        let Some(camera) = self.distrusted_camera(stamp) else { return };
        // Landmarks are hosted by the left camera: without it nothing would be left.
        if camera == RIGHT && is_out_of_step && !was_out_of_step {
            self.window.forget_images(camera);
        }
        self.measurer.leave_out(camera);
        self.window.forget_image_of_newest(camera);
    }

    /// True if the left camera sees enough to go on without the right one.
    fn left_sees(&self) -> bool {
        self.measurer.count(0) >= MIN_LEFT
    }
}
