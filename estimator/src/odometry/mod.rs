//! The odometer: from tracked points, lines and inertial samples to one estimate a frame.
//!
//! Three types with one job each work on one [`estimation::Estimation`] (sensors, window, covariance):
//!
//! - [`start`]: when an estimate begins, and with what;
//! - [`judge`]: which of the sensors is wrong where they contradict each other, and what is done about it;
//! - [`Odometer`]: carries a frame through the window: measure ([`measure`]), predict by the IMU, link tracks to landmarks, choose
//!   keyframes, optimise, make room, publish ([`published`]), and tell the front-end ([`feedback`]).
//!
//! It sees no image: points come from [`crate::points`], lines from [`crate::lines`], or both from a test.

mod estimation;
mod feedback;
mod judge;
mod measure;
pub mod measurements;
#[cfg(test)]
mod moving_tests;
#[cfg(test)]
mod pair_tests;
mod plausible;
#[cfg(test)]
mod poison_tests;
mod published;
mod reset;
#[cfg(test)]
mod reset_tests;
#[cfg(test)]
mod silent_tests;
#[cfg(test)]
mod stamp_tests;
mod start;
mod steps;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod trust_tests;
mod vibrating;
pub mod zero_velocity;

pub use plausible::ResetReason;
pub use start::Missing;
pub use steps::StepCovariance;

use crate::estimate::{BiasVariances, Estimate, HealthBits, NavCovariance, Stage, StageProbe};
use crate::exchange::{Feedback, SolvedFrame, Tracked};
use crate::inertial::buffer::Coverage;
use crate::inertial::{ImuBuffer, Preintegration, Vibration};
use crate::window::Window;
use crate::window::state::FrameTime;
use crate::window::tracks::MIN_WITNESSES;
use crate::work_budget::WorkBudget;
use estimation::Estimation;
use judge::{Belief, Case, Judge, Velocity, Verdict};
use measurements::Measurer;
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp, ValidSetup};
use start::Start;
use zero_velocity::ZeroVelocityDetector;

/// Options in the units of their use.
#[derive(Clone, Debug)]
struct Options {
    gravity_m_s2: f64,
    frame_period_s: f64,
    max_iterations: usize,
    focal_px: f64,
    /// Longest exposure of either camera.
    exposure_s: f64,
}

/// Result of the solver in a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Solved {
    iterations: u32,
    is_keyframe: bool,
}

/// Phase of the odometer: a state is there while `Running`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Gathering,
    Running,
}

/// The sliding-window odometer.
#[derive(Clone, Debug)]
pub struct Odometer {
    options: Options,
    estimation: Estimation,
    start: Start,
    judge: Judge,
    zero_velocity: ZeroVelocityDetector,
    phase: Phase,
    last: Option<FrameTime>,
    /// Shortest interval of the newest frames, s.
    usual_s: f64,
    /// Frames so far, and the newest as the front-end and places are told of it.
    frames: u64,
    solved: SolvedFrame,
    keeps_steps: bool,
    step: Option<StepCovariance>,
}

