//! The judge: which of the sensors is wrong where they contradict each other, and what is done about it.
//!
//! Each hypothesis has a file, with the watch that keeps its evidence over frames. In the order in which a frame is judged, with what each may
//! do, the health bits it sets and the largest quality it leaves:
//!
//! 1. A force set in suddenly and did not act ([`sudden_force`]): the published state is uncertain.
//! 2. The images stop while the vehicle flies on ([`stopped_view`]): they are left out. `LEFT_FROZEN`, `RIGHT_FROZEN`.
//! 3. The stamp is off ([`stamp`]): the state has the corrected time, and its variance is in the covariance.
//! 4. A camera jumped, is late, or sees other things ([`pair`]): its image is left out, points are followed in the other one, a start waits.
//!    `CAMERAS_OUT_OF_STEP` (10), `CAMERAS_DISAGREE`.
//! 5. Part of the scene moves ([`trial`]): its observations are dropped.
//! 6. The gyroscope is wrong, or a stream is late ([`gyroscope`], by [`turn_by_images`]): samples are not believed from the beginning on, motions are integrated anew, the
//!    images place the frame, the covariance grows; more where a crowd may carry these. `IMU_CONTRADICTED`, `IMU_LATE`, `IMAGES_LATE`, `ROTATION_DISPUTED`, `GYRO_CONTRADICTED` (10). A jump
//!    that is over and names nobody, or since which one rotation explains all turns: a start anew, the mounting of the cameras uncertain.
//! 7. The accelerometer is wrong ([`force_watch`], [`crate::window::trial`]; an axis feels nothing, [`unfelt_force`]): forces are as uncertain as they are wrong, the images place the
//!    frame. `ACCEL_CONTRADICTED`, after four frames (10).
//! 8. Focal length or baseline are not those configured ([`crate::window::rig_walk`]): the window follows the data. `SCALE_CONTRADICTED` (10).
//! 9. Once the window is solved, the motion contradicts most of what is seen (`window/doubt.rs`): solved anew with a loosened factor.
//!    `IMU_CONTRADICTED`.
//! 10. Forces are noisier than stated, or frames correct more than is explained ([`noise`]): so are the factors to come, and the published state. `ACCEL_NOISY`.
//! 11. Frames are corrected to one side, whoever is wrong ([`leaning`]): the published state is uncertain.
//! 12. Nothing holds the estimate, or no vehicle is like that ([`tracking`]): a start anew. `VELOCITY_UNCERTAIN`.
//!
//! Sensors that repeat their readings are known before ([`crate::inertial::stuck`]). Watches do not know each other: what one must know of
//! another is handed to it here, and in [`inertial`], where one sighting judges gyroscope and accelerometer.

mod covariance;
mod force_watch;
mod gyroscope;
mod inertial;
mod leaning;
mod noise;
mod pair;
mod stamp;
mod stopped_view;
mod sudden_force;
mod tracking;
mod trial;
mod turn_by_images;
mod unfelt_force;

pub(super) use inertial::report_stuck;
pub(super) use noise::Prediction;
pub(super) use tracking::{Belief, Velocity};

use super::estimation::Estimation;
use crate::estimate::HealthBits;
use crate::inertial::buffer::Coverage;
use crate::inertial::{ImuNoise, Preintegration};
use crate::input::ResetKind;
use crate::points::PointObservation;
use crate::window::epipolar::EpipolarMoments;
use crate::window::sighting::Sighting;
use crate::window::solve::Outcome;
use force_watch::ForceWatch;
use gyroscope::RotationWatch;
use leaning::Leaning;
use noise::{Evidence, NoiseScale};
use pair::Pair;
use plumbline_config::{ImuSample, Portable, Timestamp, ValidSetup};
use stamp::{Correction, StampErrors};
use stopped_view::{Stop, StoppedView};
use sudden_force::SuddenForce;
use tracking::Tracking;
use trial::{Tried, try_prediction};
use unfelt_force::UnfeltForce;

/// Largest quality while a sensor is contradicted: below what an autopilot flies with.
const CONTRADICTED_QUALITY: i8 = 10;
/// Frames on end by which something is named, or believed again: half a second at 20 Hz.
const FRAMES_TO_AGREE: u32 = 10;
/// A sensor that was wrong is on probation for so long, s; and what was wrong so shortly before is suspect, s.
const PROBATION_S: f64 = 1.0;
const SHORTLY_S: f64 = 2.0;
/// Images have contradicted a force that did not act after this time, and set the velocity right, s.
const SET_RIGHT_S: f64 = 0.3;

