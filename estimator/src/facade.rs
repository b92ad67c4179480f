//! The estimator as its user meets it: [`Estimator`] for frames, [`Propagator`] for IMU-rate odometry.

use crate::estimate::{Estimate, FrameInput, Odometry, StageProbe};
use plumbline_config::{Config, ImuSample, Timestamp};

/// What became of an inertial sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuAdmission {
    /// Taken.
    Accepted,
    /// Not later than the newest sample: refused.
    NotLater,
    /// A component was not a finite number: refused.
    NotFinite,
}

/// How much a reset forgets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetKind {
    /// The map and the window go, the pose stays: the new start continues from it.
    Soft,
    /// Everything goes: the new start begins at the origin.
    Hard,
}

/// The frame-rate estimator: a pure function of its configuration and the ordered list of its inputs.
///
/// Order of calls: every inertial sample by [`Self::add_imu`] in order of time; a frame by
/// [`Self::add_frame`] once the samples reach [`Self::imu_needed_until`] of its stamp (or will never).
pub struct Estimator {}

impl Estimator {
    /// Allocates everything the configuration asks for.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let _ = config;
        Self {}
    }

    /// Takes an inertial sample.
    pub fn add_imu(&mut self, sample: &ImuSample) -> ImuAdmission {
        let _ = sample;
        ImuAdmission::Accepted
    }

    /// Samples up to this time must have been added before the frame of `image_stamp` is.
    #[must_use]
    pub fn imu_needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        image_stamp
    }

    /// Takes a frame, and returns the estimate after it.
    pub fn add_frame(&mut self, frame: &FrameInput<'_>, probe: &mut impl StageProbe) -> Estimate {
        let _ = (frame, probe);
        unimplemented!("written next")
    }

    /// Starts anew before the next frame.
    pub fn reset(&mut self, kind: ResetKind) {
        let _ = kind;
    }
}

/// Carries the newest estimate forward at IMU rate. Belongs to the tick thread; allocates nothing.
pub struct Propagator {}

impl Propagator {
    /// A propagator without a state.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let _ = config;
        Self {}
    }

    /// Takes the estimate of a frame: the state is propagated anew from its time to the newest sample.
    pub fn correct(&mut self, estimate: &Estimate) {
        let _ = estimate;
    }

    /// Takes an inertial sample; the odometry at its time, once there has been an estimate with a pose.
    pub fn tick(&mut self, sample: &ImuSample) -> Option<Odometry> {
        let _ = sample;
        None
    }
}
