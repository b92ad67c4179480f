//! Output of the estimator: one [`Estimate`] a frame, one [`Odometry`] an inertial sample.

use crate::origin::OriginUncertainty;
use nalgebra::{Isometry3, SMatrix, SVector, Vector3};
use plumbline_config::Timestamp;
use plumbline_fields::{FieldContent, Record, Value};

pub use crate::health::HealthBits;

/// State of the estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Record)]
#[record("State", "an unknown state")]
pub enum TrackingState {
    /// Gathering data; there is no pose yet.
    #[default]
    Initialising,
    /// Estimating from images and IMU; the velocity is known.
    Tracking,
    /// Estimating from the IMU alone: no landmark is in view, or the velocity is not known again yet.
    Blind,
    /// The estimate was given up; a new start is under way, and its velocity is not known yet.
    Failed,
}

/// Covariance of position (0..3), attitude (3..6, right perturbation `R Exp(dtheta)`, rad) and
/// velocity (6..9) in the odometry frame, against the first pose.
pub type NavCovariance = SMatrix<f64, 9, 9>;

/// Variances of the biases: gyroscope (0..3, rad²/s²) and accelerometer (3..6, m²/s⁴).
pub type BiasVariances = SVector<f64, 6>;

/// The estimate after one frame. Frames: `O` odometry (z up, origin at the first pose), `B` body.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Estimate")]
pub struct Estimate {
    /// Sequence number of the frame.
    #[field(1, digest = 2, at = 16, columns = (2, &["frame"]))]
    pub frame_sequence: u64,
    /// Time of the state on the IMU's time axis (image stamp plus time offset).
    #[field(2, wire = "stamp_ns", digest = 1, at = 0, columns = (1, &["stamp_ns"]))]
    pub stamp: Timestamp,
    /// State of the estimator; while `Initialising` or `Failed` the values below are meaningless.
    #[field(3, digest = 10, at = 528, columns = (3, &["tracking"]))]
    pub state: TrackingState,
    /// Pose of the body in the odometry frame.
    #[field(4, digest = 3, at = 24, columns = (7, &[
        "p_o_b_x_m", "p_o_b_y_m", "p_o_b_z_m", "q_o_b_x", "q_o_b_y", "q_o_b_z", "q_o_b_w",
    ]))]
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    #[field(5, wire = "velocity_o_b", digest = 4, at = 80, columns = (8, &["v_o_b_x_m_s", "v_o_b_y_m_s", "v_o_b_z_m_s"]))]
    pub v_o_b: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    #[field(6, digest = 5, at = 104, columns = (9, &["bias_gyro_x_rad_s", "bias_gyro_y_rad_s", "bias_gyro_z_rad_s"]))]
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias, m/s².
    #[field(7, digest = 6, at = 128, columns = (10, &["bias_accel_x_m_s2", "bias_accel_y_m_s2", "bias_accel_z_m_s2"]))]
    pub bias_accel: Vector3<f64>,
    /// Covariance of position (m), attitude (rad) and velocity (m/s).
    #[field(8, digest = 7, at = 152, columns = (11, &[
        "var_p_x_m2", "var_p_y_m2", "var_p_z_m2", "var_theta_x_rad2", "var_theta_y_rad2", "var_theta_z_rad2",
        "var_v_x_m2_s2", "var_v_y_m2_s2", "var_v_z_m2_s2", "var_heading_rad2",
    ]))]
    pub covariance: NavCovariance,
    /// Share of [`Self::covariance`] that comes from before the last reset.
    #[field(none)]
    pub origin: OriginUncertainty,
    /// `t_imu - t_camera` as refined online, s.
    #[field(
        9, pair = time_offset_sigma_s, digest = 8, digest_as = |o| FieldContent::get(&o.time_offset_s), at = 512,
        columns = (12, &["time_offset_s", "time_offset_sigma_s"]),
        about = "`t_imu - t_camera` as refined online, and its standard deviation, s."
    )]
    pub time_offset_s: f64,
    /// Standard deviation of [`Self::time_offset_s`], s.
    #[field(none)]
    pub time_offset_sigma_s: f64,
    /// Pose of the left camera in the body, as refined online.
    #[field(10, digest = 9, columns = (13, &[
        "p_b_c0_x_m", "p_b_c0_y_m", "p_b_c0_z_m", "q_b_c0_x", "q_b_c0_y", "q_b_c0_z", "q_b_c0_w",
    ]))]
    pub pose_b_c0: Isometry3<f64>,
    /// -1 failed, else 0..=100.
    #[field(11, digest = 11, at = 529, columns = (4, &["quality"]))]
    pub quality: i8,
    /// Errors and warnings.
    #[field(12, wire = "health_bits", digest = 12, at = 520, columns = (5, &["health_bits"]))]
    pub health: HealthBits,
    /// Number of resets. Where it changes the pose may jump by any amount; in between each frame corrects it by
    /// millimetres with two cameras, now and then by some centimetres with one. [`Odometry`] takes such corrections up at
    /// a bounded rate.
    #[field(13, digest = 13, at = 524, columns = (6, &["reset_counter"]))]
    pub reset_counter: u32,
    /// Figures of this frame.
    #[field(14)]
    pub figures: FrameFigures,
    /// Variances of the biases: gyroscope (rad²/s²), accelerometer (m²/s⁴).
    #[field(15, columns = (25, &[
        "var_bias_gyro_x_rad2_s2", "var_bias_gyro_y_rad2_s2", "var_bias_gyro_z_rad2_s2",
        "var_bias_accel_x_m2_s4", "var_bias_accel_y_m2_s4", "var_bias_accel_z_m2_s4",
    ]))]
    pub bias_variances: BiasVariances,
}

