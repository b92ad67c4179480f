//! The estimator as its user meets it: front-end and window, one after the other on one thread.
//!
//! An executor that has cores to spare runs [`FrontEnd`] and [`Odometer`] side by side by the same rule, and
//! gets the same bits. IMU-rate odometry is beside it, in [`crate::propagator`].

use crate::estimate::{Estimate, FrameInput, StageProbe};
use crate::front_end::{Feedback, FrontEnd, Tracked};
use crate::lines::LineObservation;
use crate::odometry::Odometer;
use crate::work_budget::{InTurn, WorkBudget};
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
pub struct Estimator {
    front_end: FrontEnd,
    odometer: Odometer,
    tracked: Tracked,
    feedback: Feedback,
}

impl Estimator {
    /// Allocates everything the configuration asks for. The configuration has passed validation.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            front_end: FrontEnd::new(config),
            odometer: Odometer::new(config),
            tracked: Tracked::new(config),
            feedback: Feedback::new(config),
        }
    }

    /// Takes an inertial sample.
    pub fn add_imu(&mut self, sample: &ImuSample) -> ImuAdmission {
        self.front_end.add_imu(sample)
    }

    /// Samples up to this time must have been added before the frame of `image_stamp` is.
    #[must_use]
    pub fn imu_needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        self.front_end.imu_needed_until(image_stamp)
    }

    /// Takes a frame, and returns the estimate after it. An image of the wrong size counts as missing.
    pub fn add_frame<P: StageProbe + Send>(
        &mut self,
        frame: &FrameInput<'_>,
        budget: &WorkBudget,
        [point_probe, line_probe]: [&mut P; 2],
    ) -> Estimate {
        self.front_end.track(frame, budget, &InTurn, [point_probe, line_probe], &mut self.tracked);
        // That of the frame before: the next frame is tracked without knowing what this one brings.
        self.front_end.apply_feedback(&self.feedback);
        self.odometer.process(&self.tracked, point_probe, &mut self.feedback)
    }

    /// The lines seen in the last frame, for display.
    #[must_use]
    pub fn line_observations(&self) -> &[LineObservation] {
        self.front_end.line_observations()
    }

    /// Starts anew before the next frame.
    pub fn reset(&mut self, kind: ResetKind) {
        self.front_end.reset(kind);
    }
}