/// Errors of stamps show from this size on, s.
const SHOWS_S: f64 = 8e-4;

/// All watches.
#[derive(Clone, Debug)]
pub(super) struct Judge {
    stamps: StampErrors,
    view: StoppedView,
    pair: Pair,
    gyroscope: RotationWatch,
    forces: ForceWatch,
    sudden_force: SuddenForce,
    unfelt_force: UnfeltForce,
    noise: NoiseScale,
    leaning: Leaning,
    tracking: Tracking,
}

/// A frame before the judge.
#[derive(Debug)]
pub(super) struct Case<'a> {
    pub(super) stamp: Timestamp,
    /// Samples that were met on the way to it.
    pub(super) coverage: Coverage,
    /// Everything that is said of it.
    pub(super) health: &'a mut HealthBits,
}

/// Findings about a frame before the window is solved.
#[derive(Clone, Debug)]
pub(super) struct Verdict {
    /// The prediction of the frame, at the time at which its images were taken.
    pub(super) prediction: Prediction,
    /// An image was left out, before anything rested on it.
    is_pair_judged: bool,
}

impl Judge {
    pub(super) fn new(setup: &ValidSetup) -> Self {
        let gravity_o = nalgebra::Vector3::new(0.0, 0.0, -setup.imu.gravity_m_s2);
        Self {
            stamps: StampErrors::default(),
            view: StoppedView::default(),
            pair: Pair::new(setup),
            gyroscope: RotationWatch::new(&setup.imu),
            forces: ForceWatch::new(gravity_o),
            sudden_force: SuddenForce::new(),
            unfelt_force: UnfeltForce::default(),
            noise: NoiseScale::new(ImuNoise::of(&setup.imu), setup.camera.len()),
            leaning: Leaning::default(),
            tracking: Tracking::new(setup.estimator.health.clone()),
        }
    }

    /// Takes an inertial sample, as it was read.
    pub(super) fn add_sample(&mut self, sample: &ImuSample) {
        self.gyroscope.add(sample);
    }

    /// Takes the points of a frame, before it has a state; `is_repeating`: the texture in view repeats itself.
    pub(super) fn see(&mut self, points: &[PointObservation], is_repeating: bool, health: &mut HealthBits) {
        self.pair.see(points, is_repeating, health);
    }

    /// Takes how far the view of each camera moves in a frame period, px.
    pub(super) fn see_motion(&mut self, moved_px: [Option<f64>; 2]) {
        self.view.see(moved_px);
    }

    /// Takes the epipolar moments of a frame that waits for a start.
    pub(super) fn see_gathered(&mut self, moments: Option<EpipolarMoments>) {
        self.pair.add_gathered(moments);
    }

    /// Judges the images of a frame that waits for a start; returns the camera that is left out.
    pub(super) fn judge_gathered(
        &mut self,
        estimation: &mut Estimation,
        health: &mut HealthBits,
    ) -> Option<usize> {
        self.view.leave_out(estimation, health);
        self.pair.judge_gathered(estimation, health)
    }

    /// True if a start should wait, at `stamp`, for what the pair will show: `shared` of its `points` are found in both images.
    pub(super) fn delays_start(&mut self, stamp: Timestamp, shared: usize, points: usize) -> bool {
        self.pair.delays_start(stamp, shared, points)
    }

    /// An estimate begins with the frame of `stamp`.
    pub(super) fn begin(&mut self, stamp: Timestamp) {
        self.tracking.begin(stamp);
    }

    /// Decides whether the first state of an estimate is known well enough to be published.
    pub(super) fn judge_start(&mut self, estimation: &Estimation) {
        self.tracking.judge_velocity(estimation);
    }

    /// Takes the `motion` from the newest frame to the one that comes, and predicts that: both as uncertain as stamps are.
    pub(super) fn expect(
        &mut self,
        estimation: &Estimation,
        motion: Preintegration,
        case: &Case<'_>,
    ) -> (Preintegration, Prediction) {
        let from = estimation.window.frames.last();
        let (taken, nav) = from.map(|last| (last.taken, last.nav.clone())).unwrap_or_default();
        if case.coverage.is_measured() {
            self.sudden_force.update([taken, case.stamp], &nav.rot_o_b, &motion);
        } else {
            self.sudden_force.forget_forces();
        }
        let time_variance = 2.0 * self.gyroscope.stamp_sigma_s().squared();
        let motion = estimation.with_uncertain_ends(motion, &nav, &estimation.rate_b, time_variance);
        let prediction = self.noise.predict(&estimation.window, &nav, &motion);
        (motion, prediction)
    }