impl Estimate {
    /// True if pose, velocity, biases and covariance are valid, at the time of the frame.
    pub fn has_pose(&self) -> bool {
        matches!(self.state, TrackingState::Tracking | TrackingState::Blind) && !self.is_refused()
    }

    /// True if the frame was refused for its stamp: the state is that of the frame before, and nothing in it
    /// is new.
    pub fn is_refused(&self) -> bool {
        self.health.contains(HealthBits::BAD_STAMP)
    }

    /// The pose of the body in the odometry frame; `None` while there is none to use.
    pub fn pose(&self) -> Option<&Isometry3<f64>> {
        self.has_pose().then_some(&self.pose_o_b)
    }
}

/// Work and outcome figures of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("Figures")]
pub struct FrameFigures {
    /// Points tracked in this frame.
    #[field(1, columns = (14, &["points_tracked"]))]
    pub points_tracked: u32,
    /// Tracked points seen by both cameras.
    #[field(2, columns = (15, &["points_stereo"]))]
    pub points_stereo: u32,
    /// Landmarks in the window after this frame.
    #[field(3, columns = (16, &["points_in_window"]))]
    pub points_in_window: u32,
    /// Line segments found in the left image.
    #[field(4, columns = (17, &["lines_raw"]))]
    pub lines_raw: u32,
    /// The clearest line segments, as the whole image confirmed them.
    #[field(5, columns = (18, &["lines_kept"]))]
    pub lines_kept: u32,
    /// Line segments that continue a track.
    #[field(7, columns = (19, &["lines_matched"]))]
    pub lines_matched: u32,
    /// Images whose line budget was spent before their last seed.
    #[field(8, columns = (20, &["lines_cut_short"]))]
    pub lines_cut_short: u32,
    /// Line landmarks in the window after this frame.
    #[field(9, columns = (21, &["lines_in_window"]))]
    pub lines_in_window: u32,
    /// Keyframes in the window.
    #[field(10, columns = (22, &["keyframes"]))]
    pub keyframes: u32,
    /// Solver iterations.
    #[field(11, columns = (23, &["iterations"]))]
    pub iterations: u32,
    /// True if this frame became a keyframe.
    #[field(12, at = 530, columns = (24, &["is_keyframe"]))]
    pub is_keyframe: bool,
}

