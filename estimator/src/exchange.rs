//! Exchange between front-end and odometer: a [`Tracked`] frame forward, [`Feedback`] back.
//!
//! The front-end may work on the next frame while the window still solves the last. What the window found out
//! (wrong tracks, refined extrinsics, a bias) therefore reaches it one frame late, always, whether there was a
//! thread to spare or not: [`crate::facade`] and every executor hand over the feedback of frame `k` before frame
//! `k + 2`.

use crate::estimate::{FrameFigures, HealthBits};
use crate::inertial::buffer::IMU_MEMORY_S;
use crate::initial::timing::SEARCHED_S;
use crate::input::ResetKind;
use crate::lines::LineObservation;
use crate::points::PointObservation;
use crate::points::prediction::{KnownPoint, WitnessedTurn};
use crate::shutter::{Readout, readouts};
use crate::window::snapshot::{SnapshotKeyframe, SnapshotLine};
use crate::window::state::{FrameTime, MAX_FRAMES, NavState};
use crate::work_budget::WorkBudget;
use nalgebra::{Isometry3, Matrix4, Vector3};
use plumbline_config::{ImuSample, Timestamp, ValidSetup};

/// Time offsets beyond this are not believed, s: the largest that can be configured, and as far from that as a start searches.
pub(crate) const MAX_TIME_OFFSET_S: f64 = 0.1 + SEARCHED_S;

/// Lines of a window that are handed on for maps, at most.
const MAX_SOLVED_LINES: usize = 128;

/// Output of the front-end for one frame: all that the window needs to know of it.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Sequence number of the frame.
    pub sequence: u64,
    /// Time of the frame.
    pub time: FrameTime,
    /// A reset that comes before it.
    pub reset: Option<ResetKind>,
    /// The clock of the sensors was set: the stamps of frame and samples have nothing to do with those before.
    pub is_clock_set: bool,
    /// Inertial samples since the frame before, in order.
    pub samples: Vec<ImuSample>,
    /// Points seen, in order of track id.
    pub points: Vec<PointObservation>,
    /// Lines seen, in order of track id.
    pub lines: Vec<LineObservation>,
    /// Faults of the images.
    pub health: HealthBits,
    /// Figures of the front-end; those of the window are still zero.
    pub figures: FrameFigures,
    /// The texture in view repeats itself: the front-end asks for [`Feedback::known_points`].
    pub is_repeating: bool,
    /// With such texture: the turn since the frame before by corners of their own, if they agree about one.
    pub turn: Option<WitnessedTurn>,
    /// The work that the frame gets, an input like the images.
    pub budget: WorkBudget,
}

impl Tracked {
    /// An empty one, with room for any frame.
    pub fn new(setup: &ValidSetup) -> Self {
        Self {
            sequence: 0,
            time: FrameTime::default(),
            reset: None,
            is_clock_set: false,
            samples: Vec::with_capacity(max_samples(setup)),
            points: Vec::with_capacity(setup.estimator.points.max_points),
            lines: Vec::with_capacity(2 * setup.estimator.lines.max_segments),
            health: HealthBits::default(),
            figures: FrameFigures::default(),
            is_repeating: false,
            turn: None,
            budget: WorkBudget::FULL,
        }
    }
}

/// Findings of the window that the front-end needs.
#[derive(Clone, Debug)]
pub struct Feedback {
    /// Track ids of points that do not belong to the rigid scene.
    pub wrong_points: Vec<u32>,
    /// Track ids of lines that do not belong to the rigid scene.
    pub wrong_lines: Vec<u32>,
    /// Extrinsics `T_BC` of both cameras as refined so far.
    pub pose_b_c: [Isometry3<f64>; 2],
    /// `t_imu - t_camera` as refined so far, s.
    pub time_offset_s: f64,
    /// Readouts of the cameras, as configured or found.
    pub readouts: [Readout; 2],
    /// Bias of the gyroscope, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Mean angular rate of the body since the frame before, rad/s: it predicts turns that no gyroscope measures.
    pub turn_rate_b: Vector3<f64>,
    /// Inertial samples are distrusted, since they contradict the images.
    pub distrusts_imu: bool,
    /// The camera whose image counts as missing while the other one delivers.
    pub untracked_camera: Option<usize>,
    /// Resets so far.
    pub reset_counter: u32,
    /// State of the frame that was solved, by which points and lines are predicted; `None` unless it can be relied on.
    pub known_state: Option<KnownState>,
    /// Landmarks that this frame sees, in order of their tracks; none unless the front-end asked for them.
    pub known_points: Vec<KnownPoint>,
    /// The frame that was solved, as places want to know it.
    pub solved: SolvedFrame,
}

