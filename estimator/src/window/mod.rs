//! The sliding window: keyframes and recent frames, landmarks, and the prior of what has left.
//!
//! States are a full navigation state for every frame (position, attitude, velocity, biases), the rig's
//! calibration and time offset, point landmarks as bearing and inverse depth in a host keyframe, and lines
//! in the orthonormal representation there. The cost is that of the paper's equation 13: prior,
//! preintegrated IMU between consecutive frames, and robust reprojection terms.
//!
//! - [`state`], [`frame`], [`landmark`], [`feature`]: what is estimated
//! - [`reprojection`], [`mod@line`], [`inertial_factor`], [`zero_velocity_factor`], [`prior`]: the
//!   factors, each with its residual and its Jacobians ([`factor`])
//! - `tracks`: how tracks become landmarks
//! - [`problem`], [`poses`], [`camera_poses`], [`motions`], [`linearize`] with `camera_sums` and `landmark_sums`,
//!   [`eliminate`], [`dense`], [`factorization`], [`solve`]: normal equations and their solution
//! - `doubt`: a frame that is contradicted as a whole
//! - [`triangulate`], [`triangulate_line`], [`keyframes`], [`marginalize`]: what enters and what leaves
//! - [`calibration`]: uncertainty of the rig; `rig_walk`: its slow growth; [`growth`], `bias_walk`: growth of a state's uncertainty
//!   without images

mod bias_walk;
pub(crate) mod calibration;
pub(crate) mod camera_poses;
mod camera_sums;
pub(crate) mod dense;
mod doubt;
pub(crate) mod eliminate;
pub(crate) mod epipolar;
pub(crate) mod factor;
pub(crate) mod factorization;
pub(crate) mod feature;
pub(crate) mod frame;
pub(crate) mod growth;
pub(crate) mod image_shift;
pub(crate) mod inertial_factor;
pub(crate) mod keyframes;
pub(crate) mod landmark;
mod landmark_sums;
pub(crate) mod lens;
pub(crate) mod line;
pub(crate) mod linearize;
pub(crate) mod marginalize;
pub(crate) mod motions;
mod moving;
#[cfg(test)]
mod null_space_tests;
pub(crate) mod options;
pub(crate) mod poses;
pub(crate) mod prior;
pub(crate) mod problem;
mod quad;
mod refined_lens;
pub(crate) mod relative;
pub(crate) mod reprojection;
mod rig_walk;
pub(crate) mod seen_by_row;
pub(crate) mod sighting;
pub mod snapshot;
pub(crate) mod solve;
pub mod state;
#[cfg(test)]
mod test_dense;
#[cfg(test)]
mod test_room;
#[cfg(test)]
mod test_views;
mod tiles;
pub(crate) mod tracks;
pub mod trail;
pub(crate) mod trial;
pub(crate) mod triangulate;
pub(crate) mod triangulate_line;
pub(crate) mod zero_velocity_factor;

pub use options::Options;
pub use state::MAX_FRAMES;

use crate::geometry::yaw_of;
use crate::inertial::{ImuNoise, Preintegration};
use frame::Frame;
use inertial_factor::InertialFactor;
use landmark::{LandmarkStore, LineLandmark, PointLandmark};
use line::{HostedLine, LineMeasurement};
use linearize::Linearizer;
use nalgebra::{SVector, UnitQuaternion, Vector3};
use plumbline_config::{Timestamp, ValidSetup};
use prior::{AnchorSigmas, AnchorState, Prior};
use problem::Problem;
use reprojection::{InversePoint, PointMeasurement};
use rig_walk::RigWalk;
use state::{FrameTime, Mount, NavState, Rig, unknown_of_frame};

/// An observation this far from its landmark is an outlier, in standard deviations.
const OUTLIER_SIGMAS: f64 = 6.0;

/// A refined calibration this far from the configured one, in standard deviations of that, is that of a diverged estimate.
const RIG_SIGMAS: f64 = 4.0;