/// The newest state carried forward to an inertial sample (200 Hz). Corrections enter at a bounded rate; a step is made only where [`Self::reset_counter`] or [`Self::jumps`] changes.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Odometry")]
pub struct Odometry {
    /// Counts odometry outputs.
    #[field(1, at = 16)]
    pub sequence: u64,
    /// Time of the inertial sample.
    #[field(2, wire = "stamp_ns", digest = 1, at = 0)]
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    #[field(3, digest = 2, at = 24)]
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    #[field(4, wire = "velocity_o_b", digest = 3, at = 80)]
    pub v_o_b: Vector3<f64>,
    /// Angular rate of the body, bias removed, in `B`, rad/s.
    #[field(5, digest = 4, at = 104)]
    pub angular_rate_b: Vector3<f64>,
    /// Covariance, grown since the last frame by the IMU's noise, by what its biases may be, by what it did not measure,
    /// and by the corrections that are still to enter.
    #[field(6, digest = 5, at = 128)]
    pub covariance: NavCovariance,
    /// State of the estimate it rests on.
    #[field(7, at = 500)]
    pub state: TrackingState,
    /// Quality of the estimate it rests on.
    #[field(8, at = 501)]
    pub quality: i8,
    /// Reset counter of the estimate it rests on.
    #[field(9, at = 492)]
    pub reset_counter: u32,
    /// Number of steps within the same odometry frame since the beginning: corrections too large for a bounded rate, and
    /// odometry that resumed after an interruption without a reset.
    #[field(10, digest = 6, digest_as = |o| Value::Whole(o.steps().into()), at = 496)]
    pub jumps: u32,
    /// Share of [`Self::covariance`] that comes from before the last reset.
    #[field(none)]
    pub origin: OriginUncertainty,
}

impl Odometry {
    /// Number of steps of any kind so far: resets and jumps. A filter that integrates the odometry restarts from it where
    /// this changes.
    pub fn steps(&self) -> u32 {
        self.reset_counter.wrapping_add(self.jumps)
    }

    /// Covariance against the start after the last reset, in the order of [`NavCovariance`]. For a receiver that is
    /// informed of resets, and takes the start for its new origin.
    pub fn covariance_since_reset(&self) -> NavCovariance {
        let (p_o_b, rot_o_b) = (&self.pose_o_b.translation.vector, &self.pose_o_b.rotation);
        match self.origin.share(p_o_b, rot_o_b, &self.v_o_b) {
            Some(share) => self.covariance - share,
            None => self.covariance,
        }
    }
}

/// Stages of a frame's computation, named as in the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Pyramids, corners, tracking, stereo matching, outlier rejection.
    Points,
    /// Line segments of both images.
    LinesExtract,
    /// Their descriptors.
    LinesDescribe,
    /// Matching from frame to frame and from left to right.
    LinesMatch,
    /// Landmarks, keyframe choice and the window's optimisation.
    Window,
    /// Marginalization.
    Marginalize,
    /// Propagation of the newest state at IMU rate.
    Propagate,
}

impl Stage {
    /// All stages in order of the data flow.
    pub const ALL: [Self; 7] = [
        Self::Points,
        Self::LinesExtract,
        Self::LinesDescribe,
        Self::LinesMatch,
        Self::Window,
        Self::Marginalize,
        Self::Propagate,
    ];

    /// The name used in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Points => "points",
            Self::LinesExtract => "lines_extract",
            Self::LinesDescribe => "lines_describe",
            Self::LinesMatch => "lines_match",
            Self::Window => "window",
            Self::Marginalize => "marginalize",
            Self::Propagate => "propagate",
        }
    }
}

/// Told when a stage begins and ends. The estimator has no clock: who wants times brings one.
pub trait StageProbe {
    /// `stage` begins.
    fn begin(&mut self, stage: Stage);
    /// `stage` ends.
    fn end(&mut self, stage: Stage);
}

/// Ignores the stages.
impl StageProbe for () {
    fn begin(&mut self, _stage: Stage) {}
    fn end(&mut self, _stage: Stage) {}
}
