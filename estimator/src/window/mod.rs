//! The sliding window: keyframes and recent frames, landmarks, and the prior of what has left.
//!
//! States are a full navigation state for every frame (position, attitude, velocity, biases), the rig's
//! calibration and time offset, point landmarks as bearing and inverse depth in a host keyframe, and lines
//! in the orthonormal representation there. The cost is that of the paper's equation 13: prior,
//! preintegrated IMU between consecutive frames, and robust reprojection terms.
//!
//! - [`state`], [`landmark`], [`feature`]: what is estimated
//! - [`reprojection`], [`line`], [`inertial_factor`], [`prior`]: the terms
//! - `tracks`: how tracks become landmarks
//! - [`manhattan`] with `heading_votes`, `structural_lines`: verticals and vanishing directions
//! - [`linearize`] with `hessian_blocks`, [`eliminate`], [`dense`], [`solve`]: normal equations and their solution
//! - [`triangulate`], [`triangulate_line`], [`keyframes`], [`marginalize`]: what enters and what leaves

pub mod dense;
pub mod eliminate;
pub mod feature;
mod heading_votes;
mod hessian_blocks;
pub mod inertial_factor;
pub mod keyframes;
pub mod landmark;
pub mod line;
pub mod linearize;
pub mod manhattan;
pub mod marginalize;
pub mod prior;
pub mod reprojection;
pub mod snapshot;
pub mod solve;
pub mod state;
mod structural_lines;
#[cfg(test)]
mod test_views;
mod tracks;
pub mod triangulate;
pub mod triangulate_line;

use crate::geometry::{log_so3, yaw_of};
use crate::inertial::{ImuNoise, Preintegration};
use heading_votes::HeadingVotes;
use landmark::{LandmarkStore, LineLandmark, PointLandmark};
use line::{HostedLine, LineMeasurement};
use linearize::{Linearizer, Problem};
use manhattan::{Manhattan, ManhattanOptions};
use nalgebra::{SVector, UnitQuaternion, Vector3};
use plumbline_config::{MAX_WINDOW_FRAMES, ValidSetup};
use prior::{AnchorSigmas, Prior};
use reprojection::{InversePoint, PointMeasurement};
use state::{FRAME_DIM, Frame, FrameTime, GLOBAL_DIM, Mount, NavState, RIG_DIM, Rig};

/// Most frames in the window: those that validation admits, and one more while a frame is exchanged.
pub const MAX_FRAMES: usize = MAX_WINDOW_FRAMES + 1;

/// An observation this far from its landmark is an outlier, in standard deviations.
const OUTLIER_SIGMAS: f64 = 6.0;

/// The window's options in the units of its computations.
#[derive(Clone, Debug)]
pub struct Options {
    /// Keyframes held.
    pub keyframes: usize,
    /// Newest frames held beside the keyframes.
    pub recent_frames: usize,
    /// Solver steps a frame.
    pub max_iterations: usize,
    /// Smallest share of tracks linked to the window without a new keyframe.
    pub min_connected_ratio: f64,
    /// Longest time without a new keyframe, s.
    pub max_keyframe_interval_s: f64,
    /// Scale of the Cauchy kernel, in standard deviations.
    pub cauchy_scale: f64,
    /// Range of inverse depth for new landmarks, 1/m.
    pub min_rho: f64,
    /// See `min_rho`.
    pub max_rho: f64,
    /// A landmark is triangulated when its parallax exceeds this many standard deviations ...
    pub min_parallax_sigmas: f64,
    /// ... or its inverse depth is known this well, 1/m.
    pub max_sigma_rho: f64,
    /// Cameras of the rig.
    pub cameras: usize,
    /// Jacobians of frames in the prior stay at their first estimates.
    pub first_estimates: bool,
    /// Gravity in the odometry frame, m/s².
    pub gravity_o: Vector3<f64>,
    /// Noise of the IMU.
    pub imu_noise: ImuNoise,
    /// Standard deviation of the velocity while standing still, m/s.
    pub still_sigma_m_s: f64,
    /// Prior standard deviations of the rig.
    pub rig_sigmas: SVector<f64, RIG_DIM>,
    /// 1 for the rig's parameters that are refined, 0 for those held fixed.
    pub rig_mask: SVector<f64, RIG_DIM>,
}

