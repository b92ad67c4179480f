//! The odometer: from tracked points, lines and inertial samples to one estimate a frame.
//!
//! It gathers frames until there is a start ([`start`]), then carries each frame through the window:
//! predict by the IMU, link tracks to landmarks, choose keyframes, optimise, drop outliers, judge its own
//! health, make room. It sees no image: points come from [`crate::points`], lines from [`crate::lines`], or
//! both from a test.

pub mod measure;
mod start;
pub mod stillness;
#[cfg(test)]
mod synthetic;
#[cfg(test)]
mod tests;

use crate::estimate::{Estimate, FrameFigures, HealthBits, NavCovariance, Stage, StageProbe, TrackingState};
use crate::facade::ResetKind;
use crate::inertial::{ImuBuffer, ImuNoise};
use crate::initial::Gathering;
use crate::lines::LineObservation;
use crate::points::PointObservation;
use crate::window::feature::Feature;
use crate::window::landmark::LandmarkStore;
use crate::window::state::NavState;
use crate::window::{Outliers, Window};
use measure::Measurer;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::options::HealthConfig;
use plumbline_config::{CameraModel, Config, Timestamp};
use stillness::Stillness;

/// Inertial samples are kept this long, s: the longest start and the longest gap between frames.
const IMU_MEMORY_S: f64 = 10.0;
/// Fewest landmarks in view that hold an estimate against drift.
const MIN_LANDMARKS_IN_VIEW: usize = 5;
/// Landmarks in view below which the estimate is weak.
const FEW_LANDMARKS: usize = 20;
/// Landmarks in view that give full quality.
const PLENTY_LANDMARKS: f64 = 60.0;
/// Frames further apart than this many periods have lost frames between them.
const FRAME_GAP_PERIODS: f64 = 1.5;
/// Time offsets beyond this are not believed, s.
const MAX_TIME_OFFSET_S: f64 = 0.05;

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

/// Whether there is a state.
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
    /// Inertial samples.
    pub imu: ImuBuffer,
    /// The window.
    pub window: Window,
    measurer: Measurer,
    gathering: Gathering,
    stillness: Stillness,
    phase: Phase,
    last_stamp: Option<Timestamp>,
    last_seen: Option<Timestamp>,
    last_reset: Option<Timestamp>,
    origin: Option<NavState>,
    bias_memory: (Vector3<f64>, Vector3<f64>),
    covariance: NavCovariance,
    time_offset_sigma_s: f64,
    reset_counter: u32,
    mono_wait: usize,
    rate_b: Vector3<f64>,
}

