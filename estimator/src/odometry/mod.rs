//! The odometer: from tracked points, lines and inertial samples to one estimate a frame.
//!
//! It gathers frames until there is a start ([`start`]), then carries each frame through the window:
//! predict by the IMU, link tracks to landmarks, choose keyframes, optimise, drop outliers, judge its own
//! health, make room. It sees no image: points come from [`crate::points`], lines from [`crate::lines`], or
//! both from a test.

mod contradiction;
mod force_watch;
mod gyro_angles;
mod inherited;
mod innovation;
mod judgement;
mod known;
mod lag;
pub mod measurements;
#[cfg(test)]
mod moving_tests;
mod pair;
mod pair_judgement;
mod pair_shift;
#[cfg(test)]
mod pair_tests;
mod pair_time;
#[cfg(test)]
mod poison_tests;
mod prediction_trial;
mod renewal;
mod reset;
#[cfg(test)]
mod reset_tests;
mod rotation_watch;
mod scale_watch;
mod silent;
#[cfg(test)]
mod silent_tests;
mod stamp_drift;
mod stamp_error;
mod stamp_noise;
mod start;
mod steps;
mod stilled_force;
mod sudden_force;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod trust_tests;
mod vibrating;
pub mod zero_velocity;

use crate::estimate::{
    BiasVariances, Estimate, FrameFigures, HealthBits, NavCovariance, Stage, StageProbe, TrackingState,
};
use crate::exchange::{Feedback, KeyframeStep, SolvedFrame, Tracked};
use crate::inertial::{ImuBuffer, ImuNoise, Preintegration, Vibration};
use crate::initial::{Gathering, MonoWorkspace};
use crate::points::PointObservation;
use crate::shutter::readouts;
use crate::window::snapshot::SnapshotKeyframe;
use crate::window::state::{FrameTime, NavState};
use crate::window::{Fit, RigEstimate, Window};
use crate::work_budget::WorkBudget;
use force_watch::ForceWatch;
use inherited::{Carried, Inherited};
use innovation::NoiseScale;
pub use judgement::ResetReason;
use judgement::Velocity;
use measurements::Measurer;
use nalgebra::{SVector, Vector3};
use pair::PairWatch;
use pair_shift::PairShift;
use pair_time::PairTime;
use plumbline_config::options::HealthConfig;
use plumbline_config::{CameraModel, Portable, Timestamp, ValidSetup};
use reset::Memory;
use rotation_watch::RotationWatch;
use scale_watch::ScaleWatch;
use silent::report_stuck;
use stamp_error::StampErrors;
pub use steps::StepCovariance;
use stilled_force::StilledForce;
use sudden_force::SuddenForce;
use zero_velocity::ZeroVelocityDetector;

/// Landmarks in view below which the estimate is weak.
const FEW_LANDMARKS: usize = 20;
/// Frames further apart than this many periods have lost frames between them.
const FRAME_GAP_PERIODS: f64 = 1.5;
/// An image is blurred if a turn moves what is seen in its middle by this much while it is exposed, px: a quarter of a patch.
const BLURRED_PX: f64 = 3.0;
/// Samples whose mean is the angular rate of a frame reach back this far, s: two or three of them, against vibration.
const RATE_SPAN_S: f64 = 0.01;

/// Where inertial samples were missing, fewer points than these that are known from before do not prove where the vehicle is: a
/// few false matches agree with any motion. As many as a start rests on.
const MIN_WITNESSES_OF_GAP: usize = 12;