impl Options {
    /// The options that a configuration asks for.
    #[must_use]
    pub fn of(config: &ValidSetup) -> Self {
        let window = &config.estimator.window;
        let rig_sigmas = Rig::sigmas(&config.rig, config.camera.len());
        Self {
            keyframes: window.keyframes,
            recent_frames: window.recent_frames,
            max_iterations: window.max_iterations,
            min_connected_ratio: window.min_connected_ratio,
            max_keyframe_interval_s: window.max_keyframe_interval_s,
            cauchy_scale: window.cauchy_scale,
            min_rho: 1.0 / window.max_depth_m,
            max_rho: 1.0 / window.min_depth_m,
            min_parallax_sigmas: 6.0,
            max_sigma_rho: 0.02,
            cameras: config.camera.len(),
            first_estimates: config.camera.len() > 1,
            gravity_o: Vector3::new(0.0, 0.0, -config.imu.gravity_m_s2),
            imu_noise: ImuNoise::of(&config.imu),
            still_sigma_m_s: 0.01,
            rig_sigmas,
            rig_mask: rig_sigmas.map(|sigma| if sigma > 0.0 { 1.0 } else { 0.0 }),
        }
    }
}

/// The sliding window and all the memory it ever needs.
#[derive(Clone, Debug)]
pub struct Window {
    /// Calibration.
    pub rig: Rig,
    /// Structure of the scene.
    pub manhattan: Manhattan,
    /// Frames in order of time.
    pub frames: Vec<Frame>,
    /// Points.
    pub points: LandmarkStore<InversePoint>,
    /// Lines.
    pub lines: LandmarkStore<HostedLine>,
    /// What has left the window.
    pub prior: Prior,
    /// Options.
    pub options: Options,
    anchor: Option<Anchor>,
    heading_votes: HeadingVotes,
    is_manhattan_in_sight: bool,
    linearizer: Linearizer,
    factor: dense::Factor,
    backup: solve::Backup,
    solution: Vec<f64>,
    visual_step: Vec<f64>,
    rehosted: (Vec<PointLandmark>, Vec<LineLandmark>),
    outliers: Outliers,
}

/// The frame that defines the odometry frame.
#[derive(Clone, Debug)]
struct Anchor {
    frame: usize,
    biases: (Vector3<f64>, Vector3<f64>),
    sigmas: AnchorSigmas,
}

/// A track seen in the newest frame, ready for the window.
#[derive(Clone, Copy, Debug)]
pub struct TrackMeasurement<M> {
    /// The track.
    pub track_id: u32,
    /// What each camera saw.
    pub measured: [Option<M>; 2],
}

/// A tracked point in the newest frame.
pub type PointTrack = TrackMeasurement<PointMeasurement>;
/// A tracked line in the newest frame.
pub type LineTrack = TrackMeasurement<LineMeasurement>;

/// Tracks whose newest observation does not fit.
#[derive(Clone, Debug)]
pub struct Outliers {
    /// Of points.
    pub points: Vec<u32>,
    /// Of lines.
    pub lines: Vec<u32>,
}

impl Outliers {
    /// Both cameras may tell of the same landmark.
    fn new(points: usize, lines: usize) -> Self {
        Self { points: Vec::with_capacity(2 * points), lines: Vec::with_capacity(2 * lines) }
    }
}

impl Window {
    /// An empty window with everything allocated.
    #[must_use]
    pub fn new(config: &ValidSetup) -> Self {
        let options = Options::of(config);
        let rig = Rig::of(config);
        let unknowns = GLOBAL_DIM + FRAME_DIM * MAX_FRAMES;
        let (points, lines) = (config.estimator.window.max_landmarks, config.estimator.lines.max_landmarks);
        Self {
            manhattan: Manhattan::new(ManhattanOptions::of(&config.estimator.lines)),
            heading_votes: HeadingVotes::default(),
            is_manhattan_in_sight: false,
            frames: Vec::with_capacity(MAX_FRAMES),
            points: LandmarkStore::new(points),
            lines: LandmarkStore::new(lines),
            prior: Prior::new(unknowns, &rig),
            anchor: None,
            linearizer: Linearizer::new(unknowns, points, lines, &rig),
            factor: dense::Factor::new(unknowns),
            backup: solve::Backup::new(points, lines, &rig),
            solution: vec![0.0; unknowns],
            visual_step: vec![0.0; unknowns],
            rehosted: (Vec::with_capacity(points), Vec::with_capacity(lines)),
            outliers: Outliers::new(points, lines),
            options,
            rig,
        }
    }

    /// Forgets frames, landmarks and prior; the rig's refined calibration stays, as uncertain as it was
    /// configured.
    pub fn clear(&mut self) {
        self.frames.clear();
        self.points.clear();
        self.lines.clear();
        self.anchor = None;
        self.manhattan.heading_rad = None;
        self.heading_votes = HeadingVotes::default();
        self.is_manhattan_in_sight = false;
        self.prior.start(&self.rig, &self.options.rig_sigmas);
    }