/// State by which the next frames are predicted.
#[derive(Clone, Debug)]
pub struct KnownState {
    /// Time of the state on the IMU's time axis.
    pub stamp: Timestamp,
    /// The state.
    pub nav: NavState,
    /// Standard deviation of its velocity, all axes together, m/s.
    pub velocity_sigma_m_s: f64,
}

/// Relative pose of a keyframe and the one before it, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframeStep {
    /// Stamp of the earlier keyframe.
    pub from: Timestamp,
    /// Stamp of the later keyframe.
    pub to: Timestamp,
    /// Covariance of way (0..3, m²) and turn about the vertical (3, rad²): see [`crate::window::relative`].
    pub covariance: Matrix4<f64>,
}

/// A frame that was solved, and what the window knew of its keyframes just then.
#[derive(Clone, Debug, Default)]
pub struct SolvedFrame {
    /// Counts the frames that the window was given, from 0.
    pub index: u64,
    /// Sequence number of the frame.
    pub sequence: u64,
    /// Time of the state on the IMU's time axis.
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame; `None` while there is none.
    pub pose_o_b: Option<Isometry3<f64>>,
    /// True if the frame became a keyframe.
    pub is_keyframe: bool,
    /// Resets so far.
    pub reset_counter: u32,
    /// With a keyframe: all keyframes of the window as they are known now, oldest first.
    pub keyframes: heapless::Vec<SnapshotKeyframe, MAX_FRAMES>,
    /// With a keyframe: the last steps between keyframes, oldest first.
    pub steps: heapless::Vec<KeyframeStep, 2>,
    /// With a keyframe: the lines of the window as they are known now.
    pub lines: heapless::Vec<SnapshotLine, MAX_SOLVED_LINES>,
}

impl Feedback {
    /// Initial feedback before the first frame, with room for the findings of any frame.
    pub fn new(setup: &ValidSetup) -> Self {
        let pose = |k: usize| setup.camera.get(k).map_or_else(Isometry3::identity, |c| c.pose_b_c());
        Self {
            // Both cameras may name the same track.
            wrong_points: Vec::with_capacity(2 * setup.estimator.window.max_landmarks),
            wrong_lines: Vec::with_capacity(2 * setup.estimator.lines.max_landmarks),
            pose_b_c: [pose(0), pose(1)],
            time_offset_s: setup.rig.time_offset_s,
            readouts: readouts(setup),
            bias_gyro: Vector3::zeros(),
            turn_rate_b: Vector3::zeros(),
            distrusts_imu: false,
            untracked_camera: None,
            reset_counter: 0,
            known_state: None,
            known_points: Vec::with_capacity(setup.estimator.points.max_points),
            solved: SolvedFrame::default(),
        }
    }
}

/// Samples between two frames, at most: what the inertial buffer keeps.
pub(crate) fn max_samples(setup: &ValidSetup) -> usize {
    (IMU_MEMORY_S * setup.imu.rate_hz).ceil() as usize
}

/// The time offset to stamp frames by: the estimated one, within what cameras have, s.
pub(crate) fn believable_offset(time_offset_s: f64) -> f64 {
    time_offset_s.clamp(-MAX_TIME_OFFSET_S, MAX_TIME_OFFSET_S)
}