/// Options of start and health, in the units of their use.
#[derive(Clone, Debug)]
struct Options {
    stereo_frames: usize,
    mono_window_s: f64,
    mono_min_parallax_px: f64,
    sigma_px: f64,
    bias_gyro_sigma: f64,
    bias_accel_sigma: f64,
    gravity_m_s2: f64,
    frame_period_s: f64,
    health: HealthConfig,
    max_iterations: usize,
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
    noise: ImuNoise,
    focal_px: f64,
    /// Longest exposure of either camera, s.
    exposure_s: f64,
    /// Inertial samples.
    pub imu: ImuBuffer,
    /// The window.
    pub window: Window,
    measurer: Measurer,
    gathering: Gathering,
    mono_workspace: MonoWorkspace,
    zero_velocity: ZeroVelocityDetector,
    pair: PairWatch,
    pair_time: PairTime,
    pair_shift: PairShift,
    rotation: RotationWatch,
    forces: ForceWatch,
    sudden_force: SuddenForce,
    stilled_force: StilledForce,
    scale: ScaleWatch,
    stamp_errors: StampErrors,
    phase: Phase,
    last_stamp: Option<Timestamp>,
    last_seen: Option<Timestamp>,
    last_reset: Option<Timestamp>,
    /// When the estimate began.
    begun: Option<Timestamp>,
    /// Why the estimate was last started anew.
    pub reset_reason: Option<ResetReason>,
    memory: Memory,
    /// Where the next start begins, and the biases it begins with.
    origin: Option<NavState>,
    bias_memory: (Vector3<f64>, Vector3<f64>),
    covariance: NavCovariance,
    bias_variances: BiasVariances,
    inherited: Inherited,
    /// What is known of the attitude of [`Self::origin`], which the gyroscope has turned on since the last pose; `None` where
    /// it has not measured all the way.
    carried: Option<Carried>,
    velocity: Velocity,
    time_offset_sigma_s: f64,
    reset_counter: u32,
    /// Resets that were counted before this odometer began.
    first_counter: u32,
    mono_wait: usize,
    rate_b: Vector3<f64>,
    frames: u64,
    solved: SolvedFrame,
    keeps_steps: bool,
    step: Option<StepCovariance>,
    noise_scale: NoiseScale,
    /// Vibration at the newest frame.
    vibration: Vibration,
}