/// The sliding window and all the memory it ever needs.
#[derive(Clone, Debug)]
pub struct Window {
    /// Calibration.
    pub rig: Rig,
    /// Frames in order of time.
    pub frames: Vec<Frame>,
    /// Points.
    pub points: LandmarkStore<InversePoint>,
    /// Lines.
    pub lines: LandmarkStore<HostedLine>,
    /// Prior from all that has left the window.
    pub prior: Prior,
    /// Options.
    pub options: Options,
    /// Noise of the inertial factors to come: as stated, or as it shows.
    pub imu_noise: ImuNoise,
    anchor: Option<Anchor>,
    linearizer: Linearizer,
    factor: factorization::Factor,
    backup: solve::Backup,
    solution: Vec<f64>,
    rehosted: (Vec<PointLandmark>, Vec<LineLandmark>),
    outliers: Outliers,
    configured_rig: Rig,
    /// Knowledge of the rig at the present start.
    known_rig: calibration::KnownRig,
    /// Rig about which the configured standard deviations hold: the configured one, or where nothing was kept through a reset, that of then.
    assumed_rig: Rig,
    /// Knowledge of the rig for the next start.
    kept_rig: Option<calibration::KnownRig>,
    /// When things were last seen to move.
    last_motion: Option<Timestamp>,
    /// Step of the newest frame, m, rad, m/s, that a solution which ended early left undone.
    unfinished: Option<SVector<f64, 9>>,
    /// Damping after a rejected step.
    first_damping: f64,
    rig_walk: RigWalk,
}

/// The frame whose pose defines the odometry frame, and the prior about it.
#[derive(Clone, Debug)]
struct Anchor {
    frame: usize,
    known: AnchorState,
    sigmas: AnchorSigmas,
}

/// A track seen in the newest frame, ready for the window.
#[derive(Clone, Copy, Debug)]
pub struct TrackMeasurement<M> {
    /// The track.
    pub track_id: u32,
    /// Measurement of each camera.
    pub measured: [Option<M>; 2],
}

impl<M> TrackMeasurement<M> {
    /// Leaves out what `camera` saw; returns whether anything is left.
    pub fn leave_out(&mut self, camera: usize) -> bool {
        self.measured[camera] = None;
        self.measured.iter().any(Option::is_some)
    }
}

/// A tracked point in the newest frame.
pub type PointTrack = TrackMeasurement<PointMeasurement>;
/// A tracked line in the newest frame.
pub type LineTrack = TrackMeasurement<LineMeasurement>;

/// Tracks whose newest observation does not fit.
#[derive(Clone, Debug)]
pub struct Outliers {
    /// Track ids of points.
    pub points: Vec<u32>,
    /// Track ids of lines.
    pub lines: Vec<u32>,
}

impl Outliers {
    /// Room for twice the landmarks: the observation of either camera may be an outlier.
    fn new(points: usize, lines: usize) -> Self {
        Self { points: Vec::with_capacity(2 * points), lines: Vec::with_capacity(2 * lines) }
    }
}

impl Window {
    /// An empty window with everything allocated.
    pub fn new(config: &ValidSetup) -> Self {
        let options = Options::of(config);
        let rig = Rig::of(config);
        let unknowns = unknown_of_frame(MAX_FRAMES);
        let (points, lines) = (config.estimator.window.max_landmarks, config.estimator.lines.max_landmarks);
        Self {
            frames: Vec::with_capacity(MAX_FRAMES),
            points: LandmarkStore::new(points),
            lines: LandmarkStore::new(lines),
            prior: Prior::new(unknowns, &rig),
            anchor: None,
            linearizer: Linearizer::new(unknowns, points, lines, &rig),
            factor: factorization::Factor::new(unknowns, options.held_unknowns()),
            backup: solve::Backup::new(points, lines, &rig),
            solution: vec![0.0; unknowns],
            rehosted: (Vec::with_capacity(points), Vec::with_capacity(lines)),
            outliers: Outliers::new(points, lines),
            last_motion: None,
            unfinished: None,
            first_damping: solve::FIRST_DAMPING,
            rig_walk: RigWalk::new(config.rig.memory_s),
            configured_rig: rig.clone(),
            assumed_rig: rig.clone(),
            known_rig: calibration::KnownRig::within(&options.rig_sigmas),
            kept_rig: None,
            imu_noise: ImuNoise::of(&config.imu),
            options,
            rig,
        }
    }