    /// Judges the newest frame before anything rests on it: its time, its images, what moves in view, and the samples that lead to it.
    pub(super) fn before_solving(
        &mut self,
        estimation: &mut Estimation,
        prediction: Prediction,
        case: &mut Case<'_>,
    ) -> Verdict {
        if let Some(Stop::One(camera)) = self.view.judge(estimation, case.health) {
            self.pair.stops(camera);
        }
        let (prediction, known) = self.correct_stamp(estimation, prediction, case.coverage);
        let is_pair_judged = self.pair.is_doubtful(estimation);
        if is_pair_judged {
            estimation.window.predict_rates();
            self.pair.judge(estimation, case.health);
        }
        let known = known.filter(|_| !is_pair_judged);
        let tried = if self.may_try(estimation, case) {
            let stamp_sigma_s = self.time_sigma_s();
            try_prediction(&mut estimation.window, &prediction, known, stamp_sigma_s)
        } else {
            Tried::default()
        };
        self.judge_samples(estimation, &tried, case);
        Verdict { prediction, is_pair_judged }
    }

    /// Judges the images of the newest frame against each other once its image rates are known, unless one is left out already.
    pub(super) fn judge_pair(&mut self, estimation: &mut Estimation, verdict: &Verdict, case: &mut Case<'_>) {
        if !verdict.is_pair_judged {
            self.pair.judge(estimation, case.health);
        }
    }

    /// Judges the motion that leads to the newest frame by the `outcome` of the solver, and drops what does not fit; returns whether the
    /// images contradict it. The motion is doubted in `iterations` at most, and not at all without.
    pub(super) fn after_solving(
        &mut self,
        estimation: &mut Estimation,
        outcome: Outcome,
        iterations: Option<usize>,
        case: &mut Case<'_>,
    ) -> bool {
        if outcome.is_not_positive_definite {
            case.health.insert(HealthBits::NOT_POSITIVE_DEFINITE);
            self.leaning.prolong_suspicion(case.stamp);
        }
        let window = &mut estimation.window;
        let is_contradicted =
            iterations.is_some_and(|most| window.is_newest_doubtful() && window.doubt_newest_motion(most));
        if is_contradicted {
            case.health.insert(HealthBits::IMU_CONTRADICTED);
            self.tracking.note_doubt(case.stamp);
        }
        window.remove_outliers();
        is_contradicted
    }

    /// Learns how noisy the forces are, once the covariance of the newest frame is known. A motion that was not measured throughout, or is
    /// not believed for another reason, tells nothing of it; nor does one camera, whose scale comes from the forces.
    pub(super) fn learn_noise(
        &mut self,
        estimation: &mut Estimation,
        prediction: &Prediction,
        is_contradicted: bool,
        case: &mut Case<'_>,
    ) {
        let is_evidence = case.coverage.is_measured()
            && estimation.window.options.cameras > 1
            && !self.gyroscope.is_distrusting()
            && !self.forces.is_contradicted();
        let evidence = match (is_evidence, is_contradicted) {
            (false, _) => Evidence::None,
            (true, false) => Evidence::Innovation,
            (true, true) => Evidence::Contradiction,
        };
        let Self { noise, leaning, .. } = self;
        noise.learn(&mut estimation.window, prediction, (evidence, leaning), case.health);
    }

    /// The newest frame tells nothing of how well it is known.
    pub(super) fn keep_prediction(&mut self, prediction: Prediction) {
        self.noise.keep_prediction(prediction);
    }

    /// Decides about the estimate after the frame of `stamp`.
    pub(super) fn conclude(
        &mut self,
        estimation: &Estimation,
        stamp: Timestamp,
        health: &mut HealthBits,
    ) -> Belief {
        self.tracking.judge(estimation, stamp, health)
    }

    /// An estimate was given up at `stamp` for a reason of its own.
    pub(super) fn note_reset(&mut self, stamp: Timestamp) {
        self.tracking.note_reset(stamp);
    }

