//! Treatment of a pair of images that do not belong together: one of them is left out.
//!
//! A camera that jumps against the other is found by [`shift`], one that is late by [`time`], cameras that see different things by [`sight`].

mod shift;
mod sight;
mod time;

use crate::estimate::HealthBits;
use crate::odometry::estimation::Estimation;
use crate::points::PointObservation;
use crate::window::epipolar::EpipolarMoments;
use crate::window::tracks::MIN_WITNESSES;
use plumbline_config::{Timestamp, ValidSetup};
use shift::{LEFT, PairShift, is_probe};
use sight::PairWatch;
use time::{PairTime, RIGHT};

/// Time after a pair whose images see different things, s: most of what is found in both images of such a pair is wrong.
const DISAGREED_S: f64 = 2.0;

/// The images of a pair against each other.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    frame_period_s: f64,
    sight: PairWatch,
    time: PairTime,
    shift: PairShift,
    /// Time for which the right image is still left out because the cameras saw different things, s, and whether that begins.
    disagreed_s: f64,
    begins_to_disagree: bool,
    left_sees: bool,
}

impl Pair {
    pub(super) fn new(setup: &ValidSetup) -> Self {
        let rate_hz = setup.left().rate_hz;
        Self {
            frame_period_s: 1.0 / rate_hz,
            sight: PairWatch::new(setup.camera.len(), rate_hz),
            time: PairTime::default(),
            shift: PairShift::default(),
            disagreed_s: 0.0,
            begins_to_disagree: false,
            left_sees: false,
        }
    }

    /// Forgets all pairs but for what the cameras see in common.
    pub(super) fn clear(&mut self) {
        self.time.clear();
        self.shift.clear();
        self.disagreed_s = 0.0;
    }

    /// The next start may wait as well.
    pub(super) fn wait_anew(&mut self) {
        self.time.wait_anew();
    }

    /// Takes the points of a frame, tracked in both images or in one. Where texture repeats itself they tell nothing: few are paired, or with
    /// another cell.
    pub(super) fn see(&mut self, points: &[PointObservation], is_repeating: bool, health: &mut HealthBits) {
        let was_disagreeing = self.disagreed_s > 0.0;
        self.disagreed_s -= self.frame_period_s;
        if is_repeating {
            self.begins_to_disagree = false;
            return self.sight.forget();
        }
        let shared = points.iter().filter(|o| o.px.iter().all(Option::is_some)).count();
        self.sight.update(points.len(), shared, health);
        if health.contains(HealthBits::CAMERAS_DISAGREE) {
            self.disagreed_s = DISAGREED_S;
        }
        self.begins_to_disagree = !was_disagreeing && self.disagreed_s > 0.0;
        // A covered left lens makes a pair that sees different things too.
        self.left_sees = points.iter().filter(|o| o.px[0].is_some()).count() >= MIN_WITNESSES;
    }

    /// Takes the moments of a frame that waits for a start, if it has any.
    pub(super) fn add_gathered(&mut self, moments: Option<EpipolarMoments>) {
        self.time.add(moments, self.frame_period_s);
    }

    /// Judges the pair of a frame that waits for a start, and leaves one of its images out if it is doubtful: no start rests on
    /// a camera that is late or has jumped. Returns that camera.
    pub(super) fn judge_gathered(
        &self,
        estimation: &mut Estimation,
        health: &mut HealthBits,
    ) -> Option<usize> {
        if estimation.window.options.cameras < 2 {
            return None;
        }
        self.report(health);
        let camera = self.distrusted_camera()?;
        estimation.measurer.leave_out(camera);
        Some(camera)
    }

    /// True if a start should wait, at `stamp`, for what the pair will show: `shared` of its `points` are found in both images.
    pub(super) fn delays_start(&mut self, stamp: Timestamp, shared: usize, points: usize) -> bool {
        self.time.delays_start(stamp, shared, points)
    }

    /// Camera whose images points are not to be followed in after the frame of number `frame`: the left one, while it has jumped or is late,
    /// but for the frames by which it can show that it is back.
    pub(super) fn untracked(&self, frame: u64) -> Option<usize> {
        let is_late = self.time.late_camera() == Some(LEFT) && !is_probe(frame);
        self.shift.untracked().or(is_late.then_some(LEFT))
    }

    /// True if the images of the pair are not of the same moment.
    pub(super) fn is_out_of_step(&self) -> bool {
        self.time.is_out_of_step()
    }

    /// True if an image of the newest frame is left out: a camera has jumped against the other, is late, or sees other things.
    pub(super) fn is_doubtful(&mut self, estimation: &mut Estimation) -> bool {
        if estimation.window.options.cameras < 2 {
            return false;
        }
        self.shift.add(estimation.window.image_shifts());
        if self.begins_to_disagree && self.left_sees && self.shift.jumped().is_none() {
            estimation.window.forget_images(RIGHT, 0);
        }
        self.distrusted_camera().is_some()
    }

    fn report(&self, health: &mut HealthBits) {
        if self.time.is_out_of_step() {
            health.insert(HealthBits::CAMERAS_OUT_OF_STEP);
        }
        if self.shift.jumped().is_some() {
            health.insert(HealthBits::CAMERAS_DISAGREE);
        }
    }

    /// Camera whose image is not used.
    fn distrusted_camera(&self) -> Option<usize> {
        let is_other = self.left_sees && self.disagreed_s > 0.0;
        self.shift.jumped().or_else(|| self.time.late_camera()).or(is_other.then_some(RIGHT))
    }

    /// The image of `camera` stops, and the other one does not.
    pub(super) fn stops(&mut self, camera: usize) {
        self.shift.jump(camera);
    }

    /// Judges whether both images of the newest frame are of the same moment, and leaves one of them out if it is doubtful.
    pub(super) fn judge(&mut self, estimation: &mut Estimation, health: &mut HealthBits) {
        let was_out_of_step = self.time.is_out_of_step();
        let moments = estimation.window.epipolar_moments().filter(|_| !estimation.is_repeating);
        self.time.add(moments, self.frame_period_s);
        let is_out_of_step = self.time.is_out_of_step();
        self.report(health);
        let Some(camera) = self.distrusted_camera() else { return };
        // Landmarks are hosted by the left camera: without it nothing would be left.
        if camera == RIGHT && is_out_of_step && !was_out_of_step {
            estimation.window.forget_images(camera, 0);
        }
        estimation.leave_out_image(camera);
    }
}