    /// Forgets frames, landmarks and prior. The rig's refined calibration stays, as uncertain as it was configured or as
    /// [`Self::keep_rig`] has kept it; unless it has left what the configuration admits, which then holds again.
    pub fn clear(&mut self) {
        let mut kept = self.kept_rig.take();
        if !self.rig.is_within(RIG_SIGMAS, &self.configured_rig, &self.options.rig_sigmas) {
            self.restore_rig();
            kept = None;
        }
        self.assumed_rig.clone_from(if kept.is_some() { &self.configured_rig } else { &self.rig });
        self.known_rig = kept.unwrap_or_else(|| calibration::KnownRig::within(&self.options.rig_sigmas));
        self.frames.clear();
        self.points.clear();
        self.lines.clear();
        self.anchor = None;
        self.last_motion = None;
        self.unfinished = None;
        self.first_damping = solve::FIRST_DAMPING;
        self.rig_walk.clear();
        self.refer_lenses();
        self.prior.start(&self.rig, &self.known_rig);
    }

    /// Takes this time offset for the configured one, s, with its standard deviation: it stays through resets.
    pub fn expect_time_offset(&mut self, time_offset_s: f64, sigma_s: f64) {
        self.rig.time_offset_s = time_offset_s;
        self.configured_rig.time_offset_s = time_offset_s;
        self.options.rig_sigmas[Rig::TIME_OFFSET] = sigma_s;
    }

    /// The rig is as configured again.
    pub fn restore_rig(&mut self) {
        self.rig.clone_from(&self.configured_rig);
    }

    /// Anchors the newest frame: its position and yaw define `O`. The prior holds the rig, this frame's state with the
    /// standard deviations given, and what is `known` of it. It is linearized again for every solution until the first
    /// keyframe is marginalized, so that errors of the start leave no trace.
    pub fn anchor_newest(&mut self, known: &AnchorState, sigmas: &AnchorSigmas) {
        self.anchor = Some(Anchor { frame: self.frames.len() - 1, known: *known, sigmas: *sigmas });
        self.refresh_anchor();
    }

    /// Linearizes the origin anew, as long as it is all that the prior holds.
    fn refresh_anchor(&mut self) {
        let Some(anchor) = &self.anchor else { return };
        let configured = self.prior.rig.clone();
        self.prior.start(&configured, &self.known_rig);
        self.prior.anchor(anchor.frame, &self.frames[anchor.frame].nav, &anchor.known, &anchor.sigmas);
        for frame in &mut self.frames[..=anchor.frame] {
            frame.linearization = frame.nav.clone();
        }
    }