impl Odometer {
    /// Allocates everything the configuration asks for.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let cameras: Vec<CameraModel> = config.camera.iter().map(|c| c.model()).collect();
        let initial = &config.estimator.initial;
        let rate_hz = config.camera[0].rate_hz;
        let gathered = ((initial.mono_window_s * rate_hz * 1.5) as usize).max(initial.stereo_frames) + 2;
        let points = config.estimator.points.max_points;
        let imu = &config.imu;
        let mut window = Window::new(config);
        window.clear();
        Self {
            options: Options {
                stereo_frames: initial.stereo_frames,
                mono_window_s: initial.mono_window_s,
                mono_min_parallax_px: initial.mono_min_parallax_px,
                sigma_px: config.estimator.points.sigma_px,
                bias_gyro_sigma: imu.gyro_bias_sigma_rad_s,
                bias_accel_sigma: imu.accel_bias_sigma_m_s2,
                gravity_m_s2: imu.gravity_m_s2,
                frame_period_s: 1.0 / rate_hz,
                health: config.estimator.health.clone(),
                max_iterations: config.estimator.window.max_iterations,
            },
            noise: ImuNoise::of(imu),
            focal_px: cameras[0].focal_px.x,
            imu: ImuBuffer::new(IMU_MEMORY_S, imu.rate_hz, imu.gyro_range_rad_s, imu.accel_range_m_s2),
            measurer: Measurer::new(cameras, &config.estimator.points, &config.estimator.lines),
            gathering: Gathering::new(gathered, points),
            stillness: Stillness::default(),
            phase: Phase::Gathering,
            last_stamp: None,
            last_seen: None,
            last_reset: None,
            origin: None,
            bias_memory: (Vector3::zeros(), Vector3::zeros()),
            covariance: NavCovariance::zeros(),
            time_offset_sigma_s: config.rig.time_offset_sigma_s,
            reset_counter: 0,
            mono_wait: 0,
            rate_b: Vector3::zeros(),
            window,
        }
    }

    /// Time of an image on the IMU's axis, by the present time offset.
    #[must_use]
    pub fn imu_stamp(&self, image_stamp: Timestamp) -> Timestamp {
        image_stamp.plus_seconds(self.window.rig.time_offset_s.clamp(-MAX_TIME_OFFSET_S, MAX_TIME_OFFSET_S))
    }

    /// Rotation of the body from the frame before to `stamp` by the gyroscope, `R_prev_cur`.
    #[must_use]
    pub fn predicted_rotation(&self, stamp: Timestamp) -> UnitQuaternion<f64> {
        let Some(last) = self.last_stamp.filter(|last| stamp > *last) else {
            return UnitQuaternion::identity();
        };
        let (gyro, accel) = self.biases();
        self.imu.preintegrate(last, stamp, &gyro, &accel, &self.noise).0.delta_rot
    }

    fn biases(&self) -> (Vector3<f64>, Vector3<f64>) {
        match (self.phase, self.window.frames.last()) {
            (Phase::Running, Some(frame)) => (frame.nav.bias_gyro, frame.nav.bias_accel),
            _ => self.bias_memory,
        }
    }

    /// Takes the points and lines of the frame at `stamp` (on the IMU's axis) and returns the estimate after
    /// it.
    pub fn process(
        &mut self,
        sequence: u64,
        stamp: Timestamp,
        observations: &[PointObservation],
        lines: &[LineObservation],
        probe: &mut impl StageProbe,
    ) -> Estimate {
        let mut health = HealthBits::default();
        if self.last_stamp.is_some_and(|last| stamp <= last) {
            health.insert(HealthBits::BAD_STAMP);
            return self.estimate(sequence, stamp, health, FrameFigures::default());
        }
        self.check_points(observations, &mut health);
        probe.begin(Stage::Window);
        self.measure(stamp, observations, lines, &mut health);
        let mut figures = match self.phase {
            Phase::Running => self.run(stamp, &mut health),
            Phase::Gathering => self.gather(stamp, &mut health),
        };
        probe.end(Stage::Window);
        probe.begin(Stage::Marginalize);
        if self.phase == Phase::Running {
            self.window.make_room();
        }
        probe.end(Stage::Marginalize);
        figures.points_tracked = observations.len() as u32;
        figures.points_stereo =
            observations.iter().filter(|o| o.px.iter().all(Option::is_some)).count() as u32;
        let (points, lines_in_window) = self.window.triangulated();
        figures.points_in_window = points as u32;
        figures.lines_in_window = lines_in_window as u32;
        figures.lines_in_structure = self.window.lines_in_structure() as u32;
        figures.keyframes = self.window.frames.iter().filter(|f| f.is_keyframe).count() as u32;
        self.last_stamp = Some(stamp);
        self.estimate(sequence, stamp, health, figures)
    }

    fn check_points(&self, observations: &[PointObservation], health: &mut HealthBits) {
        match observations.len() {
            0 => health.insert(HealthBits::NO_FEATURES),
            n if n < FEW_LANDMARKS => health.insert(HealthBits::LOW_FEATURES),
            _ => {}
        }
    }

    /// Measurements of the frame, and whether the vehicle stands still.
    fn measure(
        &mut self,
        stamp: Timestamp,
        observations: &[PointObservation],
        lines: &[LineObservation],
        health: &mut HealthBits,
    ) {
        let last = self.last_stamp.unwrap_or(stamp);
        let dt_s = stamp.seconds_since(last);
        if dt_s > FRAME_GAP_PERIODS * self.options.frame_period_s {
            health.insert(HealthBits::FRAME_GAP);
        }
        let imu_mean = self.imu.mean(last.plus_nanos(-1), stamp);
        let bias_gyro = self.biases().0;
        let rate_b = imu_mean.map_or_else(Vector3::zeros, |(gyro, _)| gyro - bias_gyro);
        let rate_c = [0, 1].map(|c| self.window.rig.pose_b_c(c).rotation.inverse() * rate_b);
        self.rate_b = rate_b;
        self.measurer.take(observations, &rate_c);
        self.measurer.take_lines(lines, &rate_c);
        let flow = self.measurer.median_flow(observations);
        let known_bias = (self.phase == Phase::Running).then_some(&bias_gyro);
        self.stillness.update(flow, imu_mean, known_bias, self.options.gravity_m_s2);
        if self.stillness.is_still() {
            health.insert(HealthBits::STATIONARY);
        }
        self.measurer.remember(observations);
    }

    /// Before the first state: gathers the frame and tries to start.
    fn gather(&mut self, stamp: Timestamp, health: &mut HealthBits) -> FrameFigures {
        let motion = self.last_stamp.map(|last| {
            let zero = Vector3::zeros();
            self.imu.preintegrate(last, stamp, &zero, &zero, &self.noise)
        });
        if motion.as_ref().is_some_and(|(_, coverage)| coverage.has_gap) {
            health.insert(HealthBits::IMU_GAP);
            self.gathering.clear();
        }
        self.gathering.push(stamp, self.measurer.points(), motion.map(|m| m.0));
        if self.try_start() {
            self.phase = Phase::Running;
            self.last_seen = Some(stamp);
            self.gathering.clear();
            self.refresh_covariance(health);
            return FrameFigures { is_keyframe: true, ..FrameFigures::default() };
        }
        FrameFigures::default()
    }

    /// Carries a running estimate over one frame.
    fn run(&mut self, stamp: Timestamp, health: &mut HealthBits) -> FrameFigures {
        let Some(last) = self.window.frames.last() else { return FrameFigures::default() };
        let (motion, coverage) =
            self.imu.preintegrate(last.stamp, stamp, &last.nav.bias_gyro, &last.nav.bias_accel, &self.noise);
        if coverage.has_gap {
            health.insert(HealthBits::IMU_GAP);
        }
        if coverage.is_saturated {
            health.insert(HealthBits::IMU_SATURATED);
        }
        let nav = last.nav.after(&motion, &self.window.options.gravity_o);
        self.window.push_frame(stamp, nav, Some(motion), self.stillness.is_still());
        let (tracks, lines) = (self.measurer.points(), self.measurer.lines());
        let connected = self.window.observe(tracks, lines);
        let is_keyframe = self.window.needs_keyframe(connected, tracks.len());
        if is_keyframe {
            self.window.make_keyframe(tracks, lines);
        }
        self.window.clear_outliers();
        self.window.triangulate(false);
        self.window.predict_rates(&self.rate_b);
        self.window.follow_structure(self.measurer.lines());
        let outcome = self.window.optimize(self.options.max_iterations);
        if outcome.is_not_positive_definite {
            health.insert(HealthBits::NOT_POSITIVE_DEFINITE);
        }
        self.window.remove_outliers();
        self.refresh_covariance(health);
        self.judge(stamp, health);
        FrameFigures { iterations: outcome.iterations, is_keyframe, ..FrameFigures::default() }
    }

    /// Tracks that the window found to be no points or lines of the scene.
    #[must_use]
    pub fn outliers(&self) -> &Outliers {
        self.window.outliers()
    }

    /// Resets so far.
    #[must_use]
    pub fn reset_counter(&self) -> u32 {
        self.reset_counter
    }

    fn refresh_covariance(&mut self, health: &mut HealthBits) {
        match self.window.newest_covariance() {
            Some((covariance, variance)) if (0..9).all(|k| covariance[(k, k)] > 0.0) => {
                self.covariance = covariance;
                self.time_offset_sigma_s = variance.max(0.0).sqrt();
            }
            _ => health.insert(HealthBits::NOT_POSITIVE_DEFINITE),
        }
    }

    /// Landmarks seen in the newest frame.
    fn landmarks_in_view(&self) -> usize {
        let Some(newest) = self.window.frames.len().checked_sub(1) else { return 0 };
        in_view(&self.window.points, newest) + in_view(&self.window.lines, newest)
    }

    /// Resets when the estimate cannot be right, or has been blind for too long.
    fn judge(&mut self, stamp: Timestamp, health: &mut HealthBits) {
        if self.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW {
            self.last_seen = Some(stamp);
        }
        let velocity_sigma = (6..9).map(|k| self.covariance[(k, k)]).fold(0.0, f64::max).sqrt();
        if velocity_sigma > self.options.health.max_velocity_sigma_m_s {
            health.insert(HealthBits::VELOCITY_UNCERTAIN);
        }
        let is_held = self
            .last_reset
            .is_some_and(|last| stamp.seconds_since(last) < self.options.health.reset_holdoff_s);
        let is_blind_too_long =
            self.last_seen.is_some_and(|seen| stamp.seconds_since(seen) > self.options.health.max_blind_s);
        if !self.is_plausible() || (is_blind_too_long && !is_held) {
            self.reset(ResetKind::Soft);
            self.last_reset = Some(stamp);
        }
    }

    /// Whether speed and biases are ones that a vehicle can have.
    fn is_plausible(&self) -> bool {
        let health = &self.options.health;
        self.window.frames.last().is_some_and(|frame| {
            let nav = &frame.nav;
            nav.p_o_b.iter().all(|x| x.is_finite())
                && nav.v_o_b.norm() < health.max_speed_m_s
                && nav.bias_gyro.norm() < health.max_gyro_bias_rad_s
                && nav.bias_accel.norm() < health.max_accel_bias_m_s2
        })
    }

    /// Starts anew: soft keeps the newest pose as the origin of the new start.
    pub fn reset(&mut self, kind: ResetKind) {
        let newest = self.window.frames.last().map(|f| f.nav.clone());
        self.origin = match kind {
            ResetKind::Soft => {
                newest.or_else(|| self.origin.take()).filter(|n| n.p_o_b.iter().all(|x| x.is_finite()))
            }
            ResetKind::Hard => None,
        };
        self.phase = Phase::Gathering;
        self.window.clear();
        self.gathering.clear();
        self.measurer.clear();
        self.stillness = Stillness::default();
        self.reset_counter += 1;
    }

    fn estimate(
        &self,
        sequence: u64,
        stamp: Timestamp,
        health: HealthBits,
        figures: FrameFigures,
    ) -> Estimate {
        let running = self.phase == Phase::Running;
        let nav = self.window.frames.last().map(|f| f.nav.clone()).unwrap_or_default();
        let in_view = self.landmarks_in_view();
        let state = match (running, in_view >= MIN_LANDMARKS_IN_VIEW) {
            (true, true) => TrackingState::Tracking,
            (true, false) => TrackingState::Blind,
            (false, _) if self.reset_counter > 0 => TrackingState::Failed,
            (false, _) => TrackingState::Initialising,
        };
        Estimate {
            frame_sequence: sequence,
            stamp,
            state,
            pose_o_b: nav.pose_o_b(),
            v_o_b: nav.v_o_b,
            bias_gyro: nav.bias_gyro,
            bias_accel: nav.bias_accel,
            covariance: self.covariance,
            time_offset_s: self.window.rig.time_offset_s,
            time_offset_sigma_s: self.time_offset_sigma_s,
            pose_b_c0: self.window.rig.pose_b_c0,
            quality: if running { self.quality(in_view) } else { -1 },
            health,
            reset_counter: self.reset_counter,
            figures,
        }
    }

    /// 0..=100 from landmarks in view and the certainty of the velocity.
    fn quality(&self, in_view: usize) -> i8 {
        let by_landmarks = (in_view as f64 / PLENTY_LANDMARKS).min(1.0);
        let velocity_sigma = (6..9).map(|k| self.covariance[(k, k)]).fold(0.0, f64::max).sqrt();
        let by_velocity = (1.0 - velocity_sigma / self.options.health.max_velocity_sigma_m_s).clamp(0.0, 1.0);
        (100.0 * by_landmarks.min(by_velocity)).round() as i8
    }
}

/// Landmarks with a depth that a frame sees.
fn in_view<F: Feature>(store: &LandmarkStore<F>, frame: usize) -> usize {
    let is_seen = |l: &&crate::window::landmark::Landmark<F>| {
        l.is_triangulated && l.observations.iter().any(|o| usize::from(o.frame) == frame)
    };
    store.all().iter().filter(is_seen).count()
}