    /// Makes the newest frame the origin of what is known: the prior is that of the rig, and that this
    /// frame is where it is now. Until something is marginalized the origin is linearized anew for every
    /// solution, so that errors of the start leave no trace.
    pub fn anchor_newest(&mut self, biases: &(Vector3<f64>, Vector3<f64>), sigmas: &AnchorSigmas) {
        self.anchor = Some(Anchor { frame: self.frames.len() - 1, biases: *biases, sigmas: *sigmas });
        self.refresh_anchor();
    }

    /// Linearizes the origin anew, as long as it is all that the prior holds.
    fn refresh_anchor(&mut self) {
        let Some(anchor) = &self.anchor else { return };
        let configured = self.prior.rig.clone();
        self.prior.start(&configured, &self.options.rig_sigmas);
        self.prior.anchor(anchor.frame, &self.frames[anchor.frame].nav, &anchor.biases, &anchor.sigmas);
        for frame in &mut self.frames[..=anchor.frame] {
            frame.linearization = frame.nav.clone();
        }
    }

    /// Turns and moves everything so that the newest frame comes to `p_o_b` and heading `yaw_rad`.
    pub fn move_newest_to(&mut self, p_o_b: &Vector3<f64>, yaw_rad: f64) {
        let Some(newest) = self.frames.last() else { return };
        let turn_rad = yaw_rad - yaw_of(&newest.nav.rot_o_b);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad);
        let pivot = newest.nav.p_o_b;
        self.manhattan.turn(turn_rad);
        for frame in &mut self.frames {
            frame.nav.p_o_b = turn * (frame.nav.p_o_b - pivot) + p_o_b;
            frame.nav.rot_o_b = turn * frame.nav.rot_o_b;
            frame.nav.v_o_b = turn * frame.nav.v_o_b;
        }
    }

    /// Appends a frame.
    pub fn push_frame(
        &mut self,
        time: FrameTime,
        nav: NavState,
        motion: Option<Preintegration>,
        is_still: bool,
    ) {
        debug_assert!(self.frames.len() < MAX_FRAMES);
        self.frames.push(Frame {
            stamp: time.stamp,
            time_offset_s: time.time_offset_s,
            linearization: nav.clone(),
            nav,
            in_prior: false,
            is_keyframe: false,
            is_still,
            motion,
        });
    }

    /// Hands the newest frame its measurements; returns how many points belong to landmarks.
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

    /// Sets the image rates of the newest frame's observations from its predicted motion.
    pub fn predict_rates(&mut self, rate_b: &Vector3<f64>) {
        if let Some(newest) = self.frames.len().checked_sub(1) {
            self.predict_rates_of(newest, rate_b);
        }
    }

    /// The same for all frames, their angular rates taken from the attitudes.
    pub fn predict_all_rates(&mut self) {
        for index in 0..self.frames.len() {
            let (from, to) = if index == 0 { (0, 1) } else { (index - 1, index) };
            let (Some(from), Some(to)) = (self.frames.get(from), self.frames.get(to)) else { return };
            let turn = log_so3(&(from.nav.rot_o_b.inverse() * to.nav.rot_o_b));
            let rate_b = turn / to.stamp.seconds_since(from.stamp);
            self.predict_rates_of(index, &rate_b);
        }
    }

    fn predict_rates_of(&mut self, index: usize, rate_b: &Vector3<f64>) {
        let Self { rig, frames, points, lines, linearizer, .. } = self;
        linearizer.predict_rates(rig, frames, points.all_mut(), rate_b, index);
        linearizer.predict_rates(rig, frames, lines.all_mut(), rate_b, index);
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
        let Self { rig, manhattan, frames, points, lines, linearizer, options, outliers, .. } = self;
        let problem = Problem { rig, frames, points: &[], lines: &[], manhattan, options };
        tracks::remove_outliers(points, linearizer, &problem, &mut outliers.points);
        tracks::remove_outliers(lines, linearizer, &problem, &mut outliers.lines);
    }

    /// Tracks whose newest observation did not fit, since [`Self::clear_outliers`].
    #[must_use]
    pub fn outliers(&self) -> &Outliers {
        &self.outliers
    }

    /// Forgets which tracks were outliers.
    pub fn clear_outliers(&mut self) {
        self.outliers.points.clear();
        self.outliers.lines.clear();
    }

    /// Points and lines that have a depth.
    #[must_use]
    pub fn triangulated(&self) -> (usize, usize) {
        let points = self.points.all().iter().filter(|l| l.is_triangulated).count();
        (points, self.lines.all().iter().filter(|l| l.is_triangulated).count())
    }
}
