//! Output of the estimator: one [`Estimate`] a frame, one [`Odometry`] an inertial sample.

use crate::origin::OriginUncertainty;
use nalgebra::{Isometry3, SMatrix, SVector, Vector3};
use plumbline_config::Timestamp;

pub use crate::health::HealthBits;

/// State of the estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Sequence number of the frame.
    pub frame_sequence: u64,
    /// Time of the state on the IMU's time axis (image stamp plus time offset).
    pub stamp: Timestamp,
    /// State of the estimator; while `Initialising` or `Failed` the values below are meaningless.
    pub state: TrackingState,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    pub v_o_b: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub bias_accel: Vector3<f64>,
    /// Covariance of pose and velocity.
    pub covariance: NavCovariance,
    /// Share of [`Self::covariance`] that comes from before the last reset.
    pub origin: OriginUncertainty,
    /// Variances of the biases.
    pub bias_variances: BiasVariances,
    /// `t_imu - t_camera` as refined online, s.
    pub time_offset_s: f64,
    /// Standard deviation of [`Self::time_offset_s`], s.
    pub time_offset_sigma_s: f64,
    /// Pose of the left camera in the body, as refined online.
    pub pose_b_c0: Isometry3<f64>,
    /// -1 failed, else 0..=100.
    pub quality: i8,
    /// Errors and warnings.
    pub health: HealthBits,
    /// Number of resets. Where it changes the pose may jump by any amount; in between each frame corrects it by
    /// millimetres with two cameras, now and then by some centimetres with one. [`Odometry`] takes such corrections up at
    /// a bounded rate.
    pub reset_counter: u32,
    /// Figures of this frame.
    pub figures: FrameFigures,
}

impl Estimate {
    /// True if pose, velocity, biases and covariance are valid, at the time of the frame.
    #[must_use]
    pub fn has_pose(&self) -> bool {
        matches!(self.state, TrackingState::Tracking | TrackingState::Blind) && !self.is_refused()
    }

    /// True if the frame was refused for its stamp: the state is that of the frame before, and nothing in it
    /// is new.
    #[must_use]
    pub fn is_refused(&self) -> bool {
        self.health.contains(HealthBits::BAD_STAMP)
    }

    /// The pose of the body in the odometry frame; `None` while there is none to use.
    #[must_use]
    pub fn pose(&self) -> Option<&Isometry3<f64>> {
        self.has_pose().then_some(&self.pose_o_b)
    }
}

/// Defines the figures of a frame from their names, so that a new one is written, read and compared everywhere.
macro_rules! frame_figures {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Work and outcome figures of one frame.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct FrameFigures {
            $($(#[$doc])* pub $name: u32,)*
            /// True if this frame became a keyframe.
            pub is_keyframe: bool,
        }

        impl FrameFigures {
            /// Names of all figures.
            pub const NAMES: [&str; Self::COUNT] = [$(stringify!($name),)* "is_keyframe"];
            const COUNT: usize = [$(stringify!($name)),*].len() + 1;

            /// The figures as numbers, in the order of [`Self::NAMES`]; 1 for a keyframe.
            #[must_use]
            pub fn values(&self) -> [u32; Self::COUNT] {
                [$(self.$name,)* self.is_keyframe.into()]
            }

            /// The figures of their numbers in the order of [`Self::NAMES`].
            #[must_use]
            pub fn of_values([$($name,)* is_keyframe]: [u32; Self::COUNT]) -> Self {
                Self { $($name,)* is_keyframe: is_keyframe != 0 }
            }
        }
    };
}

frame_figures! {
    /// Points tracked in this frame.
    points_tracked,
    /// Tracked points seen by both cameras.
    points_stereo,
    /// Landmarks in the window after this frame.
    points_in_window,
    /// Line segments found in the left image.
    lines_raw,
    /// Line segments that are long enough.
    lines_kept,
    /// Line segments after merging.
    lines_merged,
    /// Merged line segments that continue a track.
    lines_matched,
    /// Images whose line budget was spent before their last seed.
    lines_cut_short,
    /// Line landmarks in the window after this frame.
    lines_in_window,
    /// Line landmarks in the window along a direction of the structure.
    lines_in_structure,
    /// Keyframes in the window.
    keyframes,
    /// Solver iterations.
    iterations,
}

/// The newest state carried forward to an inertial sample (200 Hz). Corrections enter at a bounded rate
/// ([`crate::propagator::blend`]); a step is made only where [`Self::reset_counter`] or [`Self::jumps`] changes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Odometry {
    /// Counts odometry outputs.
    pub sequence: u64,
    /// Time of the inertial sample.
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    pub v_o_b: Vector3<f64>,
    /// Angular rate of the body, bias removed, in `B`, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Covariance, grown since the last frame by the IMU's noise, by what its biases may be, by what it did not measure,
    /// and by the corrections that are still to enter.
    pub covariance: NavCovariance,
    /// State of the estimate it rests on.
    pub state: TrackingState,
    /// Quality of the estimate it rests on.
    pub quality: i8,
    /// Reset counter of the estimate it rests on.
    pub reset_counter: u32,
    /// Number of steps within the same odometry frame since the beginning: corrections too large for a bounded rate, and
    /// odometry that resumed after an interruption without a reset.
    pub jumps: u32,
    /// Share of [`Self::covariance`] that comes from before the last reset.
    pub origin: OriginUncertainty,
}

impl Odometry {
    /// Number of steps of any kind so far: resets and jumps. A filter that integrates the odometry restarts from it where
    /// this changes.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.reset_counter.wrapping_add(self.jumps)
    }

    /// Covariance against the start after the last reset, in the order of [`NavCovariance`]. For a receiver that is
    /// informed of resets, and takes the start for its new origin.
    #[must_use]
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
