//! Treatment of a pair of images that do not belong together: one of them is left out.
//!
//! A camera that jumps against the other is found by [`shift`], one that is late or has repeated an image by
//! [`time`], cameras that see different things by [`sight`].

mod shift;
mod sight;
mod time;

use crate::estimate::HealthBits;
use crate::odometry::estimation::Estimation;
use crate::points::PointObservation;
use crate::window::Window;
use crate::window::epipolar::EpipolarMoments;
use plumbline_config::{Timestamp, ValidSetup};
use shift::{LEFT, PairShift, is_probe};
use sight::PairWatch;
use time::{PairTime, RIGHT};

/// Points that the left camera must see for the right one to be left out because it sees other things.
const MIN_LEFT: usize = 12;

/// The configured attitude of the pair is contradicted from so many standard deviations on, until that takes its weight. Sound flights, recorded
/// sensors and real images among them, reach 3.2; about three axes once a second, 5 are one false alarm in 160 hours.
const BENT_SIGMAS: f64 = 5.0;

/// The images of a pair against each other.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    frame_period_s: f64,
    sight: PairWatch,
    time: PairTime,
    shift: PairShift,
    is_bent: bool,
}

impl Pair {
    pub(super) fn new(setup: &ValidSetup) -> Self {
        let rate_hz = setup.left().rate_hz;
        Self {
            frame_period_s: 1.0 / rate_hz,
            sight: PairWatch::new(setup.camera.len(), rate_hz),
            time: PairTime::default(),
            shift: PairShift::default(),
            is_bent: false,
        }
    }

    /// Forgets all pairs but for what the cameras see in common.
    pub(super) fn clear(&mut self) {
        self.time.clear();
        self.shift.clear();
    }

    /// The next start may wait as well.
    pub(super) fn wait_anew(&mut self) {
        self.time.wait_anew();
    }

    /// Takes the points of a frame, tracked in both images or in one. Where texture repeats itself they tell nothing: few are paired, or with
    /// another cell.
    pub(super) fn see(&mut self, points: &[PointObservation], is_repeating: bool, health: &mut HealthBits) {
        if is_repeating {
            return self.sight.forget();
        }
        let shared = points.iter().filter(|o| o.px.iter().all(Option::is_some)).count();
        self.sight.update(points.len(), shared, health);
    }

    /// Takes the moments of a frame that waits for a start, if it has any.
    pub(super) fn add_gathered(&mut self, stamp: Timestamp, moments: Option<EpipolarMoments>) {
        self.time.add(stamp, moments, self.frame_period_s);
    }

    /// Judges the pair of a frame that waits for a start, that of `stamp`, and leaves one of its images out if it is doubtful: no start rests on
    /// a camera that is late or has jumped. Returns that camera.
    pub(super) fn judge_gathered(
        &mut self,
        estimation: &mut Estimation,
        stamp: Timestamp,
        health: &mut HealthBits,
    ) -> Option<usize> {
        if estimation.window.options.cameras < 2 {
            return None;
        }
        self.note(stamp, health);
        self.report(health);
        let camera = self.distrusted_camera(estimation, stamp)?;
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

    /// True if an image of the frame of `stamp` is left out: a camera has jumped against the other, repeated an
    /// image, is late, or sees other things.
    pub(super) fn is_doubtful(
        &mut self,
        estimation: &mut Estimation,
        stamp: Timestamp,
        health: &HealthBits,
    ) -> bool {
        if estimation.window.options.cameras < 2 {
            return false;
        }
        let begins_to_disagree = self.note(stamp, health);
        self.shift.add(estimation.window.image_shifts());
        if begins_to_disagree && left_sees(estimation) && self.shift.jumped().is_none() {
            estimation.window.forget_images(RIGHT);
        }
        self.distrusted_camera(estimation, stamp).is_some()
    }

    /// Takes what the bits of the frame of `stamp` say of the pair; returns whether its cameras begin to see different things.
    fn note(&mut self, stamp: Timestamp, health: &HealthBits) -> bool {
        match [HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN].map(|bit| health.contains(bit)) {
            [true, false] => self.time.begin_probation(stamp, 0),
            [false, true] => self.time.begin_probation(stamp, RIGHT),
            _ => {}
        }
        health.contains(HealthBits::CAMERAS_DISAGREE) && self.time.disagree(stamp)
    }

    /// Judges the configured attitude of the cameras to each other by the solved window.
    pub(super) fn judge_calibration(&mut self, window: &mut Window) {
        self.is_bent = window.pair_contradiction() > BENT_SIGMAS;
    }

    /// True if the cameras are bent against each other, and the estimate has not followed yet.
    pub(super) fn is_bent(&self) -> bool {
        self.is_bent
    }

    fn report(&self, health: &mut HealthBits) {
        if self.time.is_out_of_step() {
            health.insert(HealthBits::CAMERAS_OUT_OF_STEP);
        }
        if self.shift.jumped().is_some() || self.is_bent {
            health.insert(HealthBits::CAMERAS_DISAGREE);
        }
    }

    /// Camera whose image of the frame of `stamp` is not used.
    fn distrusted_camera(&self, estimation: &Estimation, stamp: Timestamp) -> Option<usize> {
        self.shift.jumped().or_else(|| self.time.distrusted_at(stamp, left_sees(estimation)))
    }

    /// The image of `camera` stops, and the other one does not.
    pub(super) fn stops(&mut self, camera: usize) {
        self.shift.jump(camera);
    }

    /// Judges whether both images of the newest frame, that of `stamp`, are of the same moment, and leaves one of them out if it is doubtful.
    pub(super) fn judge(&mut self, estimation: &mut Estimation, stamp: Timestamp, health: &mut HealthBits) {
        let was_out_of_step = self.time.is_out_of_step();
        let moments = estimation.window.epipolar_moments().filter(|_| !estimation.is_repeating);
        self.time.add(stamp, moments, self.frame_period_s);
        let is_out_of_step = self.time.is_out_of_step();
        self.report(health);
        let Some(camera) = self.distrusted_camera(estimation, stamp) else { return };
        // Landmarks are hosted by the left camera: without it nothing would be left.
        if camera == RIGHT && is_out_of_step && !was_out_of_step {
            estimation.window.forget_images(camera);
        }
        estimation.leave_out_image(camera);
    }
}

/// True if the left camera sees enough to go on without the right one.
fn left_sees(estimation: &Estimation) -> bool {
    estimation.measurer.count(0) >= MIN_LEFT
}