impl Odometer {
    /// Allocates everything the setup asks for.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        let cameras: Vec<CameraModel> = setup.camera.iter().map(|c| c.model()).collect();
        let initial = &setup.estimator.initial;
        let rate_hz = setup.left().rate_hz;
        let gathered = ((initial.mono_window_s * rate_hz * 1.5) as usize).max(initial.stereo_frames) + 2;
        let points = setup.estimator.points.max_points;
        let imu = &setup.imu;
        let mut window = Window::new(setup);
        window.clear();
        Self {
            options: Options {
                stereo_frames: initial.stereo_frames,
                mono_window_s: initial.mono_window_s,
                mono_min_parallax_px: initial.mono_min_parallax_px,
                sigma_px: setup.estimator.points.sigma_px,
                bias_gyro_sigma: imu.gyro_bias_sigma_rad_s,
                bias_accel_sigma: imu.accel_bias_sigma_m_s2,
                gravity_m_s2: imu.gravity_m_s2,
                frame_period_s: 1.0 / rate_hz,
                health: setup.estimator.health.clone(),
                max_iterations: setup.estimator.window.max_iterations,
            },
            noise: ImuNoise::of(imu),
            focal_px: setup.left().focal_px[0],
            exposure_s: setup.camera.iter().fold(0.0, |most, c| c.exposure_s.at_least(most)),
            imu: ImuBuffer::of(imu),
            measurer: Measurer::new(cameras, &setup.estimator.points, &setup.estimator.lines)
                .with_readouts(readouts(setup)),
            gathering: Gathering::new(gathered, points),
            mono_workspace: MonoWorkspace::new(gathered, points),
            zero_velocity: ZeroVelocityDetector::new(rate_hz, setup.left().focal_px[0]),
            pair: PairWatch::new(setup.camera.len(), rate_hz),
            pair_time: PairTime::default(),
            pair_shift: PairShift::default(),
            rotation: RotationWatch::new(imu),
            forces: ForceWatch::new(window.options.gravity_o),
            sudden_force: SuddenForce::new(),
            stilled_force: StilledForce::new(),
            scale: ScaleWatch::default(),
            stamp_errors: StampErrors::default(),
            phase: Phase::Gathering,
            last_stamp: None,
            last_seen: None,
            last_reset: None,
            begun: None,
            reset_reason: None,
            memory: Memory::default(),
            origin: None,
            bias_memory: (Vector3::zeros(), Vector3::zeros()),
            covariance: NavCovariance::zeros(),
            bias_variances: BiasVariances::zeros(),
            inherited: Inherited::default(),
            carried: None,
            velocity: Velocity::NotYet,
            time_offset_sigma_s: setup.rig.time_offset_sigma_s,
            reset_counter: 0,
            first_counter: 0,
            mono_wait: 0,
            rate_b: Vector3::zeros(),
            frames: 0,
            solved: SolvedFrame::default(),
            keeps_steps: false,
            step: None,
            noise_scale: NoiseScale::new(ImuNoise::of(imu), setup.camera.len()),
            vibration: Vibration::default(),
            window,
        }
    }

    fn biases(&self) -> (Vector3<f64>, Vector3<f64>) {
        match (self.phase, self.window.frames.last()) {
            (Phase::Running, Some(frame)) => (frame.nav.bias_gyro, frame.nav.bias_accel),
            _ => self.bias_memory,
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
            self.forget_time();
            self.start_anew(ResetReason::ClockSet);
        }
        if let Some(kind) = tracked.reset {
            self.start_anew(ResetReason::AskedFor(kind));
        }
        for sample in &tracked.samples {
            self.imu.push(sample);
            self.rotation.add(sample);
        }
        self.solved.keyframes.clear();
        self.solved.steps.clear();
        self.solved.lines.clear();
        let estimate = self.step(tracked, probe);
        self.write_feedback(&estimate, feedback);
        self.write_known(tracked.is_repeating, &estimate, feedback);
        self.frames += 1;
        estimate
    }

    fn step(&mut self, tracked: &Tracked, probe: &mut impl StageProbe) -> Estimate {
        let stamp = tracked.time.stamp;
        let mut health = tracked.health;
        if self.last_stamp.is_some_and(|last| stamp <= last) {
            health.insert(HealthBits::BAD_STAMP);
        }
        if health.contains(HealthBits::BAD_STAMP) {
            return self.estimate(tracked, health, Solved::default());
        }
        self.check_hole(stamp);
        if tracked.budget != WorkBudget::FULL {
            health.insert(HealthBits::DEGRADED);
        }
        self.check_points(&tracked.points, &mut health);
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
            self.window.make_room();
        }
        probe.end(Stage::Marginalize);
        self.last_stamp = Some(stamp);
        self.estimate(tracked, health, solved)
    }

    fn write_feedback(&mut self, estimate: &Estimate, feedback: &mut Feedback) {
        let outliers = self.window.outliers();
        feedback.wrong_points.clone_from(&outliers.points);
        feedback.wrong_lines.clone_from(&outliers.lines);
        let rig = &self.window.rig;
        feedback.pose_b_c = [rig.pose_b_c(0), rig.pose_b_c(1)];
        feedback.time_offset_s = rig.time_offset_s;
        feedback.bias_gyro = self.biases().0;
        feedback.turn_rate_b = self.turn_rate_b();
        feedback.distrusts_imu = self.rotation.is_distrusting();
        feedback.untracked_camera = self.untracked_camera();
        feedback.reset_counter = self.reset_counter;
        self.solved.index = self.frames;
        self.solved.sequence = estimate.frame_sequence;
        self.solved.stamp = estimate.stamp;
        self.solved.pose_o_b = estimate.pose().copied();
        self.solved.is_keyframe = estimate.figures.is_keyframe;
        self.solved.reset_counter = estimate.reset_counter;
        feedback.solved.clone_from(&self.solved);
    }

    /// Writes down the keyframes of the window, their last steps and their lines, before any of them makes room.
    fn note_keyframes(&mut self) {
        let window = &mut self.window;
        let is_keyframe = |k: &usize| window.frames[*k].is_keyframe;
        let mut newest: heapless::Vec<usize, 3> =
            (0..window.frames.len()).rev().filter(is_keyframe).take(3).collect();
        newest.reverse();
        for frame in window.frames.iter().filter(|f| f.is_keyframe) {
            let keyframe = SnapshotKeyframe { stamp: frame.stamp, pose_o_b: frame.pose_at_stamp() };
            let _ = self.solved.keyframes.push(keyframe);
        }
        self.solved.lines.extend(window.snapshot_lines().take(self.solved.lines.capacity()));
        for pair in newest.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let Some(covariance) = window.relative_covariance(from, to) else { continue };
            let (from, to) = (window.frames[from].stamp, window.frames[to].stamp);
            let _ = self.solved.steps.push(KeyframeStep { from, to, covariance });
        }
    }

    fn check_points(&mut self, observations: &[PointObservation], health: &mut HealthBits) {
        let shared = observations.iter().filter(|o| o.px.iter().all(Option::is_some)).count();
        self.pair.update(observations.len(), shared, health);
        match observations.len() {
            0 => health.insert(HealthBits::NO_FEATURES),
            n if n < FEW_LANDMARKS => health.insert(HealthBits::LOW_FEATURES),
            _ => {}
        }
    }

    /// Measurements of the frame, and whether the vehicle stands still.
    fn measure(&mut self, tracked: &Tracked, health: &mut HealthBits) {
        let (stamp, observations) = (tracked.time.stamp, &tracked.points);
        let last = self.last_stamp.unwrap_or(stamp);
        let dt_s = stamp.seconds_since(last);
        if dt_s > FRAME_GAP_PERIODS * self.options.frame_period_s {
            health.insert(HealthBits::FRAME_GAP);
        }
        let imu_mean = self.imu.mean(last.plus_nanos(-1), stamp);
        let bias_gyro = self.biases().0;
        let rate_b = imu_mean.map_or_else(Vector3::zeros, |(gyro, _)| gyro - bias_gyro);
        let rate_c = [0, 1].map(|c| self.window.rig.pose_b_c(c).rotation.inverse() * rate_b);
        self.rate_b = self.rate_at(last, stamp, &bias_gyro);
        if self.blur_px() > BLURRED_PX {
            health.insert(HealthBits::BLURRED);
        }
        self.vibration = self.imu.vibration(stamp);
        // The front-end does not know the outliers of the frame before yet.
        let outliers = self.window.outliers();
        self.measurer.measure_points(observations, &outliers.points, &rate_c);
        self.measurer.measure_lines(&tracked.lines, &outliers.lines, &rate_c);
        let (points, lines) = self.measurer.tracks_mut();
        self.window.correct_intrinsics(points, lines);
        let flow = self.measurer.median_flow(observations);
        let known_bias = (self.phase == Phase::Running).then_some(&bias_gyro);
        let depth_m = match self.phase {
            Phase::Running => self.measurer.median_depth_m(&self.window.points),
            Phase::Gathering => 0.0,
        };
        self.zero_velocity.update(flow, imu_mean, known_bias, self.options.gravity_m_s2, depth_m);
        if self.zero_velocity.is_still() {
            health.insert(HealthBits::STATIONARY);
        }
        if let (Phase::Gathering, [.., earlier, _]) = (self.phase, self.gathering.frames()) {
            let span_s = stamp.seconds_since(earlier.time.stamp);
            let moments = self.measurer.epipolar_moments(observations, &self.window.rig, span_s);
            self.pair_time.add(stamp, moments, self.options.frame_period_s);
        }
        self.measurer.remember(observations);
    }

    /// Way of what the middle of the left image shows during an exposure, by the turn of the camera, px.
    fn blur_px(&self) -> f64 {
        let rate_c = self.window.rig.pose_b_c(0).rotation.inverse() * self.rate_b;
        rate_c.xy().norm() * self.exposure_s * self.focal_px
    }

    /// Angular rate of the body at `stamp`, bias removed, rad/s: by the newest samples, so that the image rates predicted
    /// by it, and with them the Jacobian of the time offset, are those of the frame and not of the interval before it.
    /// Where none was measured since the frame before, `last`, it is that of the turn between the last frames.
    fn rate_at(&self, last: Timestamp, stamp: Timestamp, bias_gyro: &Vector3<f64>) -> Vector3<f64> {
        let newest = self.imu.mean_rate(stamp.plus_seconds(-RATE_SPAN_S), stamp);
        let gyro = newest.or_else(|| self.imu.mean_rate(last.plus_nanos(-1), stamp));
        gyro.map_or_else(|| self.turn_rate_b(), |gyro| gyro - bias_gyro)
    }

    /// Before the first state: gathers the frame and tries to start.
    fn gather(&mut self, time: FrameTime, health: &mut HealthBits) -> Solved {
        let stamp = time.stamp;
        self.expect_vibration();
        let motion = self.last_stamp.map(|last| {
            let zero = Vector3::zeros();
            self.imu.preintegrate(last, stamp, &zero, &zero, &self.noise)
        });
        if motion.as_ref().is_some_and(|(_, coverage)| coverage.has_gap) {
            health.insert(HealthBits::IMU_GAP);
            self.gathering.clear();
        }
        if let Some((_, coverage)) = &motion
            && (report_stuck(self.imu.stuck(), health) || coverage.unmeasured.is_any())
        {
            // A start needs gravity, and turns between its frames.
            self.gathering.clear();
        }
        self.carry_attitude(stamp);
        self.judge_gathered_pair(stamp, health);
        self.gathering.push(time, self.measurer.points(), motion.map(|m| m.0), self.rate_b + self.biases().0);
        if self.try_start() {
            self.phase = Phase::Running;
            self.velocity = Velocity::NotYet;
            (self.last_seen, self.begun) = (Some(stamp), Some(stamp));
            self.gathering.clear();
            self.begin_with_inheritance(stamp);
            self.refresh_covariance(health);
            self.judge_velocity();
            self.note_keyframes();
            return Solved { iterations: 0, is_keyframe: true };
        }
        Solved::default()
    }

    /// Carries a running estimate over one frame.
    fn run(&mut self, time: FrameTime, max_iterations: usize, health: &mut HealthBits) -> Solved {
        let stamp = time.stamp;
        let Some(last) = self.window.frames.last() else { return Solved::default() };
        let (motion, coverage) =
            self.imu.preintegrate(last.taken, stamp, &last.nav.bias_gyro, &last.nav.bias_accel, &self.noise);
        if coverage.has_gap {
            health.insert(HealthBits::IMU_GAP);
        }
        if coverage.is_saturated {
            health.insert(HealthBits::IMU_SATURATED);
        }
        if coverage.has_gap || coverage.unmeasured.is_any() {
            self.sudden_force.forget_forces();
            self.stilled_force.forget_forces();
        } else {
            self.sudden_force.update([last.taken, stamp], &last.nav.rot_o_b, &motion);
            let density = self.noise_scale.stated().accel_density;
            self.stilled_force.update(stamp, &last.nav.rot_o_b, &motion, density);
        }
        let time_variance = 2.0 * self.rotation.stamp_sigma_s().squared();
        let motion = self.with_uncertain_ends(motion, &last.nav, &self.rate_b, time_variance);
        let prediction = self.predict(&last.nav, &motion);
        let nav = prediction.nav.clone();
        let gyro_b = self.rate_b + nav.bias_gyro;
        self.window.push_frame(time, nav, Some(motion), self.zero_velocity.is_still());
        self.window.set_gyro_of_newest(gyro_b);
        let (tracks, lines) = (self.measurer.points(), self.measurer.lines());
        let connected = self.window.observe(tracks, lines);
        self.window.unroll_newest();
        self.window.clear_outliers();
        let (prediction, known) = self.correct_stamp(prediction, coverage);
        let is_pair_doubtful = self.is_pair_doubtful(stamp, health);
        if is_pair_doubtful {
            // Before anything rests on the image that may be left out.
            self.window.predict_rates();
            self.judge_pair(stamp, health);
        }
        let known = known.filter(|_| !is_pair_doubtful);
        let (trial, is_dropped) = self.try_prediction(&prediction, known, coverage, health);
        self.judge_turn(trial.as_ref(), is_dropped, coverage, health);
        let (tracks, lines) = (self.measurer.points(), self.measurer.lines());
        let is_keyframe = self.window.needs_keyframe(connected, tracks.len());
        if is_keyframe {
            self.window.make_keyframe(tracks, lines);
        }
        self.window.triangulate(false);
        self.window.predict_rates();
        if !is_pair_doubtful {
            self.judge_pair(stamp, health);
        }
        self.window.update_manhattan(self.measurer.lines(), self.tilt_sigma_rad());
        let max_iterations = self.options.max_iterations.min(max_iterations);
        let outcome = self.window.optimize(max_iterations);
        if outcome.is_not_positive_definite {
            health.insert(HealthBits::NOT_POSITIVE_DEFINITE);
            self.forces.prolong_suspicion(stamp);
            self.stilled_force.prolong_suspicion(stamp);
        }
        let is_contradicted =
            self.window.is_newest_doubtful() && self.window.doubt_newest_motion(max_iterations);
        if is_contradicted {
            health.insert(HealthBits::IMU_CONTRADICTED);
        }
        self.window.remove_minority();
        if coverage.has_gap && connected < MIN_WITNESSES_OF_GAP {
            self.carry_covariance();
            self.keep_prediction(prediction);
        } else {
            self.refresh_covariance(health);
            let is_measured = !coverage.has_gap && !coverage.unmeasured.is_any();
            self.scale_noise(&prediction, (is_measured, is_contradicted), health);
            self.note_step();
        }
        if is_keyframe {
            self.note_keyframes();
        }
        self.judge(stamp, health);
        Solved { iterations: outcome.iterations, is_keyframe }
    }

    /// The motion from `from` at the angular rate `rate_b`, rad/s, whose ends are at times that are uncertain by `variance`, s², together: an
    /// error moves the vehicle along.
    fn with_uncertain_ends(
        &self,
        mut motion: Preintegration,
        from: &NavState,
        rate_b: &Vector3<f64>,
        variance: f64,
    ) -> Preintegration {
        if variance > 0.0 {
            let v_b = from.rot_o_b.inverse_transform_vector(&from.v_o_b);
            let gain = motion.delta_v / motion.dt_s
                + from.rot_o_b.inverse_transform_vector(&self.window.options.gravity_o);
            let mut by_stamp = SVector::<f64, 9>::zeros();
            by_stamp.fixed_rows_mut::<3>(NavState::P).copy_from(&v_b);
            by_stamp.fixed_rows_mut::<3>(NavState::ROT).copy_from(rate_b);
            by_stamp.fixed_rows_mut::<3>(NavState::V).copy_from(&gain);
            motion.covariance += by_stamp * by_stamp.transpose() * variance;
        }
        motion
    }

    /// The quality, bounded while sensors contradict each other.
    fn trusted_quality(&self, in_view: usize) -> i8 {
        let quality = self.rotation.bounded(self.quality(in_view));
        self.scale.bounded(self.pair_time.bounded(self.forces.bounded(quality)))
    }

    /// The rig's calibration as refined so far, with its covariance; `None` while there is no pose.
    pub fn rig_estimate(&mut self) -> Option<RigEstimate> {
        (self.phase == Phase::Running).then(|| self.window.rig_estimate()).flatten()
    }

    /// Fit of the newest frame ([`Fit`]); `None` while there is no pose.
    pub fn newest_fit(&mut self) -> Option<Fit> {
        (self.phase == Phase::Running).then(|| self.window.newest_fit())
    }

    fn estimate(&self, tracked: &Tracked, health: HealthBits, solved: Solved) -> Estimate {
        let running = self.phase == Phase::Running;
        let nav = self.nav_at_stamp();
        let in_view = self.landmarks_in_view();
        let (points, lines) = self.window.triangulated();
        let state = match self.velocity {
            Velocity::Known if running => TrackingState::Tracking,
            Velocity::NoMore if running => TrackingState::Blind,
            _ if self.reset_counter > self.first_counter => TrackingState::Failed,
            _ => TrackingState::Initialising,
        };
        let has_pose = matches!(state, TrackingState::Tracking | TrackingState::Blind);
        Estimate {
            frame_sequence: tracked.sequence,
            stamp: tracked.time.stamp,
            state,
            pose_o_b: nav.pose_o_b(),
            v_o_b: nav.v_o_b,
            bias_gyro: nav.bias_gyro,
            bias_accel: nav.bias_accel,
            covariance: self.stated_covariance(),
            origin: self.inherited.origin().clone(),
            bias_variances: self.bias_variances,
            time_offset_s: self.window.rig.time_offset_s,
            time_offset_sigma_s: self.time_offset_sigma_s,
            pose_b_c0: self.window.rig.pose_b_c0,
            quality: if has_pose { self.trusted_quality(in_view) } else { -1 },
            health,
            reset_counter: self.reset_counter,
            figures: FrameFigures {
                points_in_window: points as u32,
                lines_in_window: lines as u32,
                lines_in_structure: self.window.structural_lines() as u32,
                keyframes: self.window.frames.iter().filter(|f| f.is_keyframe).count() as u32,
                iterations: solved.iterations,
                is_keyframe: solved.is_keyframe,
                ..tracked.figures
            },
        }
    }
}