impl Odometer {
    /// Allocates everything the setup asks for.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        let (rate_hz, focal_px) = (setup.left().rate_hz, setup.left().focal_px[0]);
        let mut window = Window::new(setup);
        window.clear();
        Self {
            options: Options {
                gravity_m_s2: setup.imu.gravity_m_s2,
                frame_period_s: 1.0 / rate_hz,
                max_iterations: setup.estimator.window.max_iterations,
                focal_px,
                exposure_s: setup.camera.iter().fold(0.0, |most, c| c.exposure_s.at_least(most)),
            },
            estimation: Estimation {
                imu: ImuBuffer::of(&setup.imu),
                window,
                measurer: Measurer::new(setup),
                rate_b: Vector3::zeros(),
                vibration: Vibration::default(),
                is_repeating: false,
                turn: None,
                covariance: NavCovariance::zeros(),
                bias_variances: BiasVariances::zeros(),
                time_offset_sigma_s: setup.rig.time_offset_sigma_s,
                scale_sigma: 0.0,
            },
            start: Start::new(setup),
            judge: Judge::new(setup),
            zero_velocity: ZeroVelocityDetector::new(rate_hz, focal_px),
            phase: Phase::Gathering,
            last: None,
            usual_s: f64::INFINITY,
            frames: 0,
            solved: SolvedFrame::default(),
            keeps_steps: false,
            step: None,
        }
    }

    /// The window.
    pub fn window(&self) -> &Window {
        &self.estimation.window
    }

    /// Why the estimate was last started anew.
    pub fn reset_reason(&self) -> Option<&ResetReason> {
        self.start.reset_reason.as_ref()
    }

    /// What an attempt to start with one camera lacked; `None` where the newest frame was no attempt.
    pub fn missing(&self) -> Option<&Missing> {
        self.start.missing.as_ref()
    }

    /// Biases of gyroscope and accelerometer: present ones, or those of the next start.
    fn biases(&self) -> (Vector3<f64>, Vector3<f64>) {
        match (self.phase, self.estimation.window.frames.last()) {
            (Phase::Running, Some(frame)) => frame.nav.biases(),
            _ => self.start.bias_memory,
        }
    }

    /// Processes a tracked frame: returns the estimate at its time, and writes to `feedback` what the front-end
    /// should know of it. Stages are timed by `probe`. Allocates nothing.
    pub fn process(
        &mut self,
        tracked: &Tracked,
        probe: &mut impl StageProbe,
        feedback: &mut Feedback,
    ) -> Estimate {
        if tracked.is_clock_set {
            self.start_anew(ResetReason::ClockSet);
            self.forget_time();
        }
        if let Some(kind) = tracked.reset {
            self.start_anew(ResetReason::AskedFor(kind));
        }
        for sample in &tracked.samples {
            self.estimation.imu.push(sample);
            self.judge.add_sample(sample);
        }
        self.solved.keyframes.clear();
        self.solved.steps.clear();
        self.solved.lines.clear();
        let estimate = self.step(tracked, probe);
        self.write_feedback(tracked.is_repeating, &estimate, feedback);
        self.frames += 1;
        estimate
    }

    fn step(&mut self, tracked: &Tracked, probe: &mut impl StageProbe) -> Estimate {
        let stamp = tracked.time.stamp;
        let mut health = tracked.health;
        if self.phase == Phase::Gathering {
            self.last = self.last.map(|last| last.by_offset(tracked.time.time_offset_s));
        }
        if self.last.is_some_and(|last| stamp <= last.stamp) {
            health.insert(HealthBits::BAD_STAMP);
        }
        if health.contains(HealthBits::BAD_STAMP) {
            return self.estimate(tracked, health, Solved::default());
        }
        self.check_hole(stamp);
        if tracked.budget != WorkBudget::FULL {
            health.insert(HealthBits::DEGRADED);
        }
        self.check_points(tracked, &mut health);
        probe.begin(Stage::Window);
        self.measure(tracked, &mut health);
        self.step = None;
        let solved = match self.phase {
            Phase::Running => self.run(tracked.time, tracked.budget.max_iterations, &mut health),
            Phase::Gathering => self.gather(tracked.time, &mut health),
        };
        probe.end(Stage::Window);
        probe.begin(Stage::Marginalize);
        if self.phase == Phase::Running {
            self.estimation.window.make_room();
        }
        probe.end(Stage::Marginalize);
        self.last = Some(tracked.time);
        self.estimate(tracked, health, solved)
    }

    /// Before the first state: gathers the frame and tries to start.
    fn gather(&mut self, time: FrameTime, health: &mut HealthBits) -> Solved {
        let (times, is_still) = ((self.last, time), self.zero_velocity.is_still());
        if !self.start.gather(&mut self.estimation, &mut self.judge, times, is_still, health) {
            return Solved::default();
        }
        self.phase = Phase::Running;
        self.judge.begin(time.stamp);
        self.estimation.scale_sigma = 0.0;
        self.refresh_covariance(health);
        self.judge.judge_start(&self.estimation);
        self.note_keyframes();
        Solved { iterations: 0, is_keyframe: true }
    }

    /// Carries a running estimate over one frame.
    fn run(&mut self, time: FrameTime, max_iterations: usize, health: &mut HealthBits) -> Solved {
        let Some((motion, coverage)) = self.motion_to(time.stamp, health) else { return Solved::default() };
        let mut case = Case { stamp: time.stamp, coverage, health };
        let (connected, verdict) = self.enter(time, motion, &mut case);
        let Self { estimation, judge, .. } = self;
        let Estimation { window, measurer, .. } = estimation;
        let is_keyframe = window.needs_keyframe(connected, measurer.points().len());
        if is_keyframe {
            window.make_keyframe(measurer.points(), measurer.lines());
        }
        window.triangulate(false);
        window.predict_rates();
        judge.judge_pair(estimation, &verdict, &mut case);
        let max_iterations = self.options.max_iterations.min(max_iterations);
        let outcome = estimation.window.optimize(max_iterations);
        let is_witnessed = connected >= MIN_WITNESSES;
        let may_doubt = is_witnessed.then_some(max_iterations);
        let is_contradicted = judge.after_solving(estimation, outcome, may_doubt, &mut case);
        let is_told = is_witnessed || !coverage.has_gap;
        if is_told && self.refresh_covariance(case.health) {
            self.judge.learn_noise(&mut self.estimation, &verdict.prediction, is_contradicted, &mut case);
            self.step = self.newest_step();
            self.estimation.window.refute_configured_rig();
        } else {
            self.carry_covariance(verdict.prediction.covariance.as_ref());
            self.judge.keep_prediction(verdict.prediction);
        }
        if is_keyframe {
            self.note_keyframes();
        }
        self.conclude(time.stamp, health);
        let cost = outcome.cost / self.estimation.window.observation_count().at_least(1.0);
        if self.start.is_refused(time.stamp, cost, self.judge.is_distrusting()) {
            self.start_anew(ResetReason::StartRefused);
        }
        if let Some(turned) = self.judge.take_jump() {
            self.start_anew(ResetReason::Jump(turned.norm()));
            self.start.forget_attitude();
            self.estimation.window.doubt_mounting(&turned);
        }
        Solved { iterations: outcome.iterations, is_keyframe }
    }

    /// The motion from the newest frame to `stamp`, and what was met on the way; `None` without a frame.
    fn motion_to(&self, stamp: Timestamp, health: &mut HealthBits) -> Option<(Preintegration, Coverage)> {
        let last = self.estimation.window.frames.last()?;
        let (motion, coverage) = self.estimation.preintegrate([last.taken, stamp], &last.nav.biases());
        if coverage.has_gap {
            health.insert(HealthBits::IMU_GAP);
        }
        if coverage.is_saturated {
            health.insert(HealthBits::IMU_SATURATED);
        }
        Some((motion, coverage))
    }

    /// Puts the frame of `time` into the window where `motion` predicts it, with what it sees, and judges it; returns how many of its points
    /// were known before.
    fn enter(&mut self, time: FrameTime, motion: Preintegration, case: &mut Case<'_>) -> (usize, Verdict) {
        let Self { estimation, judge, .. } = self;
        let (motion, prediction) = judge.expect(estimation, motion, case);
        let gyro_b = estimation.rate_b + prediction.nav.bias_gyro;
        let Estimation { window, measurer, .. } = estimation;
        window.push_frame(time, prediction.nav.clone(), Some(motion), self.zero_velocity.is_still());
        window.set_gyro_of_newest(gyro_b);
        let connected = window.observe(measurer.points(), measurer.lines());
        window.unroll_newest();
        window.clear_outliers();
        (connected, judge.before_solving(estimation, prediction, case))
    }

    /// Keeps the newest state, that of `stamp`, for starts anew, or gives it up.
    fn conclude(&mut self, stamp: Timestamp, health: &mut HealthBits) {
        match self.judge.conclude(&self.estimation, stamp, health) {
            Belief::Believed => self.start.remember(&self.estimation, stamp),
            Belief::Unproven => {}
            Belief::GivenUp(reason) => self.start_anew(reason),
        }
    }
}