    /// Turns everything about gravity and moves it, so that the newest frame comes to position `p_o_b`, m in `O`, and
    /// yaw `yaw_rad`.
    pub fn move_newest_to(&mut self, p_o_b: &Vector3<f64>, yaw_rad: f64) {
        let Some(newest) = self.frames.last() else { return };
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad - yaw_of(&newest.nav.rot_o_b));
        let pivot = newest.nav.p_o_b;
        for frame in &mut self.frames {
            frame.nav.p_o_b = turn * (frame.nav.p_o_b - pivot) + p_o_b;
            frame.nav.rot_o_b = turn * frame.nav.rot_o_b;
            frame.nav.v_o_b = turn * frame.nav.v_o_b;
        }
    }

    /// Appends a frame in the state `nav`, with the `motion` since the frame before it (`None` for the first), and
    /// whether it is at rest (a zero-velocity update). The window has room: see [`Self::make_room`].
    pub fn push_frame(
        &mut self,
        time: FrameTime,
        nav: NavState,
        motion: Option<Preintegration>,
        is_still: bool,
    ) {
        debug_assert!(self.frames.len() < MAX_FRAMES);
        let inertial = motion.map(|motion| InertialFactor::new(motion, &self.imu_noise));
        self.frames.push(Frame {
            stamp: time.stamp,
            taken: time.stamp,
            time_offset_s: time.time_offset_s,
            gyro_b: Vector3::zeros(),
            linearization: nav.clone(),
            nav,
            in_prior: false,
            is_keyframe: false,
            is_still,
            inertial,
        });
    }

    /// Notes what the gyroscope reads at the stamp of the newest frame, bias included, rad/s.
    pub fn set_gyro_of_newest(&mut self, gyro_b: Vector3<f64>) {
        if let Some(newest) = self.frames.last_mut() {
            newest.gyro_b = gyro_b;
        }
    }

    /// Adds the measurements of the newest frame to the landmarks of their tracks; returns how many points have one.
    pub fn observe(&mut self, points: &[PointTrack], lines: &[LineTrack]) -> usize {
        let newest = (self.frames.len() - 1) as u8;
        let _ = tracks::link(&mut self.lines, newest, lines);
        tracks::link(&mut self.points, newest, points)
    }

    /// Makes the newest frame a keyframe: it hosts every track that no landmark stands for.
    pub fn make_keyframe(&mut self, points: &[PointTrack], lines: &[LineTrack]) {
        let newest = self.frames.len() - 1;
        self.frames[newest].is_keyframe = true;
        self.host_points(newest, points);
        tracks::host(&mut self.lines, newest, lines, |_| HostedLine::UNKNOWN);
    }

    /// New landmarks, hosted by `frame`, for those of its point `tracks` that have none.
    pub fn host_points(&mut self, frame: usize, tracks: &[PointTrack]) {
        let rho = self.options.min_rho;
        tracks::host(&mut self.points, frame, tracks, |seen| InversePoint { xy: seen.xy, rho });
    }

    /// Sets the image rates of the newest frame's observations from its velocity and its angular rate. With a rolling shutter
    /// the observations of all frames are put where a global one would have made them.
    pub fn predict_rates(&mut self) {
        let newest = self.frames.len().saturating_sub(1);
        self.predict_rates_from(if self.options.is_rolling { 0 } else { newest });
    }

    /// With a rolling shutter, puts the observations of the newest frame where a global one would have made them, by its predicted
    /// velocity.
    pub fn unroll_newest(&mut self) {
        if self.options.is_rolling {
            self.predict_rates_from(self.frames.len().saturating_sub(1));
        }
    }

    /// Sets the image rates of the observations of frame `first` and later ones, each from the velocity and angular rate of its frame.
    pub fn predict_rates_from(&mut self, first: usize) {
        let Self { rig, frames, points, lines, linearizer, .. } = self;
        for index in first..frames.len() {
            linearizer.poses.predict_rates(rig, frames, points.all_mut(), index);
            linearizer.poses.predict_rates(rig, frames, lines.all_mut(), index);
        }
    }

    /// Triangulates the landmarks that wait for it; forgets those that contradict themselves, unless the
    /// poses are only guessed (`is_start`).
    pub fn triangulate(&mut self, is_start: bool) {
        let Self { points, lines, frames, rig, options, outliers, .. } = self;
        let mounts = [Mount::of(rig, 0), Mount::of(rig, 1)];
        let scene = triangulate::Scene { frames, mounts: &mounts, time_offset_s: rig.time_offset_s };
        points.retain(|landmark| {
            landmark.is_triangulated || {
                let result = triangulate::triangulate(landmark, &scene, options, is_start);
                tracks::keep(result, landmark.track_id, &mut outliers.points)
            }
        });
        lines.retain(|landmark| {
            landmark.is_triangulated || {
                let result = triangulate_line::triangulate_line(landmark, &scene, options);
                tracks::keep(result, landmark.track_id, &mut outliers.lines)
            }
        });
    }

    /// Removes observations that do not fit, and landmarks that are left with less than two views.
    pub fn remove_outliers(&mut self) {
        let Self { rig, frames, points, lines, linearizer, options, outliers, .. } = self;
        let problem = Problem::of_frames(rig, frames, options);
        tracks::remove_outliers(points, &linearizer.poses, &problem, &mut outliers.points);
        tracks::remove_outliers(lines, &linearizer.poses, &problem, &mut outliers.lines);
    }

    /// Forgets what `camera` measured of frame `first` and later ones.
    pub fn forget_images(&mut self, camera: usize, first: usize) {
        tracks::forget_images(&mut self.points, camera as u8, first as u8);
        tracks::forget_images(&mut self.lines, camera as u8, first as u8);
    }

    /// Tracks whose newest observation did not fit, since [`Self::clear_outliers`].
    pub fn outliers(&self) -> &Outliers {
        &self.outliers
    }

    /// Forgets which tracks were outliers.
    pub fn clear_outliers(&mut self) {
        self.outliers.points.clear();
        self.outliers.lines.clear();
    }

    /// Number of independent observations that tell as much as those of all points that have a depth.
    pub fn observation_count(&self) -> f64 {
        let points = self.points.all().iter().filter(|l| l.is_triangulated);
        points.map(|l| l.information(&self.frames, &self.options) * l.observations.len() as f64).sum()
    }

    /// Points and lines that have a depth.
    pub fn triangulated(&self) -> (usize, usize) {
        let points = self.points.all().iter().filter(|l| l.is_triangulated).count();
        (points, self.lines.all().iter().filter(|l| l.is_triangulated).count())
    }
}