    /// The estimate starts anew: forgets its states. What is known of the sensors stays, unless the reset is hard.
    pub(super) fn clear(&mut self, estimation: &mut Estimation, kind: ResetKind) {
        self.noise.forget_state();
        self.leaning = Leaning::default();
        self.gyroscope.forget_turns();
        self.forces.clear();
        self.sudden_force = SuddenForce::new();
        self.unfelt_force = UnfeltForce::default();
        // A start takes the stamps of its frames as they are.
        self.stamps = StampErrors::default();
        self.pair.wait_anew();
        if kind == ResetKind::Hard {
            self.noise.forget_scale(&mut estimation.window);
        }
    }

    /// Forgets all stamps: those that come have nothing to do with them.
    pub(super) fn forget_time(&mut self) {
        self.view = StoppedView::default();
        self.pair.clear();
        self.gyroscope.clear();
        self.tracking.forget_time();
    }

    /// Puts the newest frame at the time at which its images were taken; returns the prediction of that time, and the frame's pose by known
    /// landmarks if it was looked for.
    fn correct_stamp(
        &mut self,
        estimation: &mut Estimation,
        prediction: Prediction,
        coverage: Coverage,
    ) -> (Prediction, Option<Sighting>) {
        Correction {
            errors: &mut self.stamps,
            estimation,
            noise: &self.noise,
            sudden_force: &self.sudden_force,
            begun: self.tracking.begun(),
            is_distrusting: self.gyroscope.is_distrusting(),
            is_force_contradicted: self.forces.is_contradicted(),
        }
        .correct(prediction, coverage)
    }

    /// True if the prediction can be relied on: the scale is known, and the samples are believed.
    fn may_try(&self, estimation: &Estimation, case: &Case<'_>) -> bool {
        estimation.window.options.cameras > 1
            && self.tracking.is_velocity_known()
            && !self.may_be_late(&estimation.window, case)
            && !case.coverage.is_saturated
            && !case.coverage.unmeasured.is_any()
            && !self.gyroscope.is_distrusting()
            && !self.forces.is_contradicted()
            && !case.health.contains(HealthBits::IMU_CONTRADICTED)
    }

    /// Standard deviation of the time of a state, s, as far as errors of stamps show.
    fn time_sigma_s(&self) -> f64 {
        self.stamps.newest_variance().map_or_else(|| self.gyroscope.stamp_sigma_s(), f64::sqrt)
    }

    /// Knowledge of the velocity since the last start.
    pub(super) fn velocity(&self) -> Velocity {
        self.tracking.velocity()
    }

    /// 0..=100 by landmarks in view and the certainty of the velocity, bounded while sensors contradict each other.
    pub(super) fn quality(&self, estimation: &Estimation, in_view: usize) -> i8 {
        let quality = self.tracking.quality(estimation, in_view);
        let newest = estimation.window.frames.last();
        let is_contradicted = self.gyroscope.is_contradicted()
            || self.forces.is_contradicted()
            || self.unfelt_force.is_contradicted()
            || estimation.window.is_rig_refuted()
            || self.pair.is_out_of_step()
            || newest.is_some_and(|newest| self.tracking.is_doubted_at(newest.stamp));
        if is_contradicted { quality.min(CONTRADICTED_QUALITY) } else { quality }
    }

    /// The rotation by which the cameras may have been moved against the IMU, rad.
    pub(super) fn take_jump(&mut self) -> Option<nalgebra::Vector3<f64>> {
        self.gyroscope.take_jump()
    }

    /// True while inertial samples are not believed.
    pub(super) fn is_distrusting(&self) -> bool {
        self.gyroscope.is_distrusting()
    }

    /// The camera whose images points are not to be followed in after the frame of number `frame`.
    pub(super) fn untracked_camera(&self, frame: u64) -> Option<usize> {
        self.pair.untracked(frame)
    }

    /// True if what comes can be predicted: the velocity is known, and no inertial sensor is distrusted, contradicted or suspect.
    pub(super) fn is_predictable(&self, health: HealthBits) -> bool {
        let spoilt = [
            HealthBits::IMU_GAP,
            HealthBits::IMU_SATURATED,
            HealthBits::IMU_CONTRADICTED,
            HealthBits::NOT_POSITIVE_DEFINITE,
        ];
        self.tracking.is_velocity_known()
            && !self.gyroscope.is_distrusting()
            && !self.forces.is_contradicted()
            && !spoilt.into_iter().any(|bit| health.contains(bit))
    }
}
